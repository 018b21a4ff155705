"""What facets shine on what: form factors of facets seen from points."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.scene._tree_kernels import is_blocked

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

FAR = 4.0
"""Groups of triangles farther away than so many of their radii count as one place."""


@nb.njit(cache=True, nogil=True)
def triangle_factor(x: Array, n: Array, corner: Array, r2: float, clipped: Array) -> float:
    """Form factor of a triangle seen from a small surface at ``x`` with unit normal ``n``: Lambert's contour sum.

    0 where the triangle turns its back to ``x`` or has it in its plane (its own).

    Parameters
    ----------
    corner : (9,) of the triangle
    r2 : square of its distance, about
    clipped : (5, 3) working memory: the part of the triangle above the horizon, as seen from x
    """
    c = corner
    ux, uy, uz = c[3] - c[0], c[4] - c[1], c[5] - c[2]
    vx, vy, vz = c[6] - c[0], c[7] - c[1], c[8] - c[2]
    wx, wy, wz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    above = wx * (x[0] - c[0]) + wy * (x[1] - c[1]) + wz * (x[2] - c[2])
    if above <= 1e-9 * math.sqrt((wx * wx + wy * wy + wz * wz) * r2):
        return 0.0
    count = 0
    for k in range(3):
        a, b = 3 * k, 3 * ((k + 1) % 3)
        ha = (corner[a] - x[0]) * n[0] + (corner[a + 1] - x[1]) * n[1] + (corner[a + 2] - x[2]) * n[2]
        hb = (corner[b] - x[0]) * n[0] + (corner[b + 1] - x[1]) * n[1] + (corner[b + 2] - x[2]) * n[2]
        if ha >= 0.0:
            for axis in range(3):
                clipped[count, axis] = corner[a + axis] - x[axis]
            count += 1
        if (ha > 0.0 and hb < 0.0) or (ha < 0.0 and hb > 0.0):
            t = ha / (ha - hb)
            for axis in range(3):
                clipped[count, axis] = corner[a + axis] + t * (corner[b + axis] - corner[a + axis]) - x[axis]
            count += 1
    total = 0.0
    for k in range(count):
        m = (k + 1) % count
        ax, ay, az = clipped[k, 0], clipped[k, 1], clipped[k, 2]
        bx, by, bz = clipped[m, 0], clipped[m, 1], clipped[m, 2]
        cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        size = math.sqrt(cx * cx + cy * cy + cz * cz)
        if size > 0.0:
            angle = math.atan2(size, ax * bx + ay * by + az * bz)
            total += angle * (cx * n[0] + cy * n[1] + cz * n[2]) / size
    return abs(total) / (2.0 * math.pi)


@nb.njit(cache=True, nogil=True)
def gather(points: Array, normals: Array, lift: float, count: int, centre: Array, area: Array, radius: Array,
           ends: Ints, child: Ints, order: Ints, boxes: Array, leaves: int, per_leaf: int, corners: Array, facet: Ints,
           out: Array) -> None:  # fmt: skip
    """Form factors of facets seen from B points.

    Parameters
    ----------
    points, normals : (B, 3); NaN normals see nothing
    lift : by which rays begin above the surface
    count : J facets, the first of the G groups of triangles; each is halved down to a few triangles
    centre, area, radius : (G, 3) middle, (G, 3) sum of the area vectors, (G,) reach of each group
    ends, child : (G, 2) its triangles are ``order[ends[0]:ends[1]]``, numbers in ``corners``; (G,) the first of its two
        halves, -1 for none
    boxes, leaves, per_leaf, corners, facet : see `is_blocked`
    out : (B, J)
    """
    clipped, none = np.empty((5, 3)), np.empty(0)
    stack = np.empty(64, np.int64)
    for i in range(points.shape[0]):
        x, n = points[i], normals[i]
        for j in range(count):
            out[i, j] = 0.0
        if not (n[0] * n[0] + n[1] * n[1] + n[2] * n[2] > 0.0):
            continue
        ox, oy, oz = x[0] + lift * n[0], x[1] + lift * n[1], x[2] + lift * n[2]
        for j in range(count):
            stack[0], top = j, 1
            while top > 0:
                top -= 1
                g = stack[top]
                dx, dy, dz = centre[g, 0] - x[0], centre[g, 1] - x[1], centre[g, 2] - x[2]
                r2 = dx * dx + dy * dy + dz * dz
                here = dx * n[0] + dy * n[1] + dz * n[2]
                if here <= -radius[g]:
                    continue
                if r2 > FAR * FAR * radius[g] * radius[g]:
                    there = -(dx * area[g, 0] + dy * area[g, 1] + dz * area[g, 2])
                    if here > 0.0 and there > 0.0 and not is_blocked(
                        ox, oy, oz, centre[g, 0], centre[g, 1], centre[g, 2], j, boxes, leaves, per_leaf, corners,
                        facet, none
                    ):  # fmt: skip
                        out[i, j] += here * there / (math.pi * r2 * r2)
                    continue
                if child[g] >= 0:
                    stack[top], stack[top + 1] = child[g], child[g] + 1
                    top += 2
                    continue
                for m in range(ends[g, 0], ends[g, 1]):
                    c = corners[order[m]]
                    f = triangle_factor(x, n, c, r2, clipped)
                    if f > 0.0 and not is_blocked(
                        ox, oy, oz, (c[0] + c[3] + c[6]) / 3.0, (c[1] + c[4] + c[7]) / 3.0, (c[2] + c[5] + c[8]) / 3.0,
                        j, boxes, leaves, per_leaf, corners, facet, none
                    ):  # fmt: skip
                        out[i, j] += f
