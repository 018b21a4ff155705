"""Image of a blurred ellipse on one patch and its derivatives, fast. Private to the template fit.

A patch is (S, S) with S odd; positions are relative to its middle pixel. Markers are holes (dark). The parameters p are

    0, 1  centre                      5  blur (standard deviation, px)       8, 9  slope of the light
    2-4   L_xx, L_xy, L_yy            6  depth      7  background at the middle pixel

`disc_model.patch_model` is the readable twin; formulas and sources are there. One thing differs: the centre of p is
where a disc without coupling to the slope would sit, c' = c - (blur^2 + 1/12) slope / light(c) (see `evaluate`).

Indices that are sums are unsigned: a negative index would wrap around, and the check for it keeps loops from being
vectorised. Assignments to slices are avoided: numba compiles seconds of text handling for their error messages.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.geometry._jit import nb

CUT = 4.25  # standard deviations after which a Gaussian is over: 2e-5 of its mass; a multiple of 1/64
CENTRE, SHAPE = 0, 1  # what `disc_sums` makes beside the image: derivatives by the centre, and by the shape
LANES = 4  # numbers that a vector holds
POINTS, MIN_POINTS = 4.2, 8.0  # points on the ellipse: MIN_POINTS + POINTS * half axis / blur

_STEP = 1.0 / 64.0
_NODES = [k * _STEP - CUT for k in range(int(2 * CUT / _STEP) + 1)]
_OUTSIDE, _RIM = 0.5 * math.erfc(CUT / math.sqrt(2.0)), math.exp(-0.5 * CUT * CUT) / math.sqrt(2.0 * math.pi)
_MASS = 1.0 - 2.0 * _OUTSIDE
_SLOPE = _RIM / _MASS
_CDF = np.array([(0.5 * math.erfc(-t / math.sqrt(2.0)) - _OUTSIDE) / _MASS for t in _NODES])
_PDF = np.array([math.exp(-0.5 * t * t) / math.sqrt(2.0 * math.pi) / _MASS for t in _NODES])


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def normal_edges(start: float, step: float, count: int, cdf: Any, pdf: Any) -> None:
    """Distribution and density of the cut normal law at start + k step: Taylor from the nearest node, error 3e-8.

    The law ends at +-CUT; its density is lowered to 0 there, so that pixels come and go without a jump.
    """
    for k in range(count):
        t = min(max(start + k * step, -CUT), CUT)
        node = np.uint64((t + CUT) * 64.0 + 0.5)
        t0 = node * _STEP - CUT
        h, f = t - t0, _PDF[node]
        cdf[k] = _CDF[node] + f * h * (1.0 - 0.5 * h * t0)
        pdf[k] = f * (1.0 - h * (t0 - 0.5 * h * (t0 * t0 - 1.0))) - _SLOPE


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def whole(count: int) -> int:
    """The next number of whole vectors: what is left over costs as much for each number as a vector does."""
    return -(-count // LANES) * LANES


@nb.njit(cache=True, nogil=True, error_model="numpy")
def points_needed(p: Any) -> int:
    """Points on the ellipse for which the trapezoid rule is as exact as the cut of the Gaussian."""
    major = 0.5 * (p[2] + p[4]) + math.sqrt(0.25 * (p[2] - p[4]) ** 2 + p[3] * p[3])
    return int(math.ceil(MIN_POINTS + POINTS * major / p[5]))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def disc_sums(p: Any, points: int, what: int, table: Any, g: Any) -> None:
    """Derivatives by the unknowns 0 ... 5 and the disc image itself into g[0:7]; g is (10, S, S), g[7] is scratch.

    `points` on the ellipse; `what` is `CENTRE` (unknowns 0 and 1) or `SHAPE` (0 ... 5): other derivatives are 0;
    `table` is scratch of shape (8, S + 6).
    """
    size = g.shape[1]
    g[:8] = 0.0
    rim_sums(p, points, what, table, g, np.empty((0, 4), np.int64))
    for j in range(size):
        inside = 0.0
        for i in range(size - 1, -1, -1):
            inside += g[7, j, i]
            g[6, j, i] += inside


@nb.njit(cache=True, nogil=True, error_model="numpy")
def widen(bands: Any, j0: int, j1: int, start: int, end: int, side: int) -> None:
    """Widen a side of the bands by some columns in some rows."""
    for j in range(j0, j1 if end > start else j0):
        bands[j, side] = min(bands[j, side], start) if bands[j, side + 1] > 0 else start
        bands[j, side + 1] = max(bands[j, side + 1], end)


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def rim_sums(p: Any, points: int, what: int, table: Any, g: Any, bands: Any) -> None:
    """What the rim adds to g of `disc_sums`, which has zeros there: g[7] is still to be summed along the rows to g[6].

    `bands` (S, 4) is widened by the columns it reaches in each row: first and one behind the last of the left and of
    the right part of the rim; 0, 0 where there is none. (0, 4): nobody asks.
    """
    size = g.shape[1]
    cx, cy, a, b, d, sigma = p[0] + size // 2, p[1] + size // 2, p[2], p[3], p[4], p[5]
    inv, reach, step = 1.0 / sigma, CUT * sigma + 0.5, 2.0 * math.pi / points
    cdf, pdf, kx, ex, ax, ky, ey, _ = (
        table[0], table[1], table[2], table[3], table[4], table[5], table[6], table[7],
    )  # fmt: skip
    ct, st, co, si = math.cos(step), math.sin(step), 1.0, 0.0
    for _ in range(points):
        u, v = cx + a * co + b * si, cy + b * co + d * si
        du, dv = step * (b * co - a * si), step * (d * co - b * si)
        i0, i1 = max(0, int(math.ceil(u - reach))), min(size, int(math.floor(u + reach)) + 1)
        j0, j1 = max(0, int(math.ceil(v - reach))), min(size, int(math.floor(v + reach)) + 1)
        nj = max(j1 - j0, 0)
        ni = min(whole(max(i1 - i0, 0)), max(size - i0, 0))  # what is added beyond the reach is 0
        i1 = min(i0 + ni, size)
        normal_edges((j0 - 0.5 - v) * inv, inv, whole(nj + 1), cdf, pdf)
        for j in range(nj):
            ky[j], ey[j] = cdf[j + 1] - cdf[j], pdf[j] - pdf[j + 1]
        t0 = (i0 - 0.5 - u) * inv
        normal_edges(t0, inv, whole(ni + 1), cdf, pdf)
        for i in range(ni):
            t = t0 + i * inv
            kx[i], ex[i] = cdf[i + 1] - cdf[i], pdf[i] - pdf[i + 1]
            ax[i] = sigma * (ex[i] - t * (1.0 - cdf[i]) + (t + inv) * (1.0 - cdf[i + 1]))
        left, many = np.uint64(i0), np.uint64(ni)
        if bands.shape[0] > 0:
            widen(bands, j0, j1, max(min(i0, size) - 1, 0), max(i1, min(i0, size)), 2 if dv > 0.0 else 0)
        for j in range(nj):
            row, q = np.uint64(j0 + j), ky[j]
            qv, qu, eu = q * dv, q * du, ey[j] * du
            w2, w3, w4 = qv * co, qv * si - qu * co, -qu * si
            for i in range(many):
                g[6, row, left + i] += ax[i] * qv
            for i in range(many):
                g[0, row, left + i] += kx[i] * qv
            for i in range(many):
                g[1, row, left + i] -= kx[i] * qu
            if what == SHAPE:
                for i in range(many):
                    g[2, row, left + i] += kx[i] * w2
                for i in range(many):
                    g[3, row, left + i] += kx[i] * w3
                for i in range(many):
                    g[4, row, left + i] += kx[i] * w4
                for i in range(many):
                    g[5, row, left + i] += ex[i] * qv - kx[i] * eu
            if i0 > 0:
                g[7, row, np.uint64(min(i0, size) - 1)] += qv
        co, si = co * ct - si * st, si * ct + co * st


@nb.njit(cache=True, nogil=True, error_model="numpy")
def evaluate(
    patch: Any, weight: Any, p: Any, points: int, shape: bool, cut: float, multiplicative: float, table: Any, jac: Any,
    res: Any,
) -> float:  # fmt: skip
    """Weighted residuals (S, S) and derivatives of the model (10, S, S); returns the cost.

    `cut` is 1 / (Tukey's c)^2, 0 for least squares; the cost is sum r^2 (1 - z + z^2 / 3), z = cut r^2, at most 1 /
    (3 cut).
    """
    disc_sums(p, points, SHAPE if shape else CENTRE, table, jac)
    return compare(patch, weight, p, shape, cut, multiplicative, table, jac, res)


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def compare(
    patch: Any, weight: Any, p: Any, shape: bool, cut: float, multiplicative: float, table: Any, jac: Any, res: Any
) -> float:
    """The rest of `evaluate`: `jac` comes as `disc_sums` leaves it."""
    half, d, b, qx, qy, cost = res.shape[0] // 2, p[6], p[7], p[8], p[9], 0.0
    additive, spread = 1.0 - multiplicative, multiplicative * d * (p[5] * p[5] + 1.0 / 12.0)
    center_light = max(1.0 + multiplicative * (qx * p[0] + qy * p[1]), 0.05)
    light, floor = table[0], table[1]
    for j in range(res.shape[0]):
        y = float(j - half)
        for i in range(res.shape[0]):
            slope = qx * (i - half) + qy * y
            light[i], floor[i] = 1.0 + multiplicative * slope, b - d * jac[6, j, i]
            late = spread * (light[i] / center_light - 1.0) * (qx * jac[0, j, i] + qy * jac[1, j, i])
            r = patch[j, i] - light[i] * floor[i] - additive * slope + late
            z = min(cut * r * r, 1.0)
            w = weight[j, i] * (1.0 - z)
            cost += weight[j, i] * (r * r * (1.0 - z + z * z / 3.0) if z < 1.0 else 1.0 / (3.0 * cut))
            res[j, i] = w * r
            light[i] *= w
            floor[i] = w * (multiplicative * floor[i] + additive)
        for m in range(6 if shape else 2):
            for i in range(res.shape[0]):
                jac[m, j, i] *= -d * light[i]
        for i in range(res.shape[0]):
            jac[6, j, i] *= -light[i]
        for i in range(res.shape[0]):
            jac[7, j, i] = light[i]
        for i in range(res.shape[0]):
            jac[8, j, i] = (i - half) * floor[i]
        for i in range(res.shape[0]):
            jac[9, j, i] = y * floor[i]
    return cost
