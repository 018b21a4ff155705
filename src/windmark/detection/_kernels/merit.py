"""The merit of every pixel. Private; arrays in, arrays out.

Round a pixel's centre the window and the hole are symmetric: their weights are tables over |dy|, |dx|. Rows above and
below are first added in pairs, weighted into one profile for each |dx| (neighbouring |dx| differ in a few rows only, so
each profile is made from the next), and the profiles are then added in pairs of columns. Every loop runs along a row
over few contiguous views, so that it vectorises in float32. The twin is `fit_hole` in tests/detection/conftest.py.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection._kernels.spot import merit_at
from windmark.geometry._jit import nb

BLOCK_ROWS, BLOCK_COLUMNS = 64, 1024  # handled at a time: they stay in the cache, with a mean of their own
ROUNDING = 2e-6  # of a sum in float32


@nb.njit(cache=True, nogil=True)
def _pair_sum(a: Any, b: Any, weight: Any, out: Any) -> None:
    for i in range(out.size):
        out[i] = weight * (a[i] + b[i])


@nb.njit(cache=True, nogil=True)
def _pair_difference(a: Any, b: Any, weight: Any, out: Any) -> None:
    for i in range(out.size):
        out[i] = weight * (a[i] - b[i])


@nb.njit(cache=True, nogil=True)
def _chain(before: Any, a: Any, wa: Any, b: Any, wb: Any, out: Any) -> None:
    for i in range(out.size):
        out[i] = before[i] + wa * a[i] + wb * b[i]


@nb.njit(cache=True, nogil=True)
def _add_two(a: Any, wa: Any, b: Any, wb: Any, out: Any) -> None:
    for i in range(out.size):
        out[i] += wa * a[i] + wb * b[i]


@nb.njit(cache=True, nogil=True)
def _add_pair(a: Any, b: Any, weight: Any, out: Any) -> None:
    for i in range(out.size):
        out[i] += weight * (a[i] + b[i])


@nb.njit(cache=True, nogil=True)
def _add_pairs(a: Any, b: Any, c: Any, d: Any, out: Any) -> None:
    for i in range(out.size):
        out[i] += (a[i] + b[i]) + (c[i] + d[i])


@nb.njit(cache=True, nogil=True)
def _profiles(pairs: Any, steps: Any, out: Any) -> None:
    """Profiles of all |dx| from the pairs of rows: out[d] = out[d + 1] + sum of weight * pairs[k] over the steps of d.

    `steps` (T, 5): d, k, weight, second k, its weight (0 if there is none); d falls from len(out) - 2 to 0.
    """
    out[-1] = np.float32(0.0)
    done = out.shape[0] - 1
    for t in range(steps.shape[0]):
        d, a, b = int(steps[t, 0]), pairs[int(steps[t, 1])], pairs[int(steps[t, 3])]
        if d < done:
            _chain(out[d + 1], a, steps[t, 2], b, steps[t, 4], out[d])
        else:
            _add_two(a, steps[t, 2], b, steps[t, 4], out[d])
        done = d


@nb.njit(cache=True, nogil=True)
def _across(profiles: Any, half: int, out: Any) -> None:
    """Sum of the profiles over the columns of a window: profiles[|dx|] at x + dx."""
    n, reach = out.size, profiles.shape[0] - 2
    out[:] = profiles[0, half : half + n]
    for d in range(1, reach, 2):
        p, q = profiles[d], profiles[d + 1]
        _add_pairs(
            p[half - d : half - d + n], p[half + d : half + d + n],
            q[half - d - 1 : half - d - 1 + n], q[half + d + 1 : half + d + 1 + n], out,
        )  # fmt: skip
    if reach % 2 == 1:
        p = profiles[reach]
        _add_pair(p[half - reach : half - reach + n], p[half + reach : half + reach + n], np.float32(1.0), out)


@nb.njit(cache=True, nogil=True)
def _moment_across(profiles: Any, half: int, out: Any) -> None:
    """The same of dx times the profiles."""
    n = out.size
    out[:] = np.float32(0.0)
    for d in range(1, profiles.shape[0] - 1):
        p = profiles[d]
        weight = np.float32(d)
        a, b = p[half + d : half + d + n], p[half - d : half - d + n]
        for i in range(n):
            out[i] += weight * (a[i] - b[i])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _merit_row(s: Any, form: Any, out: Any) -> None:
    """Merit from the sums (5, n) of g, dx g, dy g, g^2 over the window and of g over the hole; inf where it is a hill.

    `form`: inverse normal matrix aa, ac, cc, bb of the plane a + b dx + c dy, the hole's t1, ty, tt and |t'|^2. What is
    below the rounding of the sums is no hole.
    """
    aa, ac, cc, bb, t1, ty, tt, free = form[0], form[1], form[2], form[3], form[4], form[5], form[6], form[7]
    s0, s1, s2, s3, core = s[0], s[1], s[2], s[3], s[4]
    if tt != tt:
        out[:] = np.float32(np.nan)
        return
    for i in range(out.size):
        a, c = aa * s0[i] + ac * s2[i], ac * s0[i] + cc * s2[i]
        total = s3[i] - a * s0[i] - bb * s1[i] * s1[i] - c * s2[i]
        hole = a * t1 + c * ty - core[i]
        error = math.sqrt(max(total - hole * hole / free, np.float32(0.0)) / tt) * free / hole
        out[i] = error if hole > np.float32(ROUNDING) * abs(core[i]) else np.float32(np.inf)


@nb.njit(cache=True, nogil=True)
def _block_of(g: Any, top: int, left: int, v: Any, q: Any) -> None:
    """Copy a block of g less its mean into `v` and its squares into `q`; rows beyond the image become 0."""
    rows, n = v.shape
    first, last = max(0, -top), min(rows, g.shape[0] - top)
    total = 0.0
    for k in range(first, last):
        row = g[top + k, left : left + n]
        for i in range(0, n, 8):
            total += row[i]
    mean = np.float32(total / max((last - first) * ((n + 7) // 8), 1))
    v[:] = np.float32(0.0)
    q[:] = np.float32(0.0)
    for k in range(first, last):
        row, vk, qk = g[top + k, left : left + n], v[k], q[k]
        for i in range(n):
            vk[i] = row[i] - mean
            qk[i] = vk[i] * vk[i]


@nb.njit(cache=True, nogil=True)
def _row_sums(v: Any, q: Any, y: int, window: Any, hole: Any, pairs: Any, p: Any, s: Any) -> None:
    """Sums (5, n) of `_merit_row` for the row whose window starts at row y of the block."""
    half = p.shape[0] - 2
    reach = int(hole[0, 0]) + 1
    middle = y + half
    one, hw = np.float32(1.0), np.float32(0.5)
    for k in range(half + 1):
        _pair_sum(v[middle - k], v[middle + k], hw if k == 0 else one, pairs[k])
    _profiles(pairs, window, p)
    _across(p, half, s[0])
    _moment_across(p, half, s[1])
    core = p[: reach + 1]
    _profiles(pairs, hole, core)
    _across(core, half, s[4])
    for k in range(half + 1):
        _pair_difference(v[middle + k], v[middle - k], np.float32(k), pairs[k])
    _profiles(pairs, window, p)
    _across(p, half, s[2])
    for k in range(half + 1):
        _pair_sum(q[middle - k], q[middle + k], hw if k == 0 else one, pairs[k])
    _profiles(pairs, window, p)
    _across(p, half, s[3])


@nb.njit(cache=True, nogil=True)
def merit_rows(g: Any, half: int, window: Any, hole: Any, forms: Any, first: int, out: Any) -> None:
    """Merit of the rows first ... first + len(out) - 1 of g (no NaN), in all columns but the outer `half`.

    Parameters
    ----------
    window, hole : (T, 5) float32, the steps of `_profiles`
    forms : (rows of out, 8) float32, see `_merit_row`; NaN for a row of which too little is visible
    """
    n = g.shape[1] - 2 * half
    blocks = (n + BLOCK_COLUMNS - 1) // BLOCK_COLUMNS
    wide = (n + blocks - 1) // blocks
    v = np.empty((BLOCK_ROWS + 2 * half, wide + 2 * half), np.float32)
    q = np.empty_like(v)
    pairs, p = np.empty((half + 1, v.shape[1]), np.float32), np.empty((half + 2, v.shape[1]), np.float32)
    s = np.empty((5, wide), np.float32)
    for y0 in range(0, out.shape[0], BLOCK_ROWS):
        for x0 in range(0, n, wide):
            left = min(x0, n - wide)
            _block_of(g, first + y0 - half, left, v, q)
            for y in range(y0, min(y0 + BLOCK_ROWS, out.shape[0])):
                _row_sums(v, q, y - y0, window, hole, pairs, p, s)
                _merit_row(s, forms[y], out[y, half + left : half + left + wide])


@nb.njit(cache=True, nogil=True)
def merit_pixels(g: Any, where: Any, first: int, r0: float, min_core: float, out: Any) -> None:
    """Merit of single pixels of out (K, 2: row, column) by the general way: partial windows and dead pixels.

    Row 0 of out is row `first` of g.
    """
    half = int(2.0 * r0 + 0.5) + 1
    w, e, inv = np.empty((2 * half + 1, 2 * half + 1)), np.empty((2 * half + 1, 2 * half + 1)), np.empty(6)
    for k in range(where.shape[0]):
        y, x = where[k, 0], where[k, 1]
        out[y, x] = merit_at(g, float(x), float(first + y), r0, min_core, w, e, inv)[0]
