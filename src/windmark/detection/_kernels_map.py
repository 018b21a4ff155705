"""Whole-image passes: the coarse depth filter and the merit map. Private; arrays in, arrays out.

Loops run along rows on contiguous views, so that they vectorise.
"""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np

from windmark.detection._kernels import merit_at


@nb.njit(cache=True, nogil=True)
def bin_mean(g: Any, factor: int) -> Any:
    """Mean over factor x factor blocks; the remainder at right and bottom is left out."""
    h, w = g.shape[0] // factor, g.shape[1] // factor
    out = np.empty((h, w), np.float32)
    col = np.empty(w * factor, np.float32)
    scale = np.float32(1.0 / factor**2)
    for y in range(h):
        col[:] = np.float32(0.0)
        for k in range(factor):
            row = g[y * factor + k]
            for i in range(col.size):
                col[i] += row[i]
        for x in range(w):
            s = np.float32(0.0)
            for k in range(factor):
                s += col[x * factor + k]
            out[y, x] = s * scale
    return out


@nb.njit(cache=True, nogil=True)
def _add_shifts(col: Any, first: int, count: int, weight: Any, out: Any) -> None:
    """Add weight * (col[first:] + ... + col[first + count - 1:]) to out; count is odd."""
    n = out.size
    v = col[first : first + n]
    for i in range(n):
        out[i] += weight * v[i]
    for k in range(first + 1, first + count, 2):
        v, u = col[k : k + n], col[k + 1 : k + 1 + n]
        for i in range(n):
            out[i] += weight * (v[i] + u[i])


@nb.njit(cache=True, nogil=True)
def _box_depth(core: Any, win: Any, c: int, h: int, out: Any) -> None:
    """Depth of one row: mean of the outer box less the inner one, minus the mean of the inner box."""
    n_core, n_win = (2 * c + 1) ** 2, (2 * h + 1) ** 2
    out[:] = np.float32(0.0)
    _add_shifts(win, 0, 2 * h + 1, np.float32(1.0 / (n_win - n_core)), out)
    _add_shifts(core, h - c, 2 * c + 1, np.float32(-1.0 / n_core - 1.0 / (n_win - n_core)), out)


@nb.njit(cache=True, nogil=True)
def _pad(col: Any, h: int) -> None:
    """Repeat the first and last entry over the margins of width h."""
    n = col.size
    col[:h] = col[h]
    col[n - h :] = col[n - h - 1]


@nb.njit(cache=True, nogil=True)
def _fresh_columns(g: Any, y: int, half: int, h: int, col: Any) -> None:
    """Sums over rows y - half ... y + half (the border row repeated)."""
    rows, n = g.shape
    inner = col[h : h + n]
    inner[:] = np.float32(0.0)
    for k in range(-half, half + 1):
        row = g[min(max(y + k, 0), rows - 1)]
        for i in range(n):
            inner[i] += row[i]
    _pad(col, h)


@nb.njit(cache=True, nogil=True)
def _next_columns(g: Any, y: int, half: int, h: int, col: Any) -> None:
    """Column sums of row y from those of row y - 1."""
    rows, n = g.shape
    inner, new, old = col[h : h + n], g[min(y + half, rows - 1)], g[max(y - half - 1, 0)]
    for i in range(n):
        inner[i] += new[i] - old[i]
    _pad(col, h)


@nb.njit(cache=True, nogil=True)
def _row_peaks(above: Any, here: Any, below: Any, limit: Any, tile: int, out: Any) -> int:
    """Columns of the local maxima (3 x 3) of one row above the limit of their tile; rows have a margin of 1."""
    n, count = here.size - 2, 0
    for t in range(limit.size):
        floor = limit[t]
        for i in range(t * tile + 1, min((t + 1) * tile, n) + 1):
            v = here[i]
            if v > floor:
                side = max(here[i + 1], max(below[i - 1], max(below[i], below[i + 1])))
                if v >= side and v > max(here[i - 1], max(above[i - 1], max(above[i], above[i + 1]))):
                    out[count] = i - 1
                    count += 1
    return count


