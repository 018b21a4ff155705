"""A refusal says which further picture would help, and it does."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.calibration import Calibration, Free, NotCalibrated, self_calibrate
from windmark.geometry import Pose
from windmark.scene import MarkerSet, Observations, View

NOISE = 0.1
WORDS = {
    "rolled by 90 degrees": lambda pose, middle: Pose.from_rotvec([0, 0, np.pi / 2], np.zeros(3)) @ pose,
    "35 degrees to the side": lambda pose, middle: _about(middle, Pose.from_rotvec(np.radians([0, 35, 0]), np.zeros(3)))
    @ pose,
    "in a corner": lambda pose, middle: Pose.from_rotvec(np.radians([10, 14, 0]), np.zeros(3)) @ pose,
    "from nearer": lambda pose, middle: Pose(pose.rotation, pose.translation - 0.4 * middle),
    "from farther away": lambda pose, middle: Pose(pose.rotation, pose.translation + 0.6 * middle),
}


def _about(middle, turn):
    return Pose(np.eye(3), middle) @ turn @ Pose(np.eye(3), -middle)


def calibrated(xyz, poses, rng):
    """Self-calibration of a plate from such pictures, without any control."""
    view, point, xy = [], [], []
    for v, pose in enumerate(poses):
        place, valid = networks.CAMERA.project(pose.apply(xyz))
        seen = np.flatnonzero(valid & networks.CAMERA.in_image(place))
        view, point = [*view, *[v] * len(seen)], [*point, *seen.tolist()]
        xy.append(place[seen])
    marks = np.concatenate(xy) + rng.normal(0, NOISE, (len(view), 2))
    cov = np.broadcast_to(NOISE**2 * np.eye(2), (len(view), 2, 2)).copy()
    table = MarkerSet.make([f"m{k:02d}" for k in range(len(xyz))], xyz + rng.normal(0, 2, xyz.shape))
    return self_calibrate(
        Observations(np.array(view), np.array(point), marks, cov), table,
        {"cam": replace(networks.CAMERA, focal_px=1.02 * networks.CAMERA.focal_px)},
        [View(f"v{v}", "cam") for v in range(len(poses))], datum=Free(),
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(3))
def test_the_pictures_that_are_named_help(seed):
    rng = np.random.default_rng(seed)
    reach = 0.3 * networks.CAMERA.size_px[1] / networks.CAMERA.focal_px * 1000
    xyz = rng.uniform(-reach, reach, (40, 3)) * [1.3, 1, 0]
    xyz[:, 2] = rng.normal(0, 1, 40)
    facing = np.diag([1.0, -1.0, -1.0])
    poses = [Pose(facing, np.array([*rng.uniform(-40, 40, 2), 1000.0 + rng.uniform(-5, 5)])) for _ in range(5)]
    middle, first = poses[0].apply(xyz).mean(axis=0), poses[0]
    result = calibrated(xyz, poses, rng)
    assert isinstance(result, NotCalibrated)
    assert "focal_px" in result.weak
    for _ in range(4):  # one after the other, as somebody at the tunnel would take them
        if isinstance(result, Calibration):
            break
        named = [words for words in WORDS if words in result.reason]
        assert named, result.reason
        poses += [WORDS[words](first, middle) for words in named]
        result = calibrated(xyz, poses, rng)
    assert isinstance(result, Calibration), result.reason
    assert len(poses) <= 9
    assert result.sigma("cam", "focal_px") < 0.1 * networks.CAMERA.focal_px
