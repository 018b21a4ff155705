"""Numba kernels of the ray caster: binning of rays, first hits.

Everything happens in the ideal image plane of the camera (u = X/Z, v = Y/Z), where the lens has
no say: triangles have straight edges there whatever the distortion, and a ray is a point.
Readable twin: `brute_first_hits` in tests/resection/resection_shapes.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Ints = NDArray[np.int32]
Floats3 = tuple[float, float, float]

# Rays this close to an edge (relative to the size of the products that are subtracted) count as
# on it, so that no ray slips through a vertex or a seam by rounding.
_SLACK = 4e-15
# Depths this near to each other (relative) are one place.
_TIE = 1e-12


@nb.njit(cache=True, nogil=True)
def ray_box(rays: Array) -> tuple[int, float, float, float, float]:
    """Number of rays that are not NaN, and the smallest and largest u and v among them."""
    count, u0, v0, u1, v1 = 0, math.inf, math.inf, -math.inf, -math.inf
    for n in range(rays.shape[0]):
        u, v = rays[n, 0], rays[n, 1]
        if math.isfinite(u + v):
            count += 1
            u0, v0, u1, v1 = min(u0, u), min(v0, v), max(u1, u), max(v1, v)
    return count, u0, v0, u1, v1


@nb.njit(cache=True, nogil=True)
def bin_rays(rays: Array, grid: Array, columns: int, start: NDArray[np.int64], order: NDArray[np.int64],
             sorted_rays: Array) -> None:  # fmt: skip
    """Counting sort of the rays (N, 2) by cell of a grid over the ideal plane, row after row; NaN rays are left out.

    ``grid`` holds u0, v0 and cells per unit of u and v; ``start`` (cells + 1) begins as zeros.
    """
    for n in range(rays.shape[0]):
        if math.isfinite(rays[n, 0] + rays[n, 1]):
            start[_cell(rays[n, 0], rays[n, 1], grid, columns, start.size - 1) + 1] += 1
    for k in range(1, start.size):
        start[k] += start[k - 1]
    # `start` serves as the write position and is shifted back afterwards.
    for n in range(rays.shape[0]):
        if not math.isfinite(rays[n, 0] + rays[n, 1]):
            continue
        k = _cell(rays[n, 0], rays[n, 1], grid, columns, start.size - 1)
        place = start[k]
        start[k] = place + 1
        order[place] = n
        sorted_rays[place, 0] = rays[n, 0]
        sorted_rays[place, 1] = rays[n, 1]
    for k in range(start.size - 1, 0, -1):
        start[k] = start[k - 1]
    start[0] = 0


@nb.njit(cache=True, nogil=True, inline="always")
def _cell(u: float, v: float, grid: Array, columns: int, cells: int) -> int:
    row = _clamped((v - grid[1]) * grid[3], cells // columns - 1)
    return row * columns + _clamped((u - grid[0]) * grid[2], columns - 1)


@nb.njit(cache=True, nogil=True)
def _clamped(position: float, last: int) -> int:
    """Cell number of a position, kept within 0..last (in floating point: positions may be infinite)."""
    if not position > 0.0:
        return 0
    if position >= last:
        return last
    return int(position)


@nb.njit(cache=True, nogil=True)
def first_hits(cam: Array, triangles: Ints, rays: Array, order: NDArray[np.int64], grid: Array, columns: int,
               start: NDArray[np.int64], cull: bool, depth: Array, triangle: Ints, weights: Array) -> None:  # fmt: skip
    """The nearest triangle on each ray: an irregular z-buffer (Johnson et al., ACM TOG 24, 2005).

    Triangles in homogeneous edge functions need no clipping at the camera plane (Olano and Greer,
    Graphics Hardware 1997): with e = B x C and so on, ray (u, v, 1) meets the triangle in front of
    the camera where all three e . ray have the sign of det(A, B, C).

    Parameters
    ----------
    cam : (V, 3) vertices in the camera frame
    rays, order : (N, 2) and (N,), binned by `bin_rays` with ``grid``, ``columns`` and ``start``
    cull : leave out triangles that turn their back
    depth : (N,) binned, started as inf
    triangle, weights : (N,) started as -1, (N, 2) of the second and third vertex; in the rays' own order
    """
    rows = (start.size - 1) // columns
    for t in range(triangles.shape[0]):
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        a = (cam[i, 0], cam[i, 1], cam[i, 2])
        b = (cam[j, 0], cam[j, 1], cam[j, 2])
        c = (cam[k, 0], cam[k, 1], cam[k, 2])
        r0, r1, c0, c1 = _cells_of(a, b, c, grid, rows, columns)
        if r1 < r0:
            continue
        ea = _cross(b, c)
        det = a[0] * ea[0] + a[1] * ea[1] + a[2] * ea[2]
        faces = det < 0.0
        if not (det > 0.0 or det < 0.0) or (cull and det > 0.0):
            continue
        eb, ec = _cross(c, a), _cross(a, b)
        if det < 0.0:
            ea, eb, ec = (-ea[0], -ea[1], -ea[2]), (-eb[0], -eb[1], -eb[2]), (-ec[0], -ec[1], -ec[2])
        na, nb_, nc = _size(a), _size(b), _size(c)
        slack = (_SLACK * nb_ * nc, _SLACK * nc * na, _SLACK * na * nb_)
        for row in range(r0, r1 + 1):
            first, last = c0, c1
            if c1 - c0 > 3:
                first, last = _columns_of(ea, eb, ec, slack, grid, row, c0, c1)
            for n in range(start[row * columns + first], start[row * columns + last + 1]):
                u, v = rays[n, 0], rays[n, 1]
                wa = ea[0] * u + ea[1] * v + ea[2]
                wb = eb[0] * u + eb[1] * v + eb[2]
                wc = ec[0] * u + ec[1] * v + ec[2]
                if wa < -slack[0] or wb < -slack[1] or wc < -slack[2] or not wa + wb + wc > 0.0:
                    continue
                wb, wc = _inside(wa, wb, wc)
                z = a[2] + wb * (b[2] - a[2]) + wc * (c[2] - a[2])
                nearer = z < depth[n]
                if abs(z - depth[n]) <= _TIE * z:
                    # Of two at one place, the sides of a part without thickness, the one that faces the camera is met.
                    o = triangle[order[n]]
                    p, q, r = triangles[o, 0], triangles[o, 1], triangles[o, 2]
                    e = _cross((cam[q, 0], cam[q, 1], cam[q, 2]), (cam[r, 0], cam[r, 1], cam[r, 2]))
                    if faces != (cam[p, 0] * e[0] + cam[p, 1] * e[1] + cam[p, 2] * e[2] < 0.0):
                        nearer = faces
                if z > 0.0 and nearer:
                    depth[n] = z
                    triangle[order[n]] = t
                    weights[order[n], 0] = wb
                    weights[order[n], 1] = wc


@nb.njit(cache=True, nogil=True)
def _cells_of(a: Floats3, b: Floats3, c: Floats3, grid: Array, rows: int, columns: int) -> tuple[int, int, int, int]:
    """Cells that a triangle may touch: rows and columns, first and last; last row < first where it touches none."""
    if not (a[2] > 0.0 and b[2] > 0.0 and c[2] > 0.0):
        if a[2] > 0.0 or b[2] > 0.0 or c[2] > 0.0:
            return 0, rows - 1, 0, columns - 1  # it crosses the camera plane: unbounded, the edges decide
        return 0, -1, 0, -1
    ua, ub, uc = a[0] / a[2], b[0] / b[2], c[0] / c[2]
    low, high = (min(ua, ub, uc) - grid[0]) * grid[2], (max(ua, ub, uc) - grid[0]) * grid[2]
    if high < -1e-6 or low > columns:
        return 0, -1, 0, -1
    c0, c1 = _clamped(low - 1e-9, columns - 1), _clamped(high + 1e-9, columns - 1)
    va, vb, vc = a[1] / a[2], b[1] / b[2], c[1] / c[2]
    low, high = (min(va, vb, vc) - grid[1]) * grid[3], (max(va, vb, vc) - grid[1]) * grid[3]
    if high < -1e-6 or low > rows:
        return 0, -1, 0, -1
    return _clamped(low - 1e-9, rows - 1), _clamped(high + 1e-9, rows - 1), c0, c1


@nb.njit(cache=True, nogil=True)
def _columns_of(ea: Floats3, eb: Floats3, ec: Floats3, slack: Floats3, grid: Array, row: int, c0: int, c1: int
                ) -> tuple[int, int]:  # fmt: skip
    """Columns c0..c1 narrowed to those where all edge functions can be positive within one row of cells.

    An oblique sliver then costs its own cells and not those of its bounding box.
    """
    v0 = grid[1] + (row - 1e-6) / grid[3]
    v1 = grid[1] + (row + 1 + 1e-6) / grid[3]
    low, high = -math.inf, math.inf
    for m in range(3):
        e = ea if m == 0 else (eb if m == 1 else ec)
        best = max(e[1] * v0, e[1] * v1) + e[2] + 2.0 * slack[m]
        if e[0] > 0.0:
            low = max(low, -best / e[0])
        elif e[0] < 0.0:
            high = min(high, -best / e[0])
        elif best < 0.0:
            return 1, -1
    low, high = (low - grid[0]) * grid[2] - 1e-6, (high - grid[0]) * grid[2] + 1e-6
    if low > high or high < c0 or low > c1 + 1:
        return 1, -1
    return max(c0, _clamped(low, c1)), min(c1, _clamped(high, c1))


@nb.njit(cache=True, nogil=True)
def _inside(wa: float, wb: float, wc: float) -> tuple[float, float]:
    """Weights of the second and third vertex, within the triangle (slack may put them outside by rounding)."""
    wa, wb, wc = max(wa, 0.0), max(wb, 0.0), max(wc, 0.0)
    total = wa + wb + wc
    return wb / total, wc / total


@nb.njit(cache=True, nogil=True)
def _cross(a: Floats3, b: Floats3) -> Floats3:
    # cross(a, b) and cross(b, a) are exact negatives: neighbours agree on their common edge.
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@nb.njit(cache=True, nogil=True)
def _size(a: Floats3) -> float:
    return abs(a[0]) + abs(a[1]) + abs(a[2])
