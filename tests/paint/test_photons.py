"""Groups of levels of the photon transfer, and small parts beside: words of self-illumination, factors of any size."""

import numpy as np
import pytest

from windmark.paint import NodeField, form_factors, photon_transfer
from windmark.paint.photons import BINS, LEAST
from windmark.paint.radiosity import SelfIllumination
from windmark.scene import Mesh, structured_triangles


@pytest.mark.parametrize("columns", [30, 100, 300])
def test_groups_are_as_many_as_have_pixels_enough_and_rise_with_the_light(columns):
    rng = np.random.default_rng(2)
    light = np.tile(np.linspace(100, 5000, columns), (60, 1))
    frames = 0.5 * rng.poisson(light, (3, *light.shape)) + rng.normal(0, 3.0, (3, *light.shape))
    found = photon_transfer(frames)
    assert len(found.levels) == min(BINS, 60 * columns // LEAST)
    assert (np.diff(found.levels) > 0).all()
    np.testing.assert_allclose(found.variances, 0.5 * found.levels + 9.0, rtol=0.45)  # of 400 pixels each: 9 %
    assert found.gain == pytest.approx(0.5, rel=0.1)


def test_self_illumination_in_words():
    field = NodeField.make([1.0, 2.0])
    some = SelfIllumination(field, np.array([0.0, 0.123]), 0.123, 1, 0.0)
    assert str(some) == "self-illumination: at most 12.3 % of the light, at node 1"
    first = SelfIllumination(field, np.array([0.05, 0.0]), 0.05, 0, 0.25)
    assert str(first) == (
        "self-illumination: at most 5 % of the light, at node 0; 25 % of the surface was not seen and taken as the mean"
    )
    assert str(SelfIllumination(field, np.zeros(2), 0.0, -1, 0.0)) == "self-illumination: at most 0 % of the light"


def test_form_factors_do_not_depend_on_the_size_of_the_model():
    """Cells of very different areas in one facet, and one that is collapsed."""
    s = np.linspace(0, 1, 9) ** 2
    a, b = (g.ravel() for g in np.meshgrid(s, np.linspace(0, 1, 9)))
    t = structured_triangles(9, 9)
    xyz = np.concatenate([np.stack([a, b, 0 * a], axis=1), np.stack([0 * a, a, b], axis=1)])
    triangles = np.concatenate([t, t + 81, [[0, 1, 0]]])
    whole = form_factors(Mesh.make(xyz, triangles), facets=12)
    assert np.isfinite(whole.seen).all()
    assert whole.seen.max() > 0.1
    for scale in (1e-3, 1e3):
        other = form_factors(Mesh.make(scale * xyz, triangles), facets=12)
        np.testing.assert_allclose(other.seen, whole.seen, atol=1e-6)
