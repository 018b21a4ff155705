"""What else a disc could be: squares, crosses and rings of its size, tilt and blur. Private; arrays in, arrays out."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.geometry._jit import nb

TURNS = 8  # directions of squares and crosses, over 90 degrees
SQUARE = 0.88  # half side of the square that a unit disc takes for itself: of its area 0.886, of its moments 0.866
BARS = 0.35  # half width of a cross's bars
HOLE = 0.55  # radius of a ring's hole
SHAPES = 2 + 2 * TURNS  # disc, ring, squares, crosses
WINDOW = 1.8  # half axes of the window
SAMPLES = 5.0  # of the window's pixels per half axis are enough


@nb.njit(cache=True, nogil=True)
def _inside(distance: float, edge: float) -> float:
    return min(max(0.5 - distance / edge, 0.0), 1.0)


@nb.njit(cache=True, nogil=True)
def _covers(p: float, q: float, scales: Any, radial: float, edge: float, out: Any) -> None:
    """All shapes at a place of the unit disc's plane; `scales` (TURNS, 2) are pixels per unit along the bars."""
    r = math.sqrt(p * p + q * q)
    out[0] = _inside((r - 1.0) * radial, edge)
    out[1] = out[0] - _inside((r - HOLE) * radial, edge)
    for k in range(TURNS):
        t = 0.5 * math.pi * k / TURNS
        c, s = math.cos(t), math.sin(t)
        a, b = abs(c * p + s * q), abs(c * q - s * p)
        u, v = scales[k, 0], scales[k, 1]
        out[2 + k] = _inside((a - SQUARE) * u, edge) * _inside((b - SQUARE) * v, edge)
        one = _inside((a - BARS) * u, edge) * _inside((b - 1.1) * v, edge)
        two = _inside((a - 1.1) * u, edge) * _inside((b - BARS) * v, edge)
        out[2 + TURNS + k] = max(one, two)


@nb.njit(cache=True, nogil=True)
def misfits(g: Any, xy: Any, shape: Any, edges: Any, out: Any) -> None:
    """Sum of squares that plane and shape leave of a window, for each shape, and its number of pixels in the last.

    Parameters
    ----------
    g : (H, W) as in `_kernels.spot`; NaN is missing
    xy : (K, 2) centres
    shape : (K, 3) symmetric matrices xx, xy, yy that map the unit disc onto the ellipses
    edges : (K,) width of the shapes' edges in pixels
    out : (K, SHAPES + 1), NaN where half of the window is missing
    """
    cover, scales = np.empty(SHAPES + 4), np.empty((TURNS, 2))
    sums = np.empty((SHAPES + 4, SHAPES + 4))
    plane, left = np.empty((3, 3)), np.empty(3)
    for k in range(xy.shape[0]):
        out[k] = np.nan
        a, b, c = shape[k, 0], shape[k, 1], shape[k, 2]
        det = a * c - b * b
        ia, ib, ic = c / det, -b / det, a / det
        for m in range(TURNS):
            t = 0.5 * math.pi * m / TURNS
            n0, n1 = math.cos(t), math.sin(t)
            scales[m, 0] = 1.0 / math.hypot(ia * n0 + ib * n1, ib * n0 + ic * n1)
            scales[m, 1] = 1.0 / math.hypot(ib * n0 - ia * n1, ic * n0 - ib * n1)
        hx, hy = int(WINDOW * math.hypot(a, b)) + 1, int(WINDOW * math.hypot(b, c)) + 1
        step = max(1, int(math.sqrt(det) / SAMPLES))
        cx, cy = math.floor(xy[k, 0] + 0.5), math.floor(xy[k, 1] + 0.5)
        sums[:, :] = 0.0
        total, base = 0.0, math.nan
        for j in range(-(hy // step) * step, hy + 1, step):
            for i in range(-(hx // step) * step, hx + 1, step):
                u, v = cx + i - xy[k, 0], cy + j - xy[k, 1]
                p, q = ia * u + ib * v, ib * u + ic * v
                r = math.sqrt(p * p + q * q)
                if r > WINDOW:
                    continue
                total += 1.0
                if not (0 <= cy + j < g.shape[0] and 0 <= cx + i < g.shape[1]):
                    continue
                value = float(g[cy + j, cx + i])
                if value != value:
                    continue
                if base != base:
                    base = value
                radial = r / max(math.hypot(ia * p + ib * q, ib * p + ic * q), 1e-12)
                _covers(p, q, scales, radial, edges[k], cover)
                cover[SHAPES], cover[SHAPES + 1], cover[SHAPES + 2], cover[SHAPES + 3] = 1.0, p, q, value - base
                for m in range(SHAPES + 4):  # of pairs only those that are needed
                    for n in range(SHAPES, SHAPES + 4):
                        sums[m, n] += cover[m] * cover[n]
                    sums[m, m] += cover[m] * cover[m] if m < SHAPES else 0.0
        n = sums[SHAPES, SHAPES]
        if not (n >= 12.0 and 2.0 * n >= total):
            continue
        for i in range(3):
            for j in range(3):
                plane[i, j] = sums[SHAPES + i, SHAPES + j]
        if not abs(np.linalg.det(plane)) > 1e-9 * n**3:
            continue
        inverse = np.linalg.inv(plane)
        y = SHAPES + 3
        rest = sums[y, y] - _form(inverse, sums, y, y, left)
        for m in range(SHAPES):
            power = sums[m, m] - _form(inverse, sums, m, m, left)
            along = sums[m, y] - _form(inverse, sums, m, y, left)
            gain = along * along / power if power > 1e-6 * n and along < 0.0 else 0.0
            out[k, m] = rest - gain
        out[k, SHAPES] = n


@nb.njit(cache=True, nogil=True)
def _form(inverse: Any, sums: Any, i: int, j: int, left: Any) -> float:
    """What the plane explains of the product of two columns."""
    total = 0.0
    for a in range(3):
        left[a] = 0.0
        for b in range(3):
            left[a] += inverse[a, b] * sums[j, SHAPES + b] if j < SHAPES else inverse[a, b] * sums[SHAPES + b, j]
    for a in range(3):
        total += (sums[i, SHAPES + a] if i < SHAPES else sums[SHAPES + a, i]) * left[a]
    return total
