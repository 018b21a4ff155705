"""The edges of a grid that show its shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.scene import Mesh

SHARP_DEG = 35.0
"""Edges of the grid are drawn where its surface bends by more."""
MOST_EDGES = 60_000


def feature_edges(mesh: Mesh) -> NDArray[np.int64]:
    """(E, 2) nodes of the edges that show the surface's shape: borders, and where it bends by more than `SHARP_DEG`.

    Where there are too many (a scanned, rough surface), the sharpest.
    """
    t = np.asarray(mesh.triangles, dtype=np.int64)
    normal = mesh.triangle_normals()
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    ends = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1)
    owner = np.tile(np.arange(len(t)), 3)
    proper = (ends[:, 0] != ends[:, 1]) & (length[owner, 0] > 0)
    ends, owner = ends[proper], owner[proper]
    key = ends[:, 0] * np.int64(len(mesh.vertices)) + ends[:, 1]
    order = np.argsort(key, kind="stable")
    key, ends, owner = key[order], ends[order], owner[order]
    first = np.flatnonzero(np.append(True, np.diff(key) != 0)) if len(key) else np.zeros(0, dtype=int)
    count = np.diff(np.append(first, len(key)))
    bend = np.full(len(first), -1.0)  # a border, or three sheets that meet: always
    pairs = np.flatnonzero(count == 2)
    a, b = normal[owner[first[pairs]]], normal[owner[first[pairs] + 1]]
    bend[pairs] = np.abs(np.einsum("nk,nk->n", a, b))
    limit = float(np.cos(np.radians(SHARP_DEG)))
    kept: NDArray[np.intp] = np.flatnonzero(np.less(bend, limit))
    if len(kept) > MOST_EDGES:
        kept = np.sort(kept[np.argsort(bend[kept], kind="stable")[:MOST_EDGES]])
    return np.asarray(ends[first[kept]])
