"""A surface's triangles in a tree of boxes: what hides a point, without looking at every triangle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.scene.mesh import Mesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAF = 8
"""Triangles in a leaf."""


@dataclass(frozen=True, eq=False)
class TriangleTree:
    """A complete binary tree over L leaves.

    Triangles are in the order of their place along a Morton curve (Lauterbach et al., Computer Graphics Forum 28,
    2009), `LEAF` of them make a leaf.

    Parameters
    ----------
    boxes : (2 L - 1, 6) root first: lowest and highest x, y, z
    leaves : L
    corners : (T, 9) of the triangles in the order of the leaves
    order : (T,) which triangles they are
    """

    boxes: Array
    leaves: int
    corners: Array
    order: Ints

    @staticmethod
    def of(mesh: Mesh) -> TriangleTree:
        """The tree of a mesh with at least one triangle."""
        corner = mesh.vertices[mesh.triangles]
        middle = corner.mean(axis=1)
        low = middle.min(axis=0)
        span = np.maximum(middle.max(axis=0) - low, 1e-300)
        cell = np.minimum(((middle - low) / span * 1024).astype(np.int64), 1023)
        code = np.zeros(len(cell), np.int64)
        for bit in range(10):
            for axis in range(3):
                code |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
        order = np.argsort(code, kind="stable")
        used = -(-len(order) // LEAF)
        leaves = 1 << (used - 1).bit_length()
        boxes = np.concatenate([np.full((2 * leaves - 1, 3), np.inf), np.full((2 * leaves - 1, 3), -np.inf)], axis=1)
        start = np.arange(0, len(order), LEAF)
        boxes[leaves - 1 : leaves - 1 + used, :3] = np.minimum.reduceat(corner[order].min(axis=1), start)
        boxes[leaves - 1 : leaves - 1 + used, 3:] = np.maximum.reduceat(corner[order].max(axis=1), start)
        width = leaves
        while width > 1:
            width //= 2
            below = boxes[2 * width - 1 : 4 * width - 1]
            boxes[width - 1 : 2 * width - 1, :3] = np.minimum(below[0::2, :3], below[1::2, :3])
            boxes[width - 1 : 2 * width - 1, 3:] = np.maximum(below[0::2, 3:], below[1::2, 3:])
        boxes[boxes[:, 0] > boxes[:, 3], 3:] = np.inf  # nothing in it: infinitely far away, so that no ray meets it
        return TriangleTree(boxes, leaves, corner[order].reshape(-1, 9), order)

    def hides(self, eye: Array, points: Array, least: Array) -> NDArray[np.bool_]:
        """(N,) whether a triangle is before a point (N, 3), seen from ``eye`` (3,).

        ``least`` (T,), in the order of the leaves: how far a point must be behind a triangle to be hidden.
        """
        from windmark.scene._tree_kernels import all_blocked

        out = np.zeros(len(points), bool)
        xyz = np.ascontiguousarray(points, dtype=float)
        all_blocked(np.ascontiguousarray(eye, dtype=float), xyz, self.boxes, self.leaves, LEAF, self.corners,
                    self.order, least, out)  # fmt: skip
        return out
