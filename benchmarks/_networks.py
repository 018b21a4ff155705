"""Calibration scenarios with truth: S1, S2, S3 (see `calibration.py`), their noise, starts and Cramer-Rao bounds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network import Network, NetworkProblem, NetworkState
from windmark.adjust.network.covariance import network_covariance
from windmark.adjust.network.datum import in_datum
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Observations, View

Array = NDArray[np.float64]

FREE = ("focal_px", "aspect", "cx", "cy", "k1", "k2", "p1", "p2")
NOISE_PX = 0.1
PRIMARIES = 4
MODEL = 100
"""Markers of S2 on the model; the others are on the wall."""
CAMERA = Camera((3004, 2000), 3070.0, 1.0005, 1510.0, 990.0, k1=-0.045, k2=0.03, p1=3e-4, p2=-2e-4)
"""Some 10 px of distortion at the border."""


@dataclass(frozen=True)
class Scenario:
    """A perfect network; `noisy` adds the noise of one seed."""

    name: str
    truth: NetworkState
    view: NDArray[np.int64]
    point: NDArray[np.int64]
    xy: Array

    def network(self, held: bool, xy: Array | None = None) -> Network:
        """All interior parameters but k3 and the tilts free; with ``held`` four wide markers do not move."""
        views, points = len(self.truth.frames.translation), len(self.truth.points)
        fixed = np.zeros((points, 3), bool)
        if held:
            fixed[self.primaries] = True
        cov = np.broadcast_to(NOISE_PX**2 * np.eye(2), (len(self.view), 2, 2)).copy()
        return Network(
            self.view, self.point, self.xy if xy is None else xy, cov, np.zeros(views, int), np.arange(views),
            np.full(views, -1), (FREE,), np.ones(views, bool), fixed,
        )  # fmt: skip

    @property
    def primaries(self) -> NDArray[np.int64]:
        """Four markers near the corners."""
        x, y = self.truth.points[:, 0], self.truth.points[:, 1]
        return np.array([np.argmax(a * x + b * y) for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))])

    def noisy(self, rng: np.random.Generator) -> Array:
        """Marks with Gaussian noise."""
        return self.xy + rng.normal(0, NOISE_PX, self.xy.shape)

    def start(self, rng: np.random.Generator, *, marker: float = 3.0, focal: float = 1.026) -> NetworkState:
        """Rough values: markers off by so much (1 sigma per coordinate), the focal length by a factor, no distortion.

        Poses are those of the true cameras, off by what a resection with such markers is.
        """
        views = len(self.truth.frames.translation)
        depth = float(np.median(self.truth.frames.translation[:, 2]))
        delta = rng.normal(0, 1, (views, 6)) * [*(3 * [marker / 600]), *(3 * [marker])]
        poses = Pose.exp(delta) @ self.truth.frames
        shift = np.array([0, 0, depth * (focal - 1)])
        poses = Pose(poses.rotation, poses.translation + shift)
        camera = Camera(CAMERA.size_px, CAMERA.focal_px * focal)
        return replace(
            self.truth, cameras=(camera,), frames=poses,
            points=self.truth.points + rng.normal(0, marker, self.truth.points.shape),
        )  # fmt: skip

    def nouns(
        self, xy: Array, points: Array, focal: float = 1.0, *, posed: bool = False
    ) -> tuple[Observations, MarkerSet, dict[str, Camera], list[View]]:
        """What `self_calibrate` takes: marks, rough markers, a camera without distortion; true poses or none."""
        cov = np.broadcast_to(NOISE_PX**2 * np.eye(2), (len(self.view), 2, 2)).copy()
        markers = MarkerSet.make([f"m{n:04d}" for n in range(len(points))], points)
        frames = self.truth.frames
        poses = [Pose(r, t) if posed else None for r, t in zip(frames.rotation, frames.translation, strict=True)]
        views = [View(f"v{v:03d}", "cam", cam_from_model=pose) for v, pose in enumerate(poses)]
        camera = Camera(CAMERA.size_px, CAMERA.focal_px * focal)
        return Observations(self.view, self.point, xy, cov), markers, {"cam": camera}, views

    def only(self, marks: NDArray[np.bool_] | NDArray[np.int64]) -> Scenario:
        """Some of the marks."""
        return replace(self, view=self.view[marks], point=self.point[marks], xy=self.xy[marks])

    def bound(self, held: bool) -> tuple[Array, Array]:
        """(N, 3, 3) and (8, 8): covariances of markers and of the natural interior parameters at the truth."""
        problem = NetworkProblem(self.network(held), self.truth)
        system = problem.linearise(self.truth)
        assert system is not None
        datum = in_datum(network_covariance(system, problem.layout))
        return datum.points(), datum.dense()[:8, :8]


def scenario(name: str, seed: int) -> Scenario:
    """S1: nearly flat plate of 690 mm with a rake. S2: a model of 690 mm before a wall of 1280 mm. S3: a large hall."""
    rng = np.random.default_rng(seed)
    if name == "S1":
        views, n, visible = 25, 100, 0.8
        xyz = rng.uniform(-345, 345, (n, 3)) * [1, 0.8, 0]
        xyz[:, 2] = rng.normal(0, 3, n)
        xyz[:12, 2] = rng.uniform(20, 120, 12)
    elif name == "S2":
        views, n, visible = 50, 150, 0.8
        xyz = rng.uniform(-345, 345, (n, 3)) * [1, 0.8, 0.45]
        xyz[MODEL:] = rng.uniform(-640, 640, (n - MODEL, 3)) * [1, 0.8, 0] - [0, 0, 330]
    else:
        views, n, visible = 500, 2000, 0.33
        xyz = rng.uniform(-1000, 1000, (n, 3)) * [1, 0.7, 0.3]
    return pictures(name, xyz, views, visible, rng)


def pictures(name: str, xyz: Array, views: int, visible: float, rng: np.random.Generator) -> Scenario:
    """Hand-held pictures of markers, of which each shows a share."""
    n = len(xyz)
    reach = float(np.abs(xyz[:, :2]).max())
    poses = [_view(rng, reach) for _ in range(views)]
    frames = Pose(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))
    view, point = np.nonzero(rng.random((views, n)) < visible)
    xc = np.einsum("oij,oj->oi", frames.rotation[view], xyz[point]) + frames.translation[view]
    xy, valid = CAMERA.project(xc)
    inside = valid & CAMERA.in_image(xy)
    return Scenario(name, NetworkState((CAMERA,), frames, xyz), view[inside], point[inside], xy[inside])


def _view(rng: np.random.Generator, reach: float) -> Pose:
    """Hand-held: from 6 to 50 degrees off the normal, any roll, the field filled."""
    around, up = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(6, 50))
    distance = reach * CAMERA.focal_px / 1000 * rng.uniform(1.05, 1.3)
    eye = distance * np.array([np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up)])
    roll = rng.uniform(0, 2 * np.pi)
    return Pose.look_at(eye, rng.normal(0, 0.03 * reach, 3), np.array([np.cos(roll), np.sin(roll), 0.1]))
