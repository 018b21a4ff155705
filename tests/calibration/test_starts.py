"""Bad starts end at the optimum, or are refused for what they are."""

import networks
import numpy as np
import pytest

from windmark.calibration import Calibration, Free, NotCalibrated, self_calibrate
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Observations, View


def calibrated(case, xyz, focal, *, posed=False, **options):
    net, frames = case.network, case.truth.frames
    poses = [Pose(r, t) if posed else None for r, t in zip(frames.rotation, frames.translation, strict=True)]
    return self_calibrate(
        Observations(net.view, net.point, net.xy, net.cov), MarkerSet.make([f"m{k}" for k in range(len(xyz))], xyz),
        {"cam": Camera((1500, 1000), 1530.0 * focal)},
        [View(f"v{v}", "cam", cam_from_model=pose) for v, pose in enumerate(poses)], datum=Free(), **options,
    )  # fmt: skip


def same(found, best):
    np.testing.assert_array_equal(found.used, best.used)
    costs = [c.redundancy * c.sigma0**2 for c in (found, best)]
    assert costs[0] == pytest.approx(costs[1], rel=1e-6)


@pytest.mark.parametrize("seed", [100, 102, 106])
def test_another_start_is_tried_where_the_first_one_collapses(seed):
    """A flat guess, a fifth of the plate wrong, the focal length 40 % short: first all points run to one place."""
    case, rng = networks.make(seed, points=30, views=8), np.random.default_rng(seed)
    rough = (case.truth.points + rng.normal(0, 130, (30, 3))) * [1, 1, 0]
    found = calibrated(case, rough, 0.6)
    assert isinstance(found, Calibration)
    same(found, calibrated(case, case.truth.points, 1.0, posed=True))


def test_a_marker_that_the_first_poses_cannot_see_joins_later():
    """Its rough place, behind most cameras, is a slip of the pen; the pictures know better."""
    case = networks.make(107, points=30, views=10)
    rough = case.start.points.copy()
    rough[3] += [0, 0, 4000.0]
    found = calibrated(case, rough, 1.1)
    assert found
    assert len(found.used) == len(case.network.view)
    same(found, calibrated(case, case.truth.points, 1.0, posed=True))


def test_a_start_given_by_the_user_without_images_is_an_error():
    case = networks.make(108, points=30, views=10)
    rough = case.start.points.copy()
    rough[3] += [0, 0, 4000.0]
    with pytest.raises(ValueError, match="behind a camera"):
        calibrated(case, rough, 1.0, posed=True)


def test_a_start_that_leads_nowhere_is_a_misfit_not_a_weak_lens():
    """All starts collapse, which says nothing about what the pictures determine."""
    case, rng = networks.make(109, points=30, views=8), np.random.default_rng(9)
    found = calibrated(case, rng.normal(0, 200, (30, 3)), 0.6)
    assert isinstance(found, NotCalibrated)
    assert found.cause == "misfit"
    assert found.sigma0 > 5
