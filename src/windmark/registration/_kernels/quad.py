"""Local quads: four neighbouring markers, four neighbouring spots, and a key that both share.

Private to the registration room. Seen from afar, four markers are mapped to the image by an affine map, so the
barycentric coordinates of one (the anchor) in the triangle of the other three are the same in the image, whatever
the roll, the scale and, for markers in a plane, the direction. The anchor is the one whose opposite triangle is the
largest, so the coordinates lie between -1 and 1; they are the key. The model's keys, from all sides and with some
perspective, are tabled once; four spots look theirs up. Readable twin: tests/registration/test_quads.py.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.registration._kernels.hypothesis import Model

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

CELLS = 40
"""Cells of the table along each of the two coordinates."""
REACH = 1.1
"""The table holds coordinates from -REACH to REACH; beyond 1 another corner is the anchor, but for noise."""
BLUR = 0.02
"""Every key of the model is entered this far round it: noise, and directions between the tabled ones."""
FACING = 0.2
"""Cosine of the angle of view from which a marker counts for the table."""
TIES = 4
"""Most neighbours taken beyond the wanted number, because they are as far as the last one."""
FLATTEST = 0.04
"""Area of a triangle, in units of its longest edge squared, below which a quad tells nothing."""


class Table(NamedTuple):
    """Quads of markers by key: those of cell c are number ``entry[first[c]:first[c + 1]]``."""

    first: Ints  # (CELLS^2 + 1,)
    entry: Ints  # (E,)
    quad: Ints  # (Q, 4) anchor and the triangle's corners in the order in which the image shows them, clockwise
    shape: Array  # (Q, 8) what a link asks of them, see `shape_of`


@nb.njit(cache=True, nogil=True, inline="always")
def cell_of(u: float, v: float) -> int:
    """Cell of a key; -1 outside of the table."""
    k = CELLS / (2.0 * REACH)
    i, j = int((u + REACH) * k), int((v + REACH) * k)
    if u < -REACH or v < -REACH or i >= CELLS or j >= CELLS:
        return -1
    return i * CELLS + j


@nb.njit(cache=True, nogil=True, error_model="numpy")
def barycentric(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float
) -> tuple[float, float, float]:
    """Coordinates of a along b and c in the triangle b, c, d, and twice the triangle's area (positive: clockwise)."""
    bx, by, cx, cy, dx, dy = bx - ax, by - ay, cx - ax, cy - ay, dx - ax, dy - ay
    u, v, w = cx * dy - cy * dx, dx * by - dy * bx, bx * cy - by * cx
    area = u + v + w
    return u / area, v / area, area


