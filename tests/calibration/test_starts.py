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


def test_a_marker_that_poses_given_by_the_user_cannot_see_joins_later_too():
    case = networks.make(108, points=30, views=10)
    rough = case.start.points.copy()
    rough[3] += [0, 0, 4000.0]
    found = calibrated(case, rough, 1.0, posed=True)
    assert found
    assert len(found.used) == len(case.network.view)
    same(found, calibrated(case, case.truth.points, 1.0, posed=True))


def test_a_start_in_which_no_camera_sees_anything_is_refused():
    case = networks.make(108, points=30, views=10)
    found = calibrated(case, case.start.points + np.array([0, 0, 4000.0]), 1.0, posed=True)
    assert not found
    assert found.cause == "degenerate"
    assert "in front of the camera" in found.reason


@pytest.mark.parametrize("posed", [True, False])
def test_a_mark_of_a_marker_behind_its_camera_is_left_out_and_said(posed):
    """Cameras in the middle of a room; labels of some marks are those of markers on the wall behind."""
    rng = np.random.default_rng(3)
    xyz = rng.uniform(-1, 1, (120, 3))
    wall = rng.integers(0, 3, 120)
    xyz[np.arange(120), wall] = np.sign(xyz[np.arange(120), wall])
    camera = Camera((1200, 900), 600.0, k1=-0.03)
    poses = [Pose.look_at(eye, rng.normal(size=3), rng.normal(size=3)) for eye in rng.uniform(-0.3, 0.3, (24, 3))]
    seen = [camera.project(pose.apply(xyz)) for pose in poses]
    view, point = np.nonzero([valid & camera.in_image(xy) for xy, valid in seen])
    xy = np.array([seen[v][0][p] for v, p in zip(view, point, strict=True)]) + rng.normal(0, 0.1, (len(view), 2))
    behind = {}
    often = np.argsort(-np.bincount(point, minlength=120))
    for v in (2, 9):
        far = next(p for p in often if poses[v].apply(xyz[p])[2] < -0.4)
        behind[f"m{far} in v{v}"] = at = np.flatnonzero(view == v)[1]
        point[at] = far
    marks = Observations(view, point, xy, np.tile(0.01 * np.eye(2), (len(view), 1, 1)))
    views = [View(f"v{v}", "cam", cam_from_model=pose if posed else None) for v, pose in enumerate(poses)]
    rough = MarkerSet.make([f"m{k}" for k in range(120)], xyz + rng.normal(0, 0.003, (120, 3)))
    found = self_calibrate(marks, rough, {"cam": Camera((1200, 900), 620.0)}, views, datum=Free())
    assert found
    assert {name for name, why in found.dropped.items() if "behind the camera" in why} == set(behind)
    assert len(found.used) == len(view) - sum("one view" in why for why in found.dropped.values()) - len(behind)
    assert found.used.all()
    camera = found.cameras["cam"]
    assert abs(camera.focal_px - 600) < 4 * np.sqrt(camera.cov[0, 0])


def test_a_start_that_leads_nowhere_is_a_misfit_not_a_weak_lens():
    """All starts collapse, which says nothing about what the pictures determine."""
    case, rng = networks.make(109, points=30, views=8), np.random.default_rng(9)
    found = calibrated(case, rng.normal(0, 200, (30, 3)), 0.6)
    assert isinstance(found, NotCalibrated)
    assert found.cause == "misfit"
    assert found.sigma0 > 5
