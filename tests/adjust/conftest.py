"""One camera that looks at a scattered set of points, with known truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from windmark.geometry import Camera, Pose


@dataclass(frozen=True)
class Scene:
    camera: Camera
    pose: Pose
    xyz: np.ndarray
    xy: np.ndarray  # without noise
    rng: np.random.Generator

    def noisy(self, sigma_px: float) -> np.ndarray:
        return self.xy + sigma_px * self.rng.normal(size=self.xy.shape)

    def cov(self, sigma_px: float) -> np.ndarray:
        return np.tile(np.eye(2) * sigma_px**2, (len(self.xyz), 1, 1))

    def start(self, rotation: float = 0.05, translation: float = 0.2) -> Pose:
        """A pose near the truth: turned and shifted by that much."""
        w, t = self.rng.normal(size=(2, 3))
        turn = Pose.from_rotvec(rotation * w / np.linalg.norm(w), np.zeros(3))
        return Pose(turn.rotation @ self.pose.rotation, self.pose.translation + translation * t / np.linalg.norm(t))


def make_scene(seed: int = 0, n: int = 20, size=(1.0, 1.0, 0.4), **camera) -> Scene:
    rng = np.random.default_rng(seed)
    settings = {"focal_px": 1800.0, "aspect": 1.01, "cx": 630.0, "cy": 410.0, "k1": -0.1, "k2": 0.03, "p1": 1e-3}
    cam = Camera((1280, 800), **(settings | camera))
    pose = Pose.from_rotvec([0.3, -0.4, 1.1], [0.2, -0.1, 8.0])
    xyz = rng.uniform(-1, 1, (n, 3)) * np.array(size)
    xy, valid = cam.project(pose.apply(xyz))
    assert valid.all()
    return Scene(cam, pose, xyz, xy, rng)


@pytest.fixture
def scene():
    """Factory of scenes: `scene(seed, n, size, **camera)`."""
    return make_scene
