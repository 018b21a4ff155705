"""Pairs of pictures of a few known scenes, with noise and wrong pairs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from windmark.geometry import Camera, Pose

CAMERA = Camera((2000, 1500), 2200.0, 1.01, 1010.0, 740.0, k1=-0.15, k2=0.05, p1=1e-3)
OTHER = Camera((1600, 1200), 1500.0, k1=0.08, p2=-5e-4, tilt_x=0.03)


@dataclass(frozen=True)
class Scene:
    """Truth and pixels (N, 2) of one pair of pictures."""

    xyz_a: np.ndarray
    b_from_a: Pose
    xy_a: np.ndarray
    xy_b: np.ndarray
    wrong: np.ndarray
    camera_a: Camera
    camera_b: Camera

    @property
    def unit(self) -> Pose:
        """The relative pose with a baseline of length 1."""
        t = self.b_from_a.translation
        return Pose(self.b_from_a.rotation, t / np.linalg.norm(t))


@pytest.fixture
def scene():
    """Factory of scenes four units away: ``kind`` space, plane or rotation; ``baseline`` in units of the distance."""

    def make(kind="space", n=80, *, seed=0, sigma=0.0, wrong=0.0, baseline=0.15, camera_b=CAMERA):
        rng = np.random.default_rng(seed)
        depth = 0.0 if kind == "plane" else 0.5
        xyz = np.column_stack([rng.uniform(-1, 1, (n, 2)), rng.uniform(-depth, depth, n)])
        eye = np.array([*rng.uniform(-1, 1, 2), -4.0])
        a_from_model = Pose.look_at(eye, [0, 0, 0], [0, -1, 0.1])
        step = rng.normal(size=3)
        step *= 0.0 if kind == "rotation" else 4 * baseline / np.linalg.norm(step)
        b_from_model = Pose.look_at(eye + step, rng.normal(size=3) * 0.1, [0.1, -1, 0])
        xy_a = CAMERA.project(a_from_model.apply(xyz))[0] + sigma * rng.normal(size=(n, 2))
        xy_b = camera_b.project(b_from_model.apply(xyz))[0] + sigma * rng.normal(size=(n, 2))
        bad = rng.random(n) < wrong
        xy_b[bad] = rng.permutation(xy_b[bad]) + rng.normal(0, 20, (int(bad.sum()), 2))
        b_from_a = b_from_model @ a_from_model.inverse()
        return Scene(a_from_model.apply(xyz), b_from_a, xy_a, xy_b, bad, CAMERA, camera_b)

    return make


@pytest.fixture
def other_camera():
    """A second camera: another lens, a tilted sensor."""
    return OTHER


@pytest.fixture
def angle_deg():
    """Angle in degrees between two vectors."""
    return lambda u, v: float(np.degrees(np.arctan2(np.linalg.norm(np.cross(u, v)), np.dot(u, v))))
