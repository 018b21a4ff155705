"""Surfaces and a paint for the tests of the room."""

from __future__ import annotations

import numpy as np

from windmark.paint import SternVolmer
from windmark.scene import Mesh, structured_triangles


def plate(nx=21, ny=17, size=(4.0, 3.0)):
    """A flat plate in z = 0, normal +z, centred on the origin."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, nx) * size[0], np.linspace(-0.5, 0.5, ny) * size[1])
    return Mesh.make(np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1), structured_triangles(nx, ny))


def box(n=5, half=(1.0, 1.0, 1.0), names=False):
    """A closed box of six blocks that share no node, normals outward; each a volume of its own where asked."""
    s = np.linspace(-1.0, 1.0, n)
    a, b = (g.ravel() for g in np.meshgrid(s, s))
    vertices, triangles, volume = [], [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            xyz = np.empty((n * n, 3))
            xyz[:, axis], xyz[:, (axis + 1) % 3], xyz[:, (axis + 2) % 3] = side, a, b
            triangles.append(structured_triangles(n, n, first=len(vertices) * n * n, reverse=side < 0))
            volume += [f"{'xyz'[axis]}{'+' if side > 0 else '-'}" if names else "box"] * len(triangles[-1])
            vertices.append(xyz)
    return Mesh.make(np.concatenate(vertices) * half, np.concatenate(triangles), np.array(volume))


def sphere(n=60, radius=1.0):
    """A globe of n meridians, normals outward."""
    lon, lat = np.meshgrid(np.linspace(0, 2 * np.pi, n + 1), np.linspace(-np.pi / 2, np.pi / 2, n // 2 + 1))
    xyz = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1).reshape(-1, 3)
    xyz[: n + 1], xyz[-n - 1 :] = [0, 0, -1], [0, 0, 1]
    return Mesh.make(xyz * radius, structured_triangles(n + 1, n // 2 + 1))


def paint(cov=None):
    """A paint of second order with a temperature coefficient of about 1 % per K."""
    a = np.array([[0.16, 1e-3], [0.75, 8e-3], [0.09, 1e-3]])
    return SternVolmer(a, 101325.0, 293.15, (10e3, 160e3), (270.0, 325.0), cov)


def corner(n=21):
    """Two unit squares at a right angle: a floor in z = 0 and a wall in x = 0, of one edge, with nodes of their own."""
    a, b = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n)))
    z, t = np.zeros_like(a), structured_triangles(n, n)
    xyz = np.concatenate([np.stack([a, b, z], axis=1), np.stack([z, a, b], axis=1)])
    return Mesh.make(xyz, np.concatenate([t, t + n * n]))
