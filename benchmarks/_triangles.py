"""Triangles and quadruples of points seen by a camera of known pose: random ones and nearly degenerate ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.geometry.rotations import exp_so3

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Problems:
    """``rotation @ xyz_i + translation`` lies on ray i; rays are unit vectors; (N, 3, 3) rows are points."""

    rays: Array
    xyz: Array
    rotation: Array
    translation: Array

    def take(self, n: int) -> Problems:
        return Problems(self.rays[:n], self.xyz[:n], self.rotation[:n], self.translation[:n])


def _log(rng: np.random.Generator, shape: tuple[int, ...], low: float, high: float) -> Array:
    return 10 ** rng.uniform(low, high, shape)


def random(rng: np.random.Generator, n: int) -> Array:
    """A field of view of 90 degrees, depths over two decades."""
    return np.concatenate([rng.uniform(-1, 1, (n, 3, 2)), np.ones((n, 3, 1))], -1) * _log(rng, (n, 3, 1), -1, 1)


def flat(rng: np.random.Generator, n: int) -> Array:
    """Nearly collinear: the height is 1e-7 to 1e-1 of what it was."""
    c = random(rng, n)
    foot = c[:, 0] + rng.uniform(-1, 2, (n, 1)) * (c[:, 1] - c[:, 0])
    c[:, 2] = foot + (c[:, 2] - foot) * _log(rng, (n, 1), -7, -1)
    return c


def short_edge(rng: np.random.Generator, n: int) -> Array:
    """A very small interior angle: two corners 1e-6 to 1e-1 as far apart."""
    c = random(rng, n)
    c[:, 2] = c[:, 0] + (c[:, 2] - c[:, 0]) * _log(rng, (n, 1), -6, -1)
    return c


def long_lens(rng: np.random.Generator, n: int) -> Array:
    """Rays nearly parallel: a distance of 10 to 100,000 times the size."""
    axis = np.concatenate([rng.uniform(-0.5, 0.5, (n, 2)), np.ones((n, 1))], -1)
    return rng.normal(size=(n, 3, 3)) + axis[:, None] / _log(rng, (n, 1, 1), -5, -1)


def danger(rng: np.random.Generator, n: int) -> Array:
    """Camera 1e-12 to 1e-1 radii off the danger cylinder, where two solutions meet."""
    a, b = rng.uniform(0, 2 * np.pi, (n, 3)), rng.uniform(0, 2 * np.pi, n)
    radius = 1 + _log(rng, (n,), -12, -1) * rng.choice([-1, 1], n)
    camera = np.stack([radius * np.cos(b), radius * np.sin(b), rng.uniform(0.3, 4, n)], -1)
    v = np.stack([np.cos(a), np.sin(a), np.zeros_like(a)], -1) - camera[:, None]
    z = v.mean(axis=1)
    x = np.cross(z, rng.normal(size=(n, 3)))
    y = np.cross(z, x)
    frame = np.stack([e / np.linalg.norm(e, axis=1, keepdims=True) for e in (x, y, z)], axis=1)
    return v @ np.swapaxes(frame, 1, 2)


def edge_on(rng: np.random.Generator, n: int) -> Array:
    """Camera almost in the plane of the triangle."""
    c = random(rng, n)
    inside = rng.uniform(0.2, 1.5, (n, 1)) * c[:, 0] + rng.uniform(0.2, 1.5, (n, 1)) * c[:, 1]
    c[:, 2] = inside + (c[:, 2] - inside) * _log(rng, (n, 1), -9, -1)
    return c


def symmetric(rng: np.random.Generator, n: int) -> Array:
    """Equilateral and isosceles triangles seen along an axis of symmetry: regular marker patterns."""
    a = np.array([0, 2 * np.pi / 3, 4 * np.pi / 3])
    c = np.stack([np.cos(a), np.sin(a), 0 * a], -1) * rng.uniform(0.2, 1, (n, 1, 1))
    kind = rng.integers(0, 3, n)
    c[kind == 1, :, 1] *= 2
    c[kind == 2] = [[0.5, 0.25, 0], [-0.5, 0.25, 0], [0, -0.75, 0.5]]
    c[:, :, 2] += rng.uniform(1, 10, (n, 1))
    return c


DEGENERATE = {f.__name__: f for f in (flat, short_edge, long_lens, danger, edge_on, symmetric)}


def problems(cam: Array, rng: np.random.Generator) -> Problems:
    """Give triangles in the camera frame a random model frame, its origin within a few sizes of the triangle."""
    n = len(cam)
    rotation = exp_so3(rng.normal(size=(n, 3)) * 2)
    center = cam.mean(axis=1, keepdims=True)
    size = np.linalg.norm(cam - center, axis=-1).max(axis=1)[:, None, None]
    xyz = (cam - center) @ rotation + rng.normal(size=(n, 1, 3)) * size
    translation = center[:, 0] - (rotation @ xyz.mean(axis=1)[..., None])[..., 0]
    return Problems(cam / np.linalg.norm(cam, axis=-1, keepdims=True), xyz, rotation, translation)


def four_points(rng: np.random.Generator, flatness: float) -> tuple[float, Pose, Array, Array]:
    """Focal length, pose, four points and their image (px from the principal point) well inside 2000 x 2000 px."""
    while True:
        focal = 1000 / np.tan(np.radians(rng.uniform(5, 35)))
        xyz = rng.uniform(-1, 1, (4, 3)) * [1, 1, flatness]
        distance = focal / 1000 * rng.uniform(1.1, 4)
        pose = Pose(exp_so3(rng.normal(size=3) * 3), np.array([*rng.uniform(-0.2, 0.2, 2) * distance, distance]))
        cam = pose.apply(xyz)
        if cam[:, 2].min() > 0.1 and np.abs(focal * cam[:, :2] / cam[:, 2:]).max() < 1200:
            return focal, pose, xyz, focal * cam[:, :2] / cam[:, 2:]
