"""Relative poses of pairs of the DBAT sheet's pictures: nearly flat (7 mm over 1 m), one real lens, hand-held."""

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.geometry import estimate_two_view

DATA = Path(__file__).parents[2] / ".." / "shared" / "data" / "dbat-camcal"


@pytest.fixture(scope="module")
def calibrated():
    """Camera, poses and marks (V, N, 2) of the published project, calibrated by windmark."""
    if not DATA.is_dir():
        pytest.skip("real pictures (dbat-camcal) are not here")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
        import calibration_real as bench

    sheet = bench.published(DATA)
    start = {"camera": bench.Camera(bench.SIZE, 0.9 * 7.457 / 7.25301 * bench.SIZE[0])}
    result = bench.self_calibrate(
        sheet.observations, sheet.markers, start, sheet.views, datum=bench.Fixed(bench.CONTROL), free=bench.BROWN
    )
    xy = np.full((len(sheet.views), len(sheet.markers.name), 2), np.nan)
    xy[sheet.observations.view, sheet.observations.point] = sheet.observations.xy
    sys.modules.pop("calibration_real", None)
    return result.cameras["camera"], [view.cam_from_model for view in result.views], xy


def off_deg(pose, truth):
    """Angle of the baselines."""
    t = truth.translation / np.linalg.norm(truth.translation)
    return np.degrees(np.arccos(np.clip(pose.translation @ t, -1, 1)))


@pytest.mark.parametrize("draw", [1, 4])
@pytest.mark.parametrize("options", [{"cov_a": 0.16**2 * np.eye(2), "cov_b": 0.16**2 * np.eye(2)}, {}])
def test_the_pose_is_found_and_doubt_is_told(calibrated, options, draw):
    camera, poses, xy = calibrated
    rng, silent = np.random.default_rng(draw), []
    for i in range(len(poses)):
        j = (i + 1) % len(poses)
        xy_b = xy[j].copy()
        wrong = rng.random(len(xy_b)) < 0.2
        xy_b[wrong] = rng.permutation(xy_b[wrong])
        if (i + draw) % 2:
            continue  # the other draw's turn
        view = estimate_two_view(xy[i], xy_b, camera, **options)
        truth = poses[j] @ poses[i].inverse()
        if min(off_deg(p, truth) for p in (view.b_from_a, *view.alternatives)) > 4.0:
            silent.append(i)
        elif off_deg(view.b_from_a, truth) > 4.0:
            assert "equally well" in view.reason
        moved = wrong & (xy_b != xy[j]).any(axis=1)
        assert (view.inliers & moved).sum() <= 0.25 * moved.sum()  # rows of the sheet lie along epipolar lines
    assert silent == []
