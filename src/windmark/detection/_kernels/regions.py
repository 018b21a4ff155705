"""Candidates measured by the region below half depth, and the disc's correlation with its window. Private.

`g` as in `_kernels.spot`: a marker is a hole, NaN is missing. Twin in tests/detection/test_regions.py.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection._kernels.spot import smallest
from windmark.geometry._jit import nb

REACH = 3.2  # radii to which a region may reach
RING = 32  # pixels that say what the surface is
SOFT = 0.15  # share of the depth within which noise may be for the region to be taken from single pixels
WINDOW = 2.0  # half axes of the window
TIE = 1e-3  # of the noise: whole grey levels are often the same, and rounding must not say which is less
COLUMNS = ("x", "y", "xx", "xy", "yy", "area", "depth", "rho2", "residual", "kappa", "fill", "state")
OPEN, CUT, WHOLE = 0.0, 1.0, 2.0  # state: goes on beyond reach, cut by border or missing pixels, whole


@nb.njit(cache=True, nogil=True)
def _value(g: Any, y: int, x: int, smooth: bool) -> float:
    """A pixel, or its neighbourhood weighted 1-2-1; NaN outside and where one is missing."""
    if not (0 <= y < g.shape[0] and 0 <= x < g.shape[1]):
        return math.nan
    if not smooth or y == 0 or x == 0 or y == g.shape[0] - 1 or x == g.shape[1] - 1:
        return g[y, x]
    a, b, c = g[y - 1], g[y], g[y + 1]
    corners, sides = a[x - 1] + a[x + 1] + c[x - 1] + c[x + 1], a[x] + c[x] + b[x - 1] + b[x + 1]
    return 0.0625 * corners + 0.125 * sides + 0.25 * b[x]


@nb.njit(cache=True, nogil=True)
def _surface(g: Any, cy: int, cx: int, circle: Any, ring: Any) -> float:
    """Median of the pixels on a circle (RING, 2) of offsets; NaN where fewer than half of them are there."""
    n = 0
    for k in range(RING):
        v = _value(g, cy + circle[k, 1], cx + circle[k, 0], False)
        if v == v:
            ring[n] = v
            n += 1
    return smallest(ring, n, n // 2) if 2 * n >= RING else math.nan


@nb.njit(cache=True, nogil=True)
def _flood(g: Any, cy: int, cx: int, level: float, smooth: bool, half: int, mask: Any, stack: Any, s: Any) -> float:
    """Region (4-connected) below the level that holds the pixel, into `mask` (1 of it, 2 beside it); its state.

    `s` gets its pixels' sums 1, x, y, xx, xy, yy from the first pixel, and first and last column and row in the mask.
    """
    mask[:, :] = 0
    s[:6] = 0.0
    state, n, size = WHOLE, 1, 2 * half + 1
    s[6:10] = half
    stack[0] = half * size + half
    mask[half, half] = 1
    while n > 0:
        n -= 1
        j, i = stack[n] // size, stack[n] % size
        u, v = i - half, j - half
        s[0] += 1.0
        s[1] += u
        s[2] += v
        s[3] += u * u
        s[4] += u * v
        s[5] += v * v
        s[6], s[7], s[8], s[9] = min(s[6], i), max(s[7], i), min(s[8], j), max(s[9], j)
        for k in range(4):
            a, b = i + (1 - k if k % 2 == 0 else 0), j + (2 - k if k % 2 == 1 else 0)
            if not (0 <= a < size and 0 <= b < size):
                return OPEN
            if mask[b, a] != 0:
                continue
            value = _value(g, cy + b - half, cx + a - half, smooth)
            if value != value:
                state = CUT
            if value <= level:
                mask[b, a] = 1
                stack[n] = b * size + a
                n += 1
            else:
                mask[b, a] = 2
    return state


@nb.njit(cache=True, nogil=True)
def _grey_moments(g: Any, cy: int, cx: int, top: float, depth: float, mask: Any, s: Any) -> None:
    """The sums of `_flood` over the region and what is beside it, weighted by the share of the depth."""
    half, last = mask.shape[0] // 2, mask.shape[0] - 2
    s[:6] = 0.0
    for j in range(max(int(s[8]) - 1, 1), min(int(s[9]) + 1, last) + 1):
        for i in range(max(int(s[6]) - 1, 1), min(int(s[7]) + 1, last) + 1):
            near = mask[j, i] == 1
            if not near:  # within a pixel of the region: 8 neighbours
                for b in range(-1, 2):
                    for a in range(-1, 2):
                        near |= mask[j + b, i + a] == 1
            if near:
                value = _value(g, cy + j - half, cx + i - half, False)
                q = min(max((top - value) / depth, 0.0), 1.0) if value == value else 0.0
                u, v = i - half, j - half
                s[0] += q
                s[1] += q * u
                s[2] += q * v
                s[3] += q * u * u
                s[4] += q * u * v
                s[5] += q * v * v


@nb.njit(cache=True, nogil=True)
def _central(s: Any) -> tuple[float, float, float, float, float]:
    """Centre and second moments of the sums."""
    x, y = s[1] / s[0], s[2] / s[0]
    return x, y, s[3] / s[0] - x * x, s[4] / s[0] - x * y, s[5] / s[0] - y * y


@nb.njit(cache=True, nogil=True)
def disc_match(g: Any, x: float, y: float, shape: Any, out: Any) -> None:
    """Least squares of plane and soft disc over the window: depth, rho^2, residual scatter, kappa into `out`.

    `shape` is the ellipse: symmetric (xx, xy, yy) matrix that maps the unit disc onto it; the window is `WINDOW` times
    as large and at least 2 px wider. Its edge is 2 px wide across. NaN where less than half of the window is there.
    """
    a, b, c = shape[0], shape[1], shape[2]
    det = a * c - b * b
    ia, ib, ic = c / det, -b / det, a / det
    big = max(math.hypot(a, b), math.hypot(b, c))
    mean = math.sqrt(det)
    grow = max(WINDOW, 1.0 + 2.0 / mean)
    hx, hy = int(grow * math.hypot(a, b)) + 1, int(grow * math.hypot(b, c)) + 1
    cx, cy = math.floor(x + 0.5), math.floor(y + 0.5)
    step = max(1, int(big / 8.0))
    minor = max(0.5 * (a + c) - math.hypot(0.5 * (a - c), b), 1e-12)
    inner, outer = max(1.0 - 1.0 / minor, 0.0) ** 2, (1.0 + 1.0 / minor) ** 2  # of r^2, between which the edge is
    n = su = sv = suu = suv = svv = sg = sgu = sgv = sgg = st = stu = stv = stt = stg = 0.0
    total = 0.0
    base = math.nan
    for j in range(-(hy // step) * step, hy + 1, step):
        for i in range(-(hx // step) * step, hx + 1, step):
            u, v = cx + i - x, cy + j - y
            p, q = ia * u + ib * v, ib * u + ic * v
            r2 = p * p + q * q
            if r2 > grow * grow:
                continue
            total += 1.0
            if not (0 <= cy + j < g.shape[0] and 0 <= cx + i < g.shape[1]):
                continue
            value = float(g[cy + j, cx + i])
            if value != value:
                continue
            if base != base:
                base = value
            value -= base
            t = 1.0 if r2 < 1.0 else 0.0
            if inner <= r2 <= outer:  # distance to the edge across it, px: (r - 1) over the length of r's gradient
                r, slope2 = math.sqrt(r2), (ia * p + ib * q) ** 2 + (ib * p + ic * q) ** 2
                t = min(max(0.5 - 0.5 * (r - 1.0) * r / max(math.sqrt(slope2), 1e-12), 0.0), 1.0)
            n += 1.0
            su += u
            sv += v
            suu += u * u
            suv += u * v
            svv += v * v
            sg += value
            sgu += value * u
            sgv += value * v
            sgg += value * value
            st += t
            stu += t * u
            stv += t * v
            stt += t * t
            stg += t * value
    out[0] = out[1] = out[2] = out[3] = math.nan
    if not (n >= 8.0 and 2.0 * n >= total):
        return
    # Take plane out of picture and disc: normal equations about the mean.
    mu, mv = su / n, sv / n
    puu, puv, pvv = suu / n - mu * mu, suv / n - mu * mv, svv / n - mv * mv
    d = puu * pvv - puv * puv
    if not d > 1e-9 * puu * pvv:
        return
    gu, gv = sgu / n - mu * sg / n, sgv / n - mv * sg / n
    tu, tv = stu / n - mu * st / n, stv / n - mv * st / n
    gg, tt, gt = sgg / n - (sg / n) ** 2, stt / n - (st / n) ** 2, stg / n - sg * st / (n * n)
    gg -= (pvv * gu * gu - 2.0 * puv * gu * gv + puu * gv * gv) / d
    free = tt - (pvv * tu * tu - 2.0 * puv * tu * tv + puu * tv * tv) / d
    gt -= (pvv * gu * tu - puv * (gu * tv + gv * tu) + puu * gv * tv) / d
    if not (free > 1e-3 * tt and gg > 0.0):
        return
    out[0] = -gt / free
    out[1] = min(max(gt * gt / (free * gg), 0.0), 1.0) if gt < 0.0 else 0.0
    out[2] = math.sqrt(max(gg - gt * gt / free, 0.0) * n / max(n - 4.0, 1.0))
    out[3] = free / (stt / n)


@nb.njit(cache=True, nogil=True)
def region_at(
    g: Any, x0: int, y0: int, r0: float, noise: float, circle: Any, mask: Any, stack: Any, work: Any, out: Any
) -> None:  # fmt: skip
    """Measure what is at a pixel, see `regions`; `circle` of `_surface`."""
    half = mask.shape[0] // 2
    s, ring = work[:10], work[10 : 10 + RING]
    out[:] = math.nan
    out[11] = OPEN
    near, cx, cy, low, tie = int(0.5 * r0) + 1, x0, y0, math.inf, TIE * noise
    for j in range(-near, near + 1):  # the darkest place: the box's maximum may be beside it
        for i in range(-near, near + 1):
            value = _value(g, y0 + j, x0 + i, True)
            if value < low - tie:
                low, cx, cy = value, x0 + i, y0 + j
    top = _surface(g, cy, cx, circle, ring)
    if not top - low > 0.0:
        return
    smooth = noise > SOFT * (top - low)
    if not smooth:
        low = min(low, _value(g, cy, cx, False))
    state = _flood(g, cy, cx, 0.5 * (top + low) + tie, smooth, half, mask, stack, s)
    if state == OPEN:
        return
    x, y, xx, xy, yy = _central(s)
    xx, yy = xx + 1.0 / 12.0, yy + 1.0 / 12.0
    out[10] = s[0] / (4.0 * math.pi * math.sqrt(max(xx * yy - xy * xy, 1e-12)))
    _grey_moments(g, cy, cx, top, top - low, mask, s)
    if s[0] > 0.0:
        area = s[0]
        x, y, xx, xy, yy = _central(s)
        out[0], out[1], out[2], out[3], out[4], out[5], out[11] = cx + x, cy + y, xx, xy, yy, area, state


@nb.njit(cache=True, nogil=True)
def ellipse_of(xx: float, xy: float, yy: float, area: float, shape: Any) -> None:
    """Symmetric matrix of the ellipse of an area whose second moments differ as those do: blur adds to both alike."""
    half = 0.5 * (xx - yy)
    spread = 4.0 * math.hypot(half, xy)  # (a^2 - b^2) / 2
    ab = area / math.pi
    a = math.sqrt(spread + math.hypot(spread, ab))
    b = ab / a
    turn = 0.5 * math.atan2(xy, half) if spread > 0.0 else 0.0
    c, s = math.cos(turn), math.sin(turn)
    shape[0], shape[1], shape[2] = a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c


@nb.njit(cache=True, nogil=True)
def regions(g: Any, start: Any, r0: float, noise: Any) -> Any:
    """Rows of `COLUMNS` for the pixels (K, 2) that a filter of radius r0 has found, given the noise (K,) there.

    The region below half depth round the darkest pixel, the depth from the median of a circle of radius 2 r0; from it
    centre, second moments and area, weighted by grey levels, and how well the ellipse of these explains its window.
    `fill` is the region's area over that of the ellipse with its second moments: 1 for ellipses, 0.955 for squares.
    Where a region is not whole, shape and match are not asked.
    """
    half = int(REACH * r0) + 2
    size = 2 * half + 1
    mask, stack = np.zeros((size, size), np.uint8), np.empty(size * size, np.int64)
    work, shape, out = np.empty(10 + RING), np.empty(3), np.empty((start.shape[0], 12))
    circle = np.empty((RING, 2), np.int64)
    for k in range(RING):
        t = 2.0 * math.pi * k / RING
        circle[k, 0] = math.floor(2.0 * r0 * math.cos(t) + 0.5)
        circle[k, 1] = math.floor(2.0 * r0 * math.sin(t) + 0.5)
    for k in range(start.shape[0]):
        row = out[k]
        region_at(g, int(start[k, 0]), int(start[k, 1]), r0, noise[k], circle, mask, stack, work, row)
        if row[11] == WHOLE:
            ellipse_of(row[2], row[3], row[4], row[5], shape)
            disc_match(g, row[0], row[1], shape, row[6:10])
            row[2], row[3], row[4] = shape[0], shape[1], shape[2]
    return out
