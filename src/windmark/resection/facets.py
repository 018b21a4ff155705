"""How far the curved surface that a grid stands for lies above its flat facets, by how their normals turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.resection.chains import weld
from windmark.scene import Mesh

Array = NDArray[np.float64]

CREASE = 0.87
"""Cosine between a facet's normal and that at its corner below which there is a crease: flat facets on both sides."""
TOGETHER = 1e-6
"""Nodes nearer than this part of the mesh's size are one place: blocks that meet, the seam of a ring."""


def bulge(mesh: Mesh, triangle: NDArray[np.int64], weights: Array) -> Array:
    """Height of the curved surface above the facets at places on them, along the facets' normals.

    Between two nodes of a chord the surface is a parabola whose ends have the nodes' normals: a circle's sagitta, the
    square of the chord over eight radii, at its middle.

    Parameters
    ----------
    triangle, weights : (N,) facets, (N, 2) weights of their second and third corner

    Returns
    -------
    (N,) in the mesh's unit, negative where the surface is hollow; 0 beside a crease
    """
    used = mesh.used
    number = np.zeros(len(mesh.vertices), np.int64)
    number[used] = weld(np.nan_to_num(mesh.vertices[used]), TOGETHER * mesh.size)[0]
    facet, total = _unit(mesh.triangle_normals()), np.zeros((number.max() + 1, 3))
    np.add.at(total, number[mesh.triangles], facet[:, None] * _angles(mesh)[..., None])
    corners, flat = mesh.triangles[triangle], facet[triangle]
    normal, place = _unit(total[number[corners]]), mesh.vertices[corners]
    w = np.column_stack([1 - weights.sum(axis=1), weights])
    out = np.zeros(len(triangle))
    for a, b in ((0, 1), (1, 2), (2, 0)):
        chord = place[:, b] - place[:, a]
        out += 0.5 * w[:, a] * w[:, b] * np.einsum("nk,nk->n", normal[:, b] - normal[:, a], chord)
    smooth = (np.einsum("nck,nk->nc", normal, flat) > CREASE).all(axis=1)
    return np.where(smooth, out, 0.0)


def _angles(mesh: Mesh) -> Array:
    """(T, 3) angle of each triangle at each of its corners: how a quad is cut in two does not change their sums."""
    corners = mesh.vertices[mesh.triangles]
    ahead = _unit(np.roll(corners, -1, axis=1) - corners)
    cosine = -np.einsum("tck,tck->tc", ahead, np.roll(ahead, 1, axis=1))
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