def table_of(model: Model, reach: int, directions: Array) -> Table:
    """Table of all quads of a marker and three of its ``reach`` nearest ones (a few more where they are as far).

    ``directions`` (D, 3) lead from the model to the cameras, unit; at most 64.
    """
    xyz, normal = model.xyz, model.normal
    # Camera axes: x right, y down, z away from the camera's place; any roll.
    aside = np.where(np.abs(directions[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    right = np.cross(aside, directions)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    views = np.stack([right @ xyz.T, -np.cross(directions, right) @ xyz.T], axis=-1)
    faces = (normal @ directions.T > FACING) | (normal == 0.0).all(axis=1, keepdims=True)
    facing = (faces * 2 ** np.arange(len(directions), dtype=np.uint64)).sum(axis=1, dtype=np.uint64)
    return Table(*table_kernel(xyz, model.near, reach, views, facing))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def table_kernel(
    xyz: Array, near: Ints, reach: int, views: Array, facing: NDArray[np.uint64]
) -> tuple[Ints, Ints, Ints, Array]:  # fmt: skip
    """The parts of the table.

    Parameters
    ----------
    xyz, near : as in `Model`, scaled to unit size
    views : (D, N, 2) the markers as they are seen from afar
    facing : (N,) a bit for each view in which the marker is seen
    """
    n, room = xyz.shape[0], 64 * xyz.shape[0] * reach
    cell, number, quad = np.empty(room, np.int32), np.empty(room, np.int32), np.empty((room, 4), np.int32)
    stamp = np.full(6 * CELLS * CELLS, -1, np.int32)
    used, serial, quads = 0, 0, 0
    for a in range(n):
        around = _around(xyz, near, a, reach)
        for i in range(around - 2):
            for j in range(i + 1, around - 1):
                for k in range(j + 1, around):
                    b, c, d = near[a, i], near[a, j], near[a, k]
                    seen = facing[a] & facing[b] & facing[c] & facing[d]
                    step = _step(xyz, a, b, c, d)
                    if seen == 0 or step == 0:
                        continue
                    if used + 6 * CELLS * CELLS > cell.shape[0]:
                        cell = np.concatenate((cell, np.empty_like(cell)))
                        number = np.concatenate((number, np.empty_like(number)))
                    if quads + 6 > quad.shape[0]:
                        quad = np.concatenate((quad, np.empty_like(quad)))
                    used, quads = _enter(
                        a, b, c, d, views, seen, step, stamp, serial, cell, number, used, quad, quads
                    )  # fmt: skip
                    serial += 1
    first, entry = np.zeros(CELLS * CELLS + 1, np.int32), np.empty(used, np.int32)
    for e in range(used):
        first[cell[e] + 1] += 1
    first = np.cumsum(first).astype(np.int32)
    at = first[:-1].copy()
    for e in range(used):
        entry[at[cell[e]]] = number[e]
        at[cell[e]] += 1
    shape = np.empty((quads, 8))
    for q in range(quads):
        shape[q] = shape_of(xyz, quad[q, 0], quad[q, 1], quad[q, 2], quad[q, 3])
    return first, entry, quad[:quads].copy(), shape


@nb.njit(cache=True, nogil=True, error_model="numpy")
def shape_of(
    xyz: Array, i: int, j: int, k: int, m: int
) -> tuple[float, float, float, float, float, float, float, float]:
    """What `match.fits` asks of the four markers, whatever the picture.

    Products of the edges e1 and e2 from j to k and m: (e1.e1, e1.e2, e2.e2), their determinant, one by that; and the
    anchor i from j as alpha e1 + gamma e2 + height (e1 cross e2).
    """
    ox, oy, oz = xyz[j, 0], xyz[j, 1], xyz[j, 2]
    e1x, e1y, e1z = xyz[k, 0] - ox, xyz[k, 1] - oy, xyz[k, 2] - oz
    e2x, e2y, e2z = xyz[m, 0] - ox, xyz[m, 1] - oy, xyz[m, 2] - oz
    e3x, e3y, e3z = xyz[i, 0] - ox, xyz[i, 1] - oy, xyz[i, 2] - oz
    g11, g12 = e1x * e1x + e1y * e1y + e1z * e1z, e1x * e2x + e1y * e2y + e1z * e2z
    g22 = e2x * e2x + e2y * e2y + e2z * e2z
    h1, h2 = e1x * e3x + e1y * e3y + e1z * e3z, e2x * e3x + e2y * e3y + e2z * e3z
    det = g11 * g22 - g12 * g12
    per = 1.0 / det
    alpha, gamma = (h1 * g22 - h2 * g12) * per, (h2 * g11 - h1 * g12) * per
    height = ((e1y * e2z - e1z * e2y) * e3x + (e1z * e2x - e1x * e2z) * e3y + (e1x * e2y - e1y * e2x) * e3z) * per
    return g11, g12, g22, det, per, alpha, gamma, height


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _around(xyz: Array, near: Ints, a: int, reach: int) -> int:
    """Number of neighbours to take: ``reach``, and those about as far as the last one.

    Else chance would choose among the equally far ones of a regular layout, and the table would hold one of two
    equally good answers.
    """
    count, limit2 = 0, 0.0
    for k in range(min(near.shape[1], reach + TIES)):
        m = near[a, k]
        d2 = (xyz[m, 0] - xyz[a, 0]) ** 2 + (xyz[m, 1] - xyz[a, 1]) ** 2 + (xyz[m, 2] - xyz[a, 2]) ** 2
        if k < reach:
            limit2 = 1.02 * d2
        elif d2 > limit2:
            break
        count += 1
    return count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _step(xyz: Array, a: int, b: int, c: int, d: int) -> int:
    """Every how many-th direction four markers need: the flatter the fewer; 0 where a is never the anchor."""
    e1x, e1y, e1z = xyz[c, 0] - xyz[b, 0], xyz[c, 1] - xyz[b, 1], xyz[c, 2] - xyz[b, 2]
    e2x, e2y, e2z = xyz[d, 0] - xyz[b, 0], xyz[d, 1] - xyz[b, 1], xyz[d, 2] - xyz[b, 2]
    e3x, e3y, e3z = xyz[a, 0] - xyz[b, 0], xyz[a, 1] - xyz[b, 1], xyz[a, 2] - xyz[b, 2]
    nx, ny, nz = e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x
    det = nx * nx + ny * ny + nz * nz
    g11, g12, g22 = e1x * e1x + e1y * e1y + e1z * e1z, e1x * e2x + e1y * e2y + e1z * e2z, e2x**2 + e2y**2 + e2z**2
    longest = max(g11, g22, g11 + g22 - 2.0 * g12)
    if det < (2.0 * FLATTEST * longest) ** 2:
        return 0
    height2 = (nx * e3x + ny * e3y + nz * e3z) ** 2 / (det * longest)
    if height2 > 0.06**2:
        return 1
    h1, h2 = e1x * e3x + e1y * e3y + e1z * e3z, e2x * e3x + e2y * e3y + e2z * e3z
    u, v = (h1 * g22 - h2 * g12) / det, (h2 * g11 - h1 * g12) / det
    # Three times the height is what it can shift the anchor at the steepest view.
    reach = REACH + 3.0 * math.sqrt(height2 * longest * longest / det)
    if abs(u) > reach or abs(v) > reach or abs(1.0 - u - v) > reach:
        return 0
    return 3 if height2 > 0.02**2 else 7


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _enter(
    a: int, b: int, c: int, d: int, views: Array, seen: int, step: int, stamp: Ints, serial: int,
    cell: Ints, number: Ints, used: int, quad: Ints, quads: int,
) -> tuple[int, int]:  # fmt: skip
    """Enter one quad into the cells of all its keys, each once; the numbers of entries and of quads used so far."""
    size, mine = CELLS * CELLS, np.full(6, -1, np.int32)
    k = CELLS / (2.0 * REACH)
    for view in range(0, views.shape[0], step):
        if (seen >> np.uint64(view)) & np.uint64(1) == 0:
            continue
        p = views[view]
        u, v, area = barycentric(
            p[a, 0], p[a, 1], p[b, 0], p[b, 1], p[c, 0], p[c, 1], p[d, 0], p[d, 1]
        )  # fmt: skip
        w = 1.0 - u - v
        if not (abs(u) < REACH and abs(v) < REACH and abs(w) < REACH):
            continue
        turned = area < 0.0
        for r in range(3):
            # The three ways to begin the triangle, in the order in which it is seen clockwise.
            if turned:
                x, y = ((u, w), (w, v), (v, u))[r]
                q = ((b, d, c), (d, c, b), (c, b, d))[r]
            else:
                x, y = ((u, v), (v, w), (w, u))[r]
                q = ((b, c, d), (c, d, b), (d, b, c))[r]
            kind = (3 if turned else 0) + r
            for i in range(int((x - BLUR + REACH) * k), int((x + BLUR + REACH) * k) + 1):
                for j in range(int((y - BLUR + REACH) * k), int((y + BLUR + REACH) * k) + 1):
                    if i < 0 or j < 0 or i >= CELLS or j >= CELLS:
                        continue
                    at = i * CELLS + j
                    if stamp[kind * size + at] == serial:
                        continue
                    stamp[kind * size + at] = serial
                    if mine[kind] < 0:
                        mine[kind] = quads
                        quad[quads, 0], quad[quads, 1], quad[quads, 2], quad[quads, 3] = a, q[0], q[1], q[2]
                        quads += 1
                    cell[used], number[used] = at, mine[kind]
                    used += 1
    return used, quads


@nb.njit(cache=True, nogil=True, error_model="numpy")
def spot_quads_kernel(p: Array, near: Ints, low: int, high: int, first: Ints) -> tuple[Ints, Ints]:
    """Quads of a spot and three of its ``high`` nearest ones, not all among the ``low`` nearest, rarest key first.

    Returns
    -------
    (Q, 4) spots and (Q,) cells; quads whose cell is empty are left out.
    """
    n = p.shape[0]
    room = n * (high * (high - 1) * (high - 2) // 6)
    quad, cell = np.empty((room, 4), np.int32), np.empty(room, np.int32)
    used = 0
    for a in range(n):
        for k in range(max(low, 2), high):
            for i in range(k - 1):
                for j in range(i + 1, k):
                    b, c, d = near[a, i], near[a, j], near[a, k]
                    u, v, area = barycentric(
                        p[a, 0], p[a, 1], p[b, 0], p[b, 1], p[c, 0], p[c, 1], p[d, 0], p[d, 1]
                    )  # fmt: skip
                    w = 1.0 - u - v
                    if not (abs(u) <= 1.0 and abs(v) <= 1.0 and abs(w) <= 1.0):
                        continue
                    longest2 = max(
                        (p[b, 0] - p[c, 0]) ** 2 + (p[b, 1] - p[c, 1]) ** 2,
                        (p[c, 0] - p[d, 0]) ** 2 + (p[c, 1] - p[d, 1]) ** 2,
                        (p[d, 0] - p[b, 0]) ** 2 + (p[d, 1] - p[b, 1]) ** 2,
                    )
                    if abs(area) < 2.0 * FLATTEST * longest2:
                        continue
                    if area < 0.0:
                        c, d, v = d, c, w
                    at = cell_of(u, v)
                    if at >= 0 and first[at + 1] > first[at]:
                        quad[used, 0], quad[used, 1], quad[used, 2], quad[used, 3] = a, b, c, d
                        cell[used] = at
                        used += 1
    count = np.empty(used, np.int32)
    for q in range(used):
        count[q] = first[cell[q] + 1] - first[cell[q]]
    order = np.argsort(count, kind="mergesort")
    return quad[:used][order], cell[:used][order]
