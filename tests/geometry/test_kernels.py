"""The fast kernels against their readable twins, `Camera.project` and `Pose.apply`."""

from __future__ import annotations

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.geometry._kernels import project_point, project_with_slopes, to_camera


def test_projection_is_that_of_the_camera(camera):
    rng = np.random.default_rng(0)
    xyz = rng.uniform(-2, 2, (2000, 3)) * [1, 1, 2]
    expected, valid = camera.project(xyz)
    assert 0.1 < valid.mean() < 0.6
    packed = camera.packed()
    found = [project_point(packed, *p) for p in xyz]
    assert [ok for _, _, ok in found] == valid.tolist()
    xy = np.array([(x, y) for x, y, _ in found])
    np.testing.assert_allclose(xy[valid], expected[valid], rtol=1e-13, atol=1e-9)
    assert np.isnan(xy[~valid]).all()


def test_fold_decentring_and_horizon_are_the_same():
    wild = Camera((640, 480), 300.0, k1=-0.1, k2=0.05, p1=0.05, p2=-0.08, k3=-0.01, tilt_x=-0.5, tilt_y=0.7)
    xyz = np.random.default_rng(1).uniform(-4, 4, (5000, 3))
    xyz[:, 2] = 1
    expected, valid = wild.project(xyz)
    assert 0.02 < valid.mean() < 0.98
    found = [project_point(wild.packed(), *p) for p in xyz]
    assert [ok for _, _, ok in found] == valid.tolist()
    xy = np.array([(x, y) for x, y, _ in found])[valid]
    np.testing.assert_allclose(xy, expected[valid], rtol=1e-9)


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.1, -0.2)])
def test_slopes_are_those_of_the_camera(tilt):
    lens = Camera(
        (640, 480), 900.0, aspect=1.02, k1=-0.1, k2=0.05, p1=0.002, p2=-0.003, k3=0.01, tilt_x=tilt[0], tilt_y=tilt[1],
        shear=tilt[0] / 5,
    )  # fmt: skip
    xyz = np.random.default_rng(3).uniform(-2, 2, (500, 3)) + np.array([0, 0, 1.0])
    xy, valid, slopes = lens.point_jacobian(xyz)
    assert 0.3 < valid.mean() < 1.0
    for k, p in enumerate(xyz):
        x, y, seen, *six = project_with_slopes(lens.packed(), *p)
        assert seen == valid[k]
        if seen:
            np.testing.assert_allclose([x, y], xy[k], rtol=1e-12)
            np.testing.assert_allclose(
                np.reshape(six, (2, 3)), slopes[k], rtol=1e-9, atol=1e-12 * np.abs(slopes[k]).max()
            )


def test_not_a_number_is_not_valid(camera):
    for p in ((np.nan, 0, 1), (0, np.nan, 1), (0, 0, np.nan), (0, 0, 0), (0, 0, -1)):
        assert project_point(camera.packed(), *map(float, p))[2] is False


def test_to_camera_is_the_pose():
    pose = Pose.exp([0.3, -0.2, 1.0, 1, 2, 3])
    for p in np.random.default_rng(2).normal(size=(20, 3)):
        np.testing.assert_allclose(to_camera(pose.rotation, pose.translation, *p), pose.apply(p), atol=1e-14)
