"""Groups of levels of the photon transfer, and small parts beside: words of self-illumination, factors of any size."""

import numpy as np
import pytest

from windmark.paint import NodeField, form_factors, photon_transfer
from windmark.paint.photons import BINS, LEAST, soft_limit
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


def scene(bent, *, top=9000.0, seed=0, frames=3, shifted=0):
    """Frames of a scene of all levels; its light is ``bent`` before it is noted."""
    rng = np.random.default_rng(seed)
    electrons = np.tile(np.linspace(300.0, top, 300) / 0.54, (200, 1))
    light = 0.54 * rng.poisson(np.stack([np.roll(electrons, k * shifted, axis=0) for k in range(frames)]))
    return np.rint(100 + bent(light) + rng.normal(0, 3.0, light.shape))


def soft(light):
    """Straight up to 7,000, of a slope of 0.6 to 8,000, and of a fifth above."""
    return np.interp(light, [0, 7000, 8000, 20_000], [0, 7000, 7600, 10_000])


@pytest.mark.parametrize("seed", range(3))
def test_levels_that_are_limited_softly_are_too_quiet(seed):
    found = soft_limit(scene(soft, seed=seed), 0.54, 9.0, dark=100.0)
    assert found is not None
    assert found.level == pytest.approx(7000, abs=250)
    assert found.part < 0.1
    assert soft_limit(scene(soft, seed=seed, top=6500.0), 0.54, 9.0, dark=100.0) is None  # too dark to come there


@pytest.mark.parametrize("seed", range(3))
def test_light_that_is_straight_is_not(seed):
    frames = scene(lambda light: light, seed=seed)
    assert soft_limit(frames, 0.54, 9.0, dark=100.0) is None
    assert soft_limit(frames, 2.0, 9.0, dark=100.0) is None  # the gain of another setting: all levels alike
    assert soft_limit(frames[:1], 0.54, 9.0, dark=100.0) is None
    means = scene(lambda light: light, seed=seed, frames=12).reshape(3, 4, 200, 300).mean(axis=1)
    assert soft_limit(means, 0.54, 9.0, dark=100.0) is None


def test_pixels_that_are_clipped_hard_are_known_and_not_asked():
    frames = np.minimum(scene(lambda light: light), 8000.0)
    assert soft_limit(frames, 0.54, 9.0, dark=100.0) is not None
    assert soft_limit(np.where(frames < 8000, frames, np.nan), 0.54, 9.0, dark=100.0, limit=8000.0) is None
