"""Rational and fisheye lenses beside OpenCV's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from windmark.geometry import Camera

FISHEYES = [(0.0, 0.0, 0.0, 0.0), (-0.02, 3e-3, -1e-3, 1e-4), (0.08, -0.02, 4e-3, -3e-4)]
RATIONALS = [
    (-0.3, 0.1, 1e-3, -2e-3, -0.01, 0.0, 0.0, 0.0),
    (0.4, 0.05, 5e-4, -1e-3, 1e-3, 0.75, 0.2, 0.01),
    (12.0, 5.0, 0.0, 0.0, 0.1, 12.4, 8.0, 1.0),
]


def points(half_angle_deg, count=400):
    rng = np.random.default_rng(7)
    theta, phi = np.radians(half_angle_deg) * np.sqrt(rng.uniform(size=count)), rng.uniform(0, 2 * np.pi, count)
    direction = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    return direction * rng.uniform(0.1, 20, (count, 1))


@pytest.mark.parametrize("k", FISHEYES)
def test_fisheye_as_opencv(k):
    camera = Camera((1600, 1200), 520.0, 1.01, 805.0, 590.0, k1=k[0], k2=k[1], k3=k[2], k4=k[3], lens="fisheye")
    xyz = points(80)
    want = cv2.fisheye.projectPoints(xyz[:, None], np.zeros(3), np.zeros(3), camera.matrix, np.array(k))[0][:, 0]
    got, valid = camera.project(xyz)
    assert valid.all()
    np.testing.assert_allclose(got, want, atol=1e-9)
    undistorted = cv2.fisheye.undistortPoints(got[:, None], camera.matrix, np.array(k))[:, 0]
    np.testing.assert_allclose(camera.unproject(got)[:, :2], undistorted, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("d", RATIONALS)
def test_rational_as_opencv(d):
    k1, k2, p1, p2, k3, k4, k5, k6 = d
    camera = Camera(
        (1600, 1200), 700.0, 0.99, 805.0, 590.0, k1, k2, p1, p2, k3, 0.02, -0.01, k4=k4, k5=k5, k6=k6, lens="rational"
    )
    xyz = points(40)
    full = np.array([*d, 0, 0, 0, 0, 0.02, -0.01])
    want = cv2.projectPoints(xyz, np.zeros(3), np.zeros(3), camera.matrix, full)[0][:, 0]
    got, valid = camera.project(xyz)
    assert valid.all()
    np.testing.assert_allclose(got, want, atol=1e-8)