@nb.njit(cache=True, nogil=True)
def depth_peaks(g: Any, c: int, h: int, gate: Any, tile: int) -> tuple[Any, Any]:
    """Local maxima (3 x 3) of the box depth above the gate of their tile: positions (K, 2) and depths (K,)."""
    rows, n = g.shape
    core, win = np.empty(n + 2 * h, np.float32), np.empty(n + 2 * h, np.float32)
    d = np.full((3, n + 2), np.float32(-np.inf))
    found = np.empty(n, np.int64)
    xy, depth, count = np.empty((1024, 2)), np.empty(1024), 0
    for y in range(rows + 1):
        below = d[(y + 1) % 3]
        if y == 0:
            _fresh_columns(g, 0, c, h, core)
            _fresh_columns(g, 0, h, h, win)
        elif y < rows:
            _next_columns(g, y, c, h, core)
            _next_columns(g, y, h, h, win)
        if y < rows:
            _box_depth(core, win, c, h, below[1 : n + 1])
        else:
            below[:] = np.float32(-np.inf)
        if y > 0:
            here = d[y % 3]
            k = _row_peaks(d[(y - 1) % 3], here, below, gate[(y - 1) // tile], tile, found)
            while count + k > depth.size:
                xy = np.concatenate((xy, np.empty_like(xy)))
                depth = np.concatenate((depth, np.empty_like(depth)))
            for i in range(k):
                xy[count + i, 0], xy[count + i, 1], depth[count + i] = found[i], y - 1, here[found[i] + 1]
            count += k
    return xy[:count], depth[:count]


@nb.njit(cache=True, nogil=True)
def fill_rows(g: Any) -> None:
    """Replace NaN by the straight line between the finite neighbours of its row (0 in a row without any)."""
    rows, n = g.shape
    for y in range(rows):
        left = -1
        for x in range(n + 1):
            if x < n and g[y, x] != g[y, x]:
                continue
            if x - left > 1:
                a = g[y, left] if left >= 0 else (g[y, x] if x < n else np.float32(0.0))
                b = g[y, x] if x < n else a
                for i in range(left + 1, x):
                    g[y, i] = a + (b - a) * np.float32((i - left) / (x - left))
            left = x


@nb.njit(cache=True, nogil=True)
def merit_rows(g: Any, runs: Any, soft: Any, core_runs: Any, core_soft: Any, sums: Any, out: Any) -> None:
    """Merit of every pixel whose window lies inside the image; the others are left as they are.

    A disc is a pile of rows of full pixels (`runs`: half width per row, -1 for none), summed from running sums,
    and of soft edge pixels (`soft`: columns dx, dy, weight). `sums` = (n, sxx, t1, tt) of the window and the hole.
    """
    rows, n = g.shape
    half, k_half = runs.size // 2, core_runs.size // 2
    size = runs.size
    p = np.zeros((size, 3, n + 1))
    acc = np.empty((5, n - 2 * half))
    x = np.arange(half, n - half).astype(np.float64)
    big_n, sxx, t1, tt = sums
    free = tt - t1 * t1 / big_n
    for y in range(rows):
        q0, q1, q2, row = p[y % size, 0], p[y % size, 1], p[y % size, 2], g[y]
        for i in range(n):
            v = float(row[i])
            q0[i + 1], q1[i + 1], q2[i + 1] = q0[i] + v, q1[i] + v * i, q2[i] + v * v
        if y < size - 1:
            continue
        yc = y - half
        _disc_sums(g, p, yc, runs, soft, half, acc)
        _core_sums(g, p, yc, core_runs, core_soft, half, k_half, acc[4])
        for i in range(n - 2 * half):
            s1 = acc[0, i]
            sx = acc[1, i] - x[i] * s1
            total = acc[3, i] - s1 * s1 / big_n - (sx * sx + acc[2, i] * acc[2, i]) / sxx
            depth = (t1 * s1 / big_n - acc[4, i]) / free
            if depth > 0.0:
                out[yc, half + i] = math.sqrt(max(total - depth * depth * free, 0.0) / (depth * depth * tt))
            else:
                out[yc, half + i] = math.inf


@nb.njit(cache=True, nogil=True)
def _disc_sums(g: Any, p: Any, yc: int, runs: Any, soft: Any, half: int, acc: Any) -> None:
    """Sums of g, x g, dy g, g^2 over the window of every pixel of row yc, into acc[0:4]."""
    n, size = acc.shape[1], runs.size
    s0, s1, s2, s3 = acc[0], acc[1], acc[2], acc[3]
    acc[:4] = 0.0
    for k in range(size):
        dy, a = k - half, runs[k]
        if a < 0:
            continue
        q = p[(yc + dy) % size]
        lo, hi = half - a, half + a + 1
        u0, v0, u1, v1, u3, v3 = (
            q[0, hi : hi + n],
            q[0, lo : lo + n],
            q[1, hi : hi + n],
            q[1, lo : lo + n],
            q[2, hi : hi + n],
            q[2, lo : lo + n],
        )
        for i in range(n):
            d = u0[i] - v0[i]
            s0[i] += d
            s1[i] += u1[i] - v1[i]
            s2[i] += dy * d
            s3[i] += u3[i] - v3[i]
    for k in range(soft.shape[0]):
        dx, dy, q0 = int(soft[k, 0]), int(soft[k, 1]), soft[k, 2]
        v = g[yc + dy, half + dx : half + dx + n]
        for i in range(n):
            d = q0 * v[i]
            s0[i] += d
            s1[i] += d * (half + dx + i)
            s2[i] += dy * d
            s3[i] += d * v[i]


@nb.njit(cache=True, nogil=True)
def _core_sums(g: Any, p: Any, yc: int, runs: Any, soft: Any, half: int, k_half: int, s: Any) -> None:
    """Sum of g over the hole of every pixel of row yc."""
    n, size = s.size, p.shape[0]
    s[:] = 0.0
    for k in range(runs.size):
        a = runs[k]
        if a < 0:
            continue
        q = p[(yc + k - k_half) % size, 0]
        u, v = q[half + a + 1 : half + a + 1 + n], q[half - a : half - a + n]
        for i in range(n):
            s[i] += u[i] - v[i]
    for k in range(soft.shape[0]):
        dx, dy, q0 = int(soft[k, 0]), int(soft[k, 1]), soft[k, 2]
        v = g[yc + dy, half + dx : half + dx + n]
        for i in range(n):
            s[i] += q0 * v[i]


@nb.njit(cache=True, nogil=True)
def merit_pixels(g: Any, where: Any, r0: float, min_core: float, out: Any) -> None:
    """Merit of single pixels (K, 2: row, column) by the general way: partial windows and dead pixels."""
    half = int(2.0 * r0 + 0.5) + 1
    w, e, inv = np.empty((2 * half + 1, 2 * half + 1)), np.empty((2 * half + 1, 2 * half + 1)), np.empty(6)
    for k in range(where.shape[0]):
        y, x = where[k, 0], where[k, 1]
        out[y, x] = merit_at(g, float(x), float(y), r0, min_core, w, e, inv)[0]
