"""Free networks in other datums: as if they had been calibrated there."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.calibration import Distance, Fixed, Free, in_datum, self_calibrate
from windmark.geometry import DegenerateGeometry

SOME = [f"m{i:02d}" for i in (0, 3, 8, 11, 20)]


def solved(case, datum, start=None, **options):
    observations, markers, cameras, views, rig = networks.nouns(case, start=start)
    markers = replace(markers, radius=np.full(len(markers), 8.0))
    return self_calibrate(observations, markers, cameras, views, datum=datum, **(rig | options)), markers


@pytest.mark.parametrize("kind", ["plain", "rig", "distance", "focal", "principal"])
def test_as_if_calibrated_there(kind):
    case = networks.make(81, points=24, views=7, rig=kind == "rig")
    options = {}
    if kind == "distance":
        length = float(np.linalg.norm(case.truth.points[2] - case.truth.points[7]))
        options["distances"] = [Distance("m02", "m07", length, 0.02)]
    if kind == "focal":
        options["free_focal"] = ["v02"]
    if kind == "principal":
        options["free_principal"] = ["v02"]
    first, table = solved(case, Free(), **options)
    there, _ = solved(case, Free(SOME), **options)
    moved = in_datum(first, Free(SOME), table)
    np.testing.assert_allclose(moved.markers.xyz, there.markers.xyz, atol=2e-3 * first.markers.sigma.min())
    np.testing.assert_allclose(moved.markers.sigma, there.markers.sigma, rtol=1e-4)
    np.testing.assert_allclose(moved.marker_cov, there.marker_cov, atol=1e-4 * np.abs(there.marker_cov).max())
    np.testing.assert_allclose(moved.pose_cov, there.pose_cov, atol=1e-4 * np.abs(there.pose_cov).max())
    assert moved.pose("v03").translation == pytest.approx(there.pose("v03").translation, rel=1e-6)
    # The pictures do not know of it.
    np.testing.assert_allclose(moved.residuals, first.residuals, atol=1e-7)
    name = next(iter(first.cameras))
    for parameter in ("focal_px", "k1"):
        assert moved.sigma(name, parameter) == pytest.approx(first.sigma(name, parameter), rel=1e-5)
    assert moved.options["datum"].markers == SOME
    # There and back.
    back = in_datum(moved, Free(), table)
    np.testing.assert_allclose(back.markers.xyz, first.markers.xyz, atol=2e-3 * first.markers.sigma.min())
    np.testing.assert_allclose(back.marker_cov, first.marker_cov, atol=1e-6 * np.abs(first.marker_cov).max())


def test_without_a_reference_only_the_covariances_change():
    first, _ = solved(networks.make(82, points=20, views=6), Free())
    moved = in_datum(first, Free(SOME[:4]))
    np.testing.assert_allclose(moved.markers.xyz, first.markers.xyz, atol=1e-9)
    inside = np.isin(first.markers.name, SOME[:4])
    assert (moved.markers.sigma**2)[inside].sum() < (first.markers.sigma**2)[inside].sum()
    assert (moved.markers.sigma**2).sum() > (first.markers.sigma**2).sum()


def test_what_cannot_be_transformed_is_named():
    case = networks.make(83, points=20, views=6)
    start = case.start.points.copy()
    start[:4] = case.truth.points[:4]
    held, table = solved(case, Fixed([f"m{i:02d}" for i in range(4)]), start)
    with pytest.raises(ValueError, match="free network"):
        in_datum(held, Free())
    free, _ = solved(case, Free())
    with pytest.raises(ValueError, match="Fixed"):
        in_datum(free, Fixed(SOME))
    with pytest.raises(ValueError, match="nobody"):
        in_datum(free, Free([*SOME[:4], "nobody"]))
    with pytest.raises(ValueError, match="m05"):
        in_datum(free, Free(["m04", "m05", "m06"]), table.take(np.arange(5)))
    with pytest.raises(DegenerateGeometry):
        in_datum(free, Free(SOME[:2]))
