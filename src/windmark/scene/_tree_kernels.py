"""Rays against a surface whose triangles are the leaves of a tree of boxes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@nb.njit(cache=True, nogil=True)
def is_blocked(ox: float, oy: float, oz: float, tx: float, ty: float, tz: float, own: int, boxes: Array, leaves: int,
               per_leaf: int, corners: Array, facet: Ints, least: Array) -> bool:  # fmt: skip
    """Whether a triangle of another facet than ``own`` lies between two points.

    Parameters
    ----------
    boxes : (2 leaves - 1, 6) of a complete binary tree, root first: lowest and highest x, y, z
    corners : (T, 9) of the triangles in the order of the leaves, ``per_leaf`` in each
    facet : (T,), in the same order
    least : (T,) by which the second point must be behind a triangle, across it, that hides it; (0,) for any
    """
    dx, dy, dz = tx - ox, ty - oy, tz - oz
    stack = np.empty(64, np.int64)
    stack[0], top = 0, 1
    while top > 0:
        top -= 1
        k = stack[top]
        low, high = 0.0, 1.0
        for axis in range(3):
            o, d = (ox, dx) if axis == 0 else ((oy, dy) if axis == 1 else (oz, dz))
            a, b = boxes[k, axis] - o, boxes[k, axis + 3] - o
            if abs(d) < 1e-300:
                if a > 0.0 or b < 0.0:
                    high = -1.0
            else:
                a, b = a / d, b / d
                low, high = max(low, min(a, b)), min(high, max(a, b))
        if low > high:
            continue
        if k < leaves - 1:
            stack[top], stack[top + 1] = 2 * k + 1, 2 * k + 2
            top += 2
            continue
        first = (k - leaves + 1) * per_leaf
        for t in range(first, min(first + per_leaf, corners.shape[0])):
            if facet[t] == own:
                continue
            # Moeller and Trumbore, J. Graphics Tools 2 (1997).
            ax, ay, az = corners[t, 0], corners[t, 1], corners[t, 2]
            ex, ey, ez = corners[t, 3] - ax, corners[t, 4] - ay, corners[t, 5] - az
            fx, fy, fz = corners[t, 6] - ax, corners[t, 7] - ay, corners[t, 8] - az
            px, py, pz = dy * fz - dz * fy, dz * fx - dx * fz, dx * fy - dy * fx
            det = ex * px + ey * py + ez * pz
            if det == 0.0:
                continue
            sx, sy, sz = ox - ax, oy - ay, oz - az
            u = (sx * px + sy * py + sz * pz) / det
            if u < 0.0 or u > 1.0:
                continue
            qx, qy, qz = sy * ez - sz * ey, sz * ex - sx * ez, sx * ey - sy * ex
            v = (dx * qx + dy * qy + dz * qz) / det
            if v < 0.0 or u + v > 1.0:
                continue
            s = (fx * qx + fy * qy + fz * qz) / det
            if 0.0 < s < 1.0 - 1e-6:
                if least.shape[0] == 0:
                    return True
                nx, ny, nz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
                off = (tx - ax) * nx + (ty - ay) * ny + (tz - az) * nz
                if abs(off) > least[t] * math.sqrt(nx * nx + ny * ny + nz * nz):
                    return True
    return False


@nb.njit(cache=True, nogil=True)
def all_blocked(eye: Array, points: Array, boxes: Array, leaves: int, per_leaf: int, corners: Array, facet: Ints,
                least: Array, out: NDArray[np.bool_]) -> None:  # fmt: skip
    """`is_blocked` from one point to many (N, 3)."""
    for k in range(points.shape[0]):
        out[k] = is_blocked(eye[0], eye[1], eye[2], points[k, 0], points[k, 1], points[k, 2], -1, boxes, leaves,
                            per_leaf, corners, facet, least)  # fmt: skip
