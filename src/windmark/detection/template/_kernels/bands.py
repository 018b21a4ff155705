"""Normal equations of a template on one patch, its rim's pixels apart from the others. Private to the template fit.

The model's derivatives by centre, shape and blur are not 0 along the rim only. In each row of the patch these pixels
are two runs at most (an ellipse is convex); beside and between them the disc's image is one number, and such a run
needs a few sums, whatever its length. Rows are as `disc_sums` leaves them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from windmark.detection.template._kernels.algebra import add_products
from windmark.geometry._jit import nb

ROWS = 11  # of the table of the rim's pixels: derivatives by the ten parameters, residual
LIGHT = 6  # the first parameter of which a pixel away from the rim tells something: depth, background, slope


@nb.njit(cache=True, nogil=True, error_model="numpy")
def used_runs(weight: Any, spans: Any) -> None:
    """First column with a weight and the one behind the last (S, 2); 0, 0 in rows without any."""
    for j in range(weight.shape[0]):
        spans[j, 0], spans[j, 1] = 0, 0
        for i in range(weight.shape[1]):
            if weight[j, i] > 0.0:
                if spans[j, 1] == 0:
                    spans[j, 0] = i
                spans[j, 1] = i + 1


@nb.njit(cache=True, nogil=True, error_model="numpy")
def forget(g: Any, bands: Any) -> None:
    """Zeros where `disc_sums` has written."""
    for j in range(bands.shape[0]):
        for side in range(2):
            for m in range(8):
                for i in range(bands[j, 2 * side], bands[j, 2 * side + 1]):
                    g[m, j, i] = 0.0
        bands[j, 0], bands[j, 1], bands[j, 2], bands[j, 3] = 0, 0, 0, 0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _runs(g: Any, j: int, bands: Any, span: Any, out: Any) -> tuple[float, float]:
    """Fill in the disc's image g[6] on a row's bands; what it is left of them and between them.

    `out` (6,): where within `span` each of five runs begins and the last ends: 1 and 3 are the bands.
    """
    first, left, right, last = bands[j, 0], bands[j, 1], bands[j, 2], bands[j, 3]
    if left == 0:
        first = left = right
    elif last == 0:
        right = last = left
    if right < left:  # top and bottom of the disc
        first, last = min(first, right), max(last, left)
        left = right = first
    row, inside = np.uint64(j), 0.0
    for k in range(last - right):
        i = np.uint64(last - 1 - k)
        inside += g[7, row, i]
        g[6, row, i] += inside
    between = inside
    for k in range(left - first):
        i = np.uint64(left - 1 - k)
        inside += g[7, row, i]
        g[6, row, i] += inside
    low, high = span[0], span[1]
    out[0], out[5] = low, high
    out[1], out[2] = min(max(first, low), high), min(max(left, low), high)
    out[3], out[4] = min(max(right, low), high), min(max(last, low), high)
    return inside, between


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _rim_run(
    patch: Any, weight: Any, g: Any, j: int, i0: int, count: int, p: Any, cut: float, multiplicative: float,
    center: float, rows: Any, start: int,
) -> float:  # fmt: skip
    """Derivatives and residuals of a run of pixels into `rows` (ROWS, N) from column `start`; returns the cost."""
    d, b, qx, qy, cost = p[6], p[7], p[8], p[9], 0.0
    additive, spread = 1.0 - multiplicative, multiplicative * d * (p[5] * p[5] + 1.0 / 12.0)
    row, first, at, many = np.uint64(j), np.uint64(i0), np.uint64(start), np.uint64(count)
    x, y = float(i0 - patch.shape[0] // 2), float(j - patch.shape[0] // 2)
    for i in range(many):
        slope = qx * (x + i) + qy * y
        lit, left = 1.0 + multiplicative * slope, b - d * g[6, row, first + i]
        late = spread * (lit / center - 1.0) * (qx * g[0, row, first + i] + qy * g[1, row, first + i])
        r = patch[row, first + i] - lit * left - additive * slope + late
        z = min(cut * r * r, 1.0)
        w = weight[row, first + i] * (1.0 - z)
        cost += weight[row, first + i] * (r * r * (1.0 - z + z * z / 3.0) if z < 1.0 else 1.0 / (3.0 * cut))
        rows[10, at + i] = w * r
        rows[7, at + i] = lit * w
        rows[8, at + i] = w * (multiplicative * left + additive)
    for m in range(LIGHT):
        for i in range(many):
            rows[m, at + i] = -d * rows[7, at + i] * g[m, row, first + i]
    for i in range(many):
        rows[6, at + i] = -rows[7, at + i] * g[6, row, first + i]
    for i in range(many):
        rows[9, at + i] = y * rows[8, at + i]
    for i in range(many):
        rows[8, at + i] *= x + i
    return cost


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _even_run(
    patch: Any, weight: Any, j: int, i0: int, count: int, inside: float, p: Any, cut: float, multiplicative: float,
    matrix: Any, rhs: Any,
) -> float:  # fmt: skip
    """Add a run of pixels on which the disc's image is `inside` to the equations; returns the cost."""
    qx, qy, additive, left = p[8], p[9], 1.0 - multiplicative, p[7] - p[6] * inside
    row, first, many = np.uint64(j), np.uint64(i0), np.uint64(count)
    x, y = float(i0 - patch.shape[0] // 2), float(j - patch.shape[0] // 2)
    ll = lx = lw = ww = wx = xx = rl = rw = rx = cost = 0.0
    for i in range(many):
        u = x + i
        slope = qx * u + qy * y
        lit = 1.0 + multiplicative * slope
        r = patch[row, first + i] - lit * left - additive * slope
        z = min(cut * r * r, 1.0)
        w = weight[row, first + i] * (1.0 - z)
        cost += weight[row, first + i] * (r * r * (1.0 - z + z * z / 3.0) if z < 1.0 else 1.0 / (3.0 * cut))
        w2 = w * w
        ll += lit * lit * w2
        lw += lit * w2
        lx += lit * w2 * u
        ww += w2
        wx += w2 * u
        xx += w2 * u * u
        rl += lit * w2 * r
        rw += w2 * r
        rx += w2 * r * u
    f = multiplicative * left + additive
    matrix[6, 6] += inside * inside * ll
    matrix[6, 7] -= inside * ll
    matrix[6, 8] -= inside * f * lx
    matrix[6, 9] -= inside * f * y * lw
    matrix[7, 7] += ll
    matrix[7, 8] += f * lx
    matrix[7, 9] += f * y * lw
    matrix[8, 8] += f * f * xx
    matrix[8, 9] += f * f * y * wx
    matrix[9, 9] += f * f * y * y * ww
    rhs[6] -= inside * rl
    rhs[7] += rl
    rhs[8] += f * rx
    rhs[9] += f * y * rw
    return cost


@nb.njit(cache=True, nogil=True, error_model="numpy")
def banded(
    patch: Any, weight: Any, spans: Any, p: Any, cut: float, multiplicative: float, g: Any, bands: Any, rows: Any,
    matrix: Any, rhs: Any,
) -> float:  # fmt: skip
    """J^T J (upper triangle mirrored), J^T r by the parameters, and the cost; as `compare`, by runs.

    `g`, `bands` as `disc_sums` leaves them; `spans` (S, 2) of `used_runs`; `rows` (ROWS, S S) is scratch.
    """
    cost, n, edges = 0.0, 0, np.empty(6, np.int64)
    center = max(1.0 + multiplicative * (p[8] * p[0] + p[9] * p[1]), 0.05)
    for a in range(10):
        rhs[a] = 0.0
        for b in range(10):
            matrix[a, b] = 0.0
    for j in range(patch.shape[0]):
        outside, between = _runs(g, j, bands, spans[j], edges)
        for k in range(5):
            i0, many = edges[k], edges[k + 1] - edges[k]
            if many <= 0:
                continue
            if k == 1 or k == 3:
                cost += _rim_run(patch, weight, g, j, i0, many, p, cut, multiplicative, center, rows, n)
                n += many
            else:
                inside = outside if k == 0 else (between if k == 2 else 0.0)
                cost += _even_run(patch, weight, j, i0, many, inside, p, cut, multiplicative, matrix, rhs)
    add_products(rows, n, matrix, rhs)
    return cost


@nb.njit(cache=True, nogil=True, error_model="numpy")
def extremes(
    patch: Any, weight: Any, spans: Any, p: Any, cut: float, multiplicative: float, g: Any, bands: Any
) -> tuple[float, int]:
    """Largest weighted residual, and the number of pixels that Tukey's weights leave out; after `banded`."""
    half, largest, rejected = patch.shape[0] // 2, 0.0, 0
    center = max(1.0 + multiplicative * (p[8] * p[0] + p[9] * p[1]), 0.05)
    spread, additive = multiplicative * p[6] * (p[5] * p[5] + 1.0 / 12.0), 1.0 - multiplicative
    for j in range(patch.shape[0]):
        y = float(j - half)
        level = 0.0
        for i in range(patch.shape[1] - 1, -1, -1):
            on = bands[j, 0] <= i < bands[j, 1] or bands[j, 2] <= i < bands[j, 3]
            level += g[7, j, i]
            if not spans[j, 0] <= i < spans[j, 1]:
                continue
            slope = p[8] * (i - half) + p[9] * y
            lit, inside = 1.0 + multiplicative * slope, g[6, j, i] if on else level
            r = patch[j, i] - lit * (p[7] - p[6] * inside) - additive * slope
            if on:
                r += spread * (lit / center - 1.0) * (p[8] * g[0, j, i] + p[9] * g[1, j, i])
            w = weight[j, i] * (1.0 - min(cut * r * r, 1.0))
            largest = max(largest, abs(w * r))
            rejected += weight[j, i] > 0.0 and w * lit == 0.0
    return largest, rejected
