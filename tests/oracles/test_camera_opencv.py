"""Camera, rotations and undistortion against OpenCV, whose meaning and signs the camera model keeps."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from windmark.geometry import Camera, Pose, rotations

CAMERAS = {
    "pinhole": Camera((640, 480), 500.0),
    "aspect": Camera((1000, 700), 1234.0, 1.05, 480.0, 360.0),
    "radial": Camera((2000, 1500), 1500.0, k1=-0.25, k2=0.08, k3=-0.01),
    "full": Camera((3004, 2000), 3070.0, 0.998, 1510.2, 990.7, 0.12, -0.05, -4e-4, 6e-4, 0.02),
    "tilt x": Camera((1280, 1024), 2400.0, tilt_x=0.15),
    "tilt y": Camera((1280, 1024), 2400.0, tilt_y=-0.25),
    "all": Camera((1280, 1024), 1400.0, 1.01, 650.0, 500.0, -0.2, 0.05, 1e-3, -8e-4, 0.01, 0.12, -0.2),
}


@pytest.fixture(params=CAMERAS.values(), ids=CAMERAS.keys())
def camera(request):
    return request.param


def coefficients(camera):
    """OpenCV's fourteen: k1 k2 p1 p2 k3, k4 k5 k6 (rational), s1..s4 (thin prism), tau_x tau_y."""
    c = camera
    return np.array([c.k1, c.k2, c.p1, c.p2, c.k3, *[0.0] * 7, c.tilt_x, c.tilt_y])


def points(n=500, seed=0):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-0.4, 0.4, (n, 2)), np.ones(n)]) * rng.uniform(0.5, 50, (n, 1))


def test_projection(camera):
    pose = Pose.from_rotvec([0.1, -0.2, 0.3], [0.2, -0.1, 1.0])
    xyz = pose.inverse().apply(points())
    expected = cv2.projectPoints(xyz, pose.rotvec, pose.translation, camera.matrix, coefficients(camera))[0][:, 0]
    xy, valid = camera.project(pose.apply(xyz))
    assert valid.mean() > 0.95
    np.testing.assert_allclose(xy[valid], expected[valid], atol=1e-9 * camera.focal_px)


def test_derivatives(camera):
    pose = Pose.from_rotvec([0.1, -0.2, 0.3], [0.2, -0.1, 1.0])
    xyz = pose.inverse().apply(points(60))
    _, jacobian = cv2.projectPoints(xyz, pose.rotvec, pose.translation, camera.matrix, coefficients(camera))
    # OpenCV: rvec 3, tvec 3, fx fy, cx cy, k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y
    cv = jacobian.reshape(60, 2, -1)
    _, valid, d_xyz, d_par = camera.project_jacobian(pose.apply(xyz))
    assert valid.all()
    fx_and_fy = cv[..., 6] + camera.aspect * cv[..., 7]  # our focal length moves both
    pairs = [
        (d_xyz, cv[..., 3:6]),
        (d_par[..., 0], fx_and_fy),
        (d_par[..., 1], camera.focal_px * cv[..., 7]),
        (d_par[..., 2:4], cv[..., 8:10]),
        (d_par[..., 4:9], cv[..., 10:15]),
        (d_par[..., 9:11], cv[..., 22:24]),
    ]
    for ours, theirs in pairs:
        np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-8 * max(1.0, np.abs(theirs).max()))


def test_unprojection(camera):
    """OpenCV iterates; asked for many steps it agrees. (Its tilted model is inverted exactly by both.)"""
    w, h = camera.size_px
    xy = np.random.default_rng(1).uniform([0.1 * w, 0.1 * h], [0.9 * w, 0.9 * h], (200, 2))
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 500, 1e-14)
    if hasattr(cv2, "undistortPointsIter"):  # until OpenCV 4
        expected = cv2.undistortPointsIter(xy[:, None], camera.matrix, coefficients(camera), None, None, criteria)[:, 0]
    else:
        expected = cv2.undistortPoints(xy[:, None], camera.matrix, coefficients(camera), criteria=criteria)[:, 0]
    np.testing.assert_allclose(camera.unproject(xy)[:, :2], expected, atol=1e-8)


def test_rotation_vectors():
    rng = np.random.default_rng(2)
    axis = rng.normal(size=(200, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    for rotvec in axis * rng.choice([1e-9, 1e-4, 0.5, 2.0, 3.1, np.pi - 1e-6], (200, 1)):
        matrix = cv2.Rodrigues(rotvec)[0]
        np.testing.assert_allclose(rotations.exp_so3(rotvec), matrix, atol=1e-14)
        np.testing.assert_allclose(rotations.log_so3(matrix), rotvec, atol=1e-9)


def test_where_opencv_folds_the_picture_windmark_says_no():
    """Beyond the radius where the lens turns back OpenCV still gives a pixel, of another ray; here it is invalid."""
    camera = Camera((2000, 1500), 1000.0, k1=-0.3)
    xyz = np.array([[1.5, 0.0, 1.0]])
    folded = cv2.projectPoints(xyz, np.zeros(3), np.zeros(3), camera.matrix, coefficients(camera))[0][0, 0]
    assert camera.in_image(folded)
    xy, valid = camera.project(xyz)
    assert not valid[0]
    assert np.isnan(xy).all()
