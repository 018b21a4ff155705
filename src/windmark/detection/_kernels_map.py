"""Whole-image passes: the coarse depth filter and the merit map. Private; arrays in, arrays out.

Loops run along rows on contiguous views, so that they vectorise.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection._kernels import merit_at
from windmark.geometry._jit import nb


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

    A disc is a pile of rows of full pixels (`runs`: half width per row, -1 for none), summed from running sums, and
    of soft edge pixels (`soft`: columns |dx|, |dy|, weight of each of the four (+-dx, +-dy)). `sums` = (n, sxx, t1, tt)
    of the window and the hole.
    """
    rows, n = g.shape
    half, size = runs.size // 2, runs.size
    p = np.zeros((size, 3, n + 1))
    acc = np.empty((5, n - 2 * half))
    big_n, sxx, t1, tt = sums
    for y in range(rows):
        q0, q1, q2, row = p[y % size, 0], p[y % size, 1], p[y % size, 2], g[y]
        for i in range(n):
            v = float(row[i])
            q0[i + 1], q1[i + 1], q2[i + 1] = q0[i] + v, q1[i] + v * i, q2[i] + v * v
        if y < size - 1:
            continue
        yc = y - half
        _disc_sums(g, p, yc, runs, soft, half, acc)
        _core_sums(g, p, yc, core_runs, core_soft, half, acc[4])
        _merit_row(acc, big_n, sxx, t1, tt, out[yc, half : n - half])


@nb.njit(cache=True, nogil=True)
def _merit_row(acc: Any, n: float, sxx: float, t1: float, tt: float, out: Any) -> None:
    """Merit from the sums over window and hole; inf where the depth is not positive."""
    free = tt - t1 * t1 / n
    s0, s1, s2, s3, core = acc[0], acc[1], acc[2], acc[3], acc[4]
    for i in range(out.size):
        total = s3[i] - s0[i] * s0[i] / n - (s1[i] * s1[i] + s2[i] * s2[i]) / sxx
        depth = (t1 * s0[i] / n - core[i]) / free
        if depth > 0.0:
            out[i] = math.sqrt(max(total - depth * depth * free, 0.0) / tt) / depth
        else:
            out[i] = math.inf


@nb.njit(cache=True, nogil=True)
def _add_run(ahead: Any, behind: Any, factor: float, out: Any) -> None:
    """Add a run's sums, the difference of two running sums; few arrays in one loop, so that it vectorises."""
    for i in range(out.size):
        out[i] += factor * (ahead[i] - behind[i])


@nb.njit(cache=True, nogil=True)
def _add_four(a: Any, b: Any, c: Any, d: Any, wa: float, wb: float, wc: float, wd: float, out: Any) -> None:
    """Add a weighted sum of four shifted rows."""
    for i in range(out.size):
        out[i] += wa * a[i] + wb * b[i] + wc * c[i] + wd * d[i]


@nb.njit(cache=True, nogil=True)
def _add_squares(a: Any, b: Any, c: Any, d: Any, weight: float, out: Any) -> None:
    """Add the weighted sum of squares of four shifted rows."""
    for i in range(out.size):
        e, f, u, v = float(a[i]), float(b[i]), float(c[i]), float(d[i])
        out[i] += weight * (e * e + f * f + u * u + v * v)


@nb.njit(cache=True, nogil=True)
def _disc_sums(g: Any, p: Any, yc: int, runs: Any, soft: Any, half: int, acc: Any) -> None:
    """Sums of g, dx g, dy g, g^2 over the window of every pixel of row yc, into acc[0:4]."""
    n, size = acc.shape[1], runs.size
    acc[:4] = 0.0
    for k in range(size):
        a = runs[k]
        if a < 0:
            continue
        q = p[(yc + k - half) % size]
        ahead, behind = q[:, half + a + 1 : half + a + 1 + n], q[:, half - a : half - a + n]
        _add_run(ahead[0], behind[0], 1.0, acc[0])
        _add_run(ahead[1], behind[1], 1.0, acc[1])
        _add_run(ahead[0], behind[0], float(k - half), acc[2])
        _add_run(ahead[2], behind[2], 1.0, acc[3])
    s0, s1 = acc[0], acc[1]
    for i in range(n):
        s1[i] -= (half + i) * s0[i]
    for k in range(soft.shape[0]):
        w, wx, wy = soft[k, 2], soft[k, 2] * soft[k, 0], soft[k, 2] * soft[k, 1]
        dx, dy = int(soft[k, 0]), int(soft[k, 1])
        left, right, up, down = half - dx, half + dx, g[yc - dy], g[yc + dy]
        a, b, c, d = up[left : left + n], up[right : right + n], down[left : left + n], down[right : right + n]
        _add_four(a, b, c, d, w, w, w, w, acc[0])
        _add_four(a, b, c, d, -wx, wx, -wx, wx, acc[1])
        _add_four(a, b, c, d, -wy, -wy, wy, wy, acc[2])
        _add_squares(a, b, c, d, w, acc[3])


@nb.njit(cache=True, nogil=True)
def _core_sums(g: Any, p: Any, yc: int, runs: Any, soft: Any, half: int, out: Any) -> None:
    """Sum of g over the hole of every pixel of row yc."""
    n, size = out.size, p.shape[0]
    out[:] = 0.0
    for k in range(runs.size):
        a = runs[k]
        if a >= 0:
            q = p[(yc + k - runs.size // 2) % size, 0]
            _add_run(q[half + a + 1 : half + a + 1 + n], q[half - a : half - a + n], 1.0, out)
    for k in range(soft.shape[0]):
        dx, dy, w = int(soft[k, 0]), int(soft[k, 1]), soft[k, 2]
        left, right, up, down = half - dx, half + dx, g[yc - dy], g[yc + dy]
        a, b, c, d = up[left : left + n], up[right : right + n], down[left : left + n], down[right : right + n]
        _add_four(a, b, c, d, w, w, w, w, out)


@nb.njit(cache=True, nogil=True)
def merit_pixels(g: Any, where: Any, r0: float, min_core: float, out: Any) -> None:
    """Merit of single pixels (K, 2: row, column) by the general way: partial windows and dead pixels."""
    half = int(2.0 * r0 + 0.5) + 1
    w, e, inv = np.empty((2 * half + 1, 2 * half + 1)), np.empty((2 * half + 1, 2 * half + 1)), np.empty(6)
    for k in range(where.shape[0]):
        y, x = where[k, 0], where[k, 1]
        out[y, x] = merit_at(g, float(x), float(y), r0, min_core, w, e, inv)[0]
