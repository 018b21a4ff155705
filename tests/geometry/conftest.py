"""Cameras and triangles shared by the tests of the geometry."""

from __future__ import annotations

import numpy as np
import pytest

from windmark.geometry import Camera
from windmark.geometry.rotations import exp_so3

CAMERAS = {
    "pinhole": Camera((640, 480), 500.0),
    "off-centre": Camera((1000, 700), 1234.0, 1.02, 480.0, 360.0),
    "barrel": Camera((2000, 1500), 1500.0, k1=-0.25, k2=0.08, p1=1e-3, p2=-7e-4),
    "strong barrel": Camera((1200, 900), 600.0, k1=-0.32, k2=0.11, k3=-0.015),
    "pincushion": Camera((3004, 2000), 3070.0, 0.998, 1510.2, 990.7, 0.12, -0.05, -4e-4, 6e-4, 0.02),
    "tilted": Camera((1280, 1024), 2400.0, k1=-0.1, p1=5e-4, tilt_x=0.12, tilt_y=-0.2),
    "sheared": Camera((1280, 1024), 1900.0, 0.97, 650.0, 500.0, k1=-0.1, p2=5e-4, tilt_x=-0.05, tilt_y=0.1, shear=0.03),
    "rational": Camera((1000, 800), 700.0, 1.01, k1=0.3, k2=-0.1, p1=1e-3, p2=-5e-4, k3=0.02, tilt_x=0.05, k4=0.5,
                       k5=-0.05, k6=0.01, lens="rational"),
}  # fmt: skip


@pytest.fixture(params=CAMERAS.values(), ids=CAMERAS.keys())
def camera(request):
    """Each of the test cameras."""
    return request.param


FISHEYE = Camera((1600, 1200), 520.0, 0.99, 790.0, 610.0, -0.03, 0.012, k3=-0.004, k4=6e-4, tilt_y=0.04, lens="fisheye")


@pytest.fixture(params=[*CAMERAS.values(), FISHEYE], ids=[*CAMERAS.keys(), "fisheye"])
def any_camera(request):
    """Each of the test cameras, and one that sees behind itself."""
    return request.param


def _random(rng, n):
    """Points seen in a field of view of 90 degrees, depths from 0.1 to 10."""
    return np.concatenate([rng.uniform(-1, 1, (n, 3, 2)), np.ones((n, 3, 1))], -1) * _log(rng, (n, 3, 1), -1, 1)


def _log(rng, shape, low, high):
    return 10 ** rng.uniform(low, high, shape)


def _flat(rng, n):
    """The third corner close to the line of the others."""
    c = _random(rng, n)
    foot = c[:, 0] + rng.uniform(-1, 2, (n, 1)) * (c[:, 1] - c[:, 0])
    c[:, 2] = foot + (c[:, 2] - foot) * _log(rng, (n, 1), -7, -1)
    return c


def _short_edge(rng, n):
    """Two corners close together: a small interior angle."""
    c = _random(rng, n)
    c[:, 2] = c[:, 0] + (c[:, 2] - c[:, 0]) * _log(rng, (n, 1), -6, -1)
    return c


def _long_lens(rng, n):
    """Rays within 1e-1 to 1e-5 radians."""
    direction = np.concatenate([rng.uniform(-0.5, 0.5, (n, 2)), np.ones((n, 1))], -1)
    return rng.normal(size=(n, 3, 3)) + direction[:, None] / _log(rng, (n, 1, 1), -5, -1)


def _danger(rng, n):
    """Camera near the cylinder through the corners, where two solutions meet; corners on a unit circle."""
    a, b = rng.uniform(0, 2 * np.pi, (n, 3)), rng.uniform(0, 2 * np.pi, n)
    radius = 1 + _log(rng, n, -12, -1) * rng.choice([-1, 1], n)
    camera = np.stack([radius * np.cos(b), radius * np.sin(b), rng.uniform(0.3, 4, n)], -1)
    v = np.stack([np.cos(a), np.sin(a), np.zeros_like(a)], -1) - camera[:, None]
    z = v.mean(axis=1)
    x = np.cross(z, rng.normal(size=(n, 3)))
    y = np.cross(z, x)
    frame = np.stack([e / np.linalg.norm(e, axis=1, keepdims=True) for e in (x, y, z)], axis=1)
    return v @ np.swapaxes(frame, 1, 2)


def _edge_on(rng, n):
    """Rays close to one plane: the camera in the plane of the triangle."""
    c = _random(rng, n)
    inside = rng.uniform(0.2, 1.5, (n, 1)) * c[:, 0] + rng.uniform(0.2, 1.5, (n, 1)) * c[:, 1]
    c[:, 2] = inside + (c[:, 2] - inside) * _log(rng, (n, 1), -9, -1)
    return c


def _symmetric(rng, n):
    """Equilateral and isosceles triangles seen along an axis of symmetry."""
    a = np.array([0, 2 * np.pi / 3, 4 * np.pi / 3])
    c = np.stack([np.cos(a), np.sin(a), 0 * a], -1) * rng.uniform(0.2, 1, (n, 1, 1))
    kind = rng.integers(0, 3, n)
    c[kind == 1, :, 1] *= 2
    c[kind == 2] = [[0.5, 0.25, 0], [-0.5, 0.25, 0], [0, -0.75, 0.5]]
    c[:, :, 2] += rng.uniform(1, 10, (n, 1))
    return c


KINDS = {f.__name__[1:]: f for f in (_random, _flat, _short_edge, _long_lens, _danger, _edge_on, _symmetric)}


@pytest.fixture
def triangles():
    """Factory ``triangles(kind, n, seed) -> rays, xyz, rotation, translation`` of problems with a known pose."""

    def make(kind, n, seed=1):
        rng = np.random.default_rng(seed)
        cam = KINDS[kind](rng, n)
        rotation = exp_so3(rng.normal(size=(n, 3)) * 2)
        center = cam.mean(axis=1, keepdims=True)
        size = np.linalg.norm(cam - center, axis=-1).max(axis=1)
        xyz = (cam - center) @ rotation + (rng.normal(size=(n, 3)) * size[:, None])[:, None]
        translation = center[:, 0] - (rotation @ xyz.mean(axis=1)[..., None])[..., 0]
        return cam / np.linalg.norm(cam, axis=-1, keepdims=True), xyz, rotation, translation

    return make
