"""SPOT at one place of an image: window, template, merit, bowl. Private; arrays in, arrays out.

`g` is always a float32 image in which a marker is a *hole* (dark), its mean grey level near 0; NaN pixels and
pixels outside the image have weight 0. Sums are float64. Sums may be reordered ("reassoc"): NaN never gets into them.
The readable twin is `fit_hole` in tests/detection/conftest.py.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.geometry._jit import nb

# Measured in tests/paper/test_spot.py: with these the bowl's centre has no visible pixel steps.
BOWL_EDGE_PX = 2.0  # edge width of the template that locates
MERIT_EDGE_PX = 1.0  # edge width of the template that judges: a top-hat seen through square pixels
MIN_WINDOW = 0.6  # share of the 2 r0 window that must be visible
SETTLED_PX = 1e-3
MAX_STEPS = 25


@nb.njit(cache=True, nogil=True, inline="always")
def soft_disc(radius: float, distance: float, edge: float) -> float:
    """Disc indicator with a linear edge of the given width: 1 inside, 0 outside, 1/2 on the radius."""
    return min(max((radius - distance) / edge + 0.5, 0.0), 1.0)


@nb.njit(cache=True, nogil=True)
def smallest(a: Any, n: int, k: int) -> Any:
    """The k-th smallest (from 0) of a[:n], which is reordered: none below it stands behind it (Hoare's selection)."""
    low, high = 0, n - 1
    while low < high:
        pivot, i, j = a[(low + high) // 2], low, high
        while i <= j:
            while a[i] < pivot:
                i += 1
            while pivot < a[j]:
                j -= 1
            if i <= j:
                a[i], a[j] = a[j], a[i]
                i, j = i + 1, j - 1
        if k <= j:
            high = j
        elif k >= i:
            low = i
        else:
            break
    return a[k]


@nb.njit(cache=True, nogil=True)
def grown(a: Any) -> Any:
    """A table (N, M) with room for as many rows again."""
    out = np.empty((2 * a.shape[0], a.shape[1]), a.dtype)
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            out[i, j] = a[i, j]
    return out


@nb.njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def plane_window(g: Any, x: float, y: float, r0: float, w: Any, e: Any, inv: Any) -> tuple[float, float]:
    """Take the slope (a + b x + c y) out of the disc of radius 2 r0 round (x, y).

    Fills the weights `w` and the weighted residuals `e` (patches centred on the pixel nearest to (x, y)) and
    `inv`, the six numbers of the inverse normal matrix. Returns the residual sum of squares and the visible
    share of the window; (-1, share) where the plane is not determined.
    """
    half = w.shape[0] // 2
    cx, cy = math.floor(x + 0.5), math.floor(y + 0.5)
    ox, oy = x - cx, y - cy
    w[:, :] = 0.0
    e[:, :] = 0.0
    n = sx = sy = sxx = sxy = syy = sg = sgx = sgy = 0.0
    i0, i1 = max(-half, -cx), min(half, g.shape[1] - 1 - cx)
    for j in range(max(-half, -cy), min(half, g.shape[0] - 1 - cy) + 1):
        row, wr, er = g[cy + j], w[j + half], e[j + half]
        rn = rx = rxx = rg = rgx = 0.0
        for i in range(i0, i1 + 1):
            v = float(row[cx + i])
            q = soft_disc(2.0 * r0, math.sqrt((i - ox) ** 2 + (j - oy) ** 2), MERIT_EDGE_PX)
            if v != v:
                q, v = 0.0, 0.0
            wr[i + half], er[i + half] = q, v
            rn += q
            rx += q * i
            rxx += q * i * i
            rg += q * v
            rgx += q * v * i
        n, sx, sy = n + rn, sx + rx, sy + j * rn
        sxx, sxy, syy = sxx + rxx, sxy + j * rx, syy + j * j * rn
        sg, sgx, sgy = sg + rg, sgx + rgx, sgy + j * rg
    share = n / (4.0 * math.pi * r0 * r0)
    c00, c01, c02 = sxx * syy - sxy * sxy, sxy * sy - sx * syy, sx * sxy - sxx * sy
    det = n * c00 + sx * c01 + sy * c02
    if not det > 1e-6 * n * sxx * syy:
        return -1.0, share
    inv[0], inv[1], inv[2] = c00 / det, c01 / det, c02 / det
    inv[3], inv[4], inv[5] = (n * syy - sy * sy) / det, (sx * sy - n * sxy) / det, (n * sxx - sx * sx) / det
    a = inv[0] * sg + inv[1] * sgx + inv[2] * sgy
    b = inv[1] * sg + inv[3] * sgx + inv[4] * sgy
    c = inv[2] * sg + inv[4] * sgx + inv[5] * sgy
    total = 0.0
    for j in range(w.shape[0]):
        wr, er = w[j], e[j]
        base = a + c * (j - half) - b * half
        for i in range(w.shape[1]):
            r = er[i] - base - b * i
            er[i] = wr[i] * r
            total += wr[i] * r * r
    return total, share


@nb.njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def match_hole(
    w: Any, e: Any, inv: Any, ox: float, oy: float, r0: float, edge: float
) -> tuple[float, float, float, float]:
    """Least-squares depth of a hole at (ox, oy) from the patch's centre pixel, on the slope-free window.

    Returns (depth, |t'|^2, |t|^2, visible share of the hole); t is the template, t' the template
    with its own slope taken out, so depth^2 |t'|^2 is the sum of squares that the hole explains.
    """
    half = w.shape[0] // 2
    reach = r0 + 0.5 * edge
    i0, i1 = max(-half, math.ceil(ox - reach)), min(half, math.floor(ox + reach))
    t1 = tx = ty = tt = te = 0.0
    for j in range(max(-half, math.ceil(oy - reach)), min(half, math.floor(oy + reach)) + 1):
        wr, er = w[j + half], e[j + half]
        r1 = 0.0
        for i in range(i0, i1 + 1):
            t = soft_disc(r0, math.sqrt((i - ox) ** 2 + (j - oy) ** 2), edge)
            q = wr[i + half] * t
            r1 += q
            tx += q * i
            tt += q * t
            te += er[i + half] * t
        t1 += r1
        ty += j * r1
    free = tt - (
        inv[0] * t1 * t1 + inv[3] * tx * tx + inv[5] * ty * ty
        + 2.0 * (inv[1] * t1 * tx + inv[2] * t1 * ty + inv[4] * tx * ty)
    )  # fmt: skip
    if not free > 1e-3 * tt:
        return 0.0, 0.0, tt, 0.0
    return -te / free, free, tt, t1 / (math.pi * r0 * r0)


@nb.njit(cache=True, nogil=True)
def merit_at(g: Any, x: float, y: float, r0: float, min_core: float, w: Any, e: Any, inv: Any) -> tuple[float, float]:
    """Merit m and depth of the hole centred at (x, y).

    m is inf where the centre is a hill or flat, NaN where too little of hole or window is visible.
    """
    total, share = plane_window(g, x, y, r0, w, e, inv)
    if total < 0.0 or share < MIN_WINDOW:
        return math.nan, 0.0
    ox, oy = x - math.floor(x + 0.5), y - math.floor(y + 0.5)
    depth, free, tt, visible = match_hole(w, e, inv, ox, oy, r0, MERIT_EDGE_PX)
    if visible < min_core:
        return math.nan, depth
    if not depth > 0.0:
        return math.inf, depth
    return math.sqrt(max(total - depth * depth * free, 0.0) / (depth * depth * tt)), depth


@nb.njit(cache=True, nogil=True)
def bowl_quadratic(
    g: Any, x: float, y: float, r0: float, bowl: Any, fit: Any, w: Any, e: Any, inv: Any, q: Any
) -> bool:
    """Least-squares quadratic through -rho^2 at the bowl's positions round (x, y).

    m^2 = kappa (1/rho^2 - 1): m and -rho^2 have the same minimum, -rho^2 is the rounder bowl. `q` gets gradient (2)
    and second derivatives xx, xy, yy at (x, y), times the window's sum of squares. False where the window is not
    visible or flat.
    """
    total, share = plane_window(g, x, y, r0, w, e, inv)
    if total <= 0.0 or share < MIN_WINDOW:
        return False
    ox, oy = x - math.floor(x + 0.5), y - math.floor(y + 0.5)
    q[:] = 0.0
    for k in range(bowl.shape[0]):
        depth, free, _, _ = match_hole(w, e, inv, ox + bowl[k, 0], oy + bowl[k, 1], r0, BOWL_EDGE_PX)
        explained = depth * abs(depth) * free  # total * rho^2, with rho's sign kept
        for m in range(5):
            q[m] -= fit[m, k] * explained
    return True


@nb.njit(cache=True, nogil=True)
def settle(
    g: Any, x: float, y: float, r0: float, bowl: Any, fit: Any, w: Any, e: Any, inv: Any, q: Any
) -> tuple[float, float, int]:
    """Follow the bowl's vertex from (x, y): the new centre and 1 settled, 0 not settled, -1 no bowl (not convex)."""
    x0, y0 = x, y
    for _ in range(MAX_STEPS):
        if not bowl_quadratic(g, x, y, r0, bowl, fit, w, e, inv, q):
            return x, y, -1
        det = q[2] * q[4] - q[3] * q[3]
        if not (q[2] > 0.0 and det > 1e-3 * (q[2] + q[4]) ** 2):
            return x, y, -1
        dx, dy = (q[3] * q[1] - q[4] * q[0]) / det, (q[3] * q[0] - q[2] * q[1]) / det
        step = math.sqrt(dx * dx + dy * dy)
        shrink = min(1.0, 0.5 * r0 / max(step, 1e-12))
        x += shrink * dx
        y += shrink * dy
        if step < SETTLED_PX:
            return x, y, 1
        if (x - x0) ** 2 + (y - y0) ** 2 > 4.0 * r0 * r0:
            return x, y, -1
    return x, y, 0


@nb.njit(cache=True, nogil=True)
def refine_bowl(g: Any, start: Any, r0: float, merit_start: float, min_core: float, bowl: Any, fit: Any) -> Any:
    """Centres from starting positions: (K, 5) columns x, y, merit, depth, settled (1 or 0); merit inf = no spot.

    A start whose own merit is not below `merit_start` is dropped at once.
    """
    half = int(2.0 * r0 + 0.5 * MERIT_EDGE_PX) + 1
    w, e = np.empty((2 * half + 1, 2 * half + 1)), np.empty((2 * half + 1, 2 * half + 1))
    inv, q, out = np.empty(6), np.empty(5), np.empty((start.shape[0], 5))
    for s in range(start.shape[0]):
        x, y = start[s, 0], start[s, 1]
        out[s, 0], out[s, 1], out[s, 2], out[s, 3], out[s, 4] = x, y, math.inf, 0.0, 0.0
        m, _ = merit_at(g, x, y, r0, 0.5 * min_core, w, e, inv)
        if not m < merit_start:
            continue
        x, y, settled = settle(g, x, y, r0, bowl, fit, w, e, inv, q)
        if settled >= 0:
            m, depth = merit_at(g, x, y, r0, min_core, w, e, inv)
            out[s, 0], out[s, 1], out[s, 3], out[s, 4] = x, y, depth, settled
            if m == m:
                out[s, 2] = m
    return out
