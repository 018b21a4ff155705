"""Whole-image passes of the search: noise tiles, binning, the coarse depth. Private; arrays in, arrays out.

Loops run along rows on contiguous views, each over few arrays, so that they vectorise. Twins in
tests/detection/test_search.py.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from windmark.detection._kernels.spot import grown
from windmark.geometry._jit import nb


@nb.njit(cache=True, nogil=True)
def _count_missing(row: Any) -> Any:
    count = np.int32(0)
    for i in range(row.size):
        count += np.int32(row[i] != row[i])
    return count


@nb.njit(cache=True, nogil=True)
def fill_row(row: Any, out: Any) -> None:
    """Copy a row; NaN becomes the straight line between the finite neighbours (0 in a row without any)."""
    n = row.size
    for i in range(n):
        out[i] = row[i]
    if _count_missing(row) == 0:
        return
    left = -1
    for x in range(n + 1):
        if x < n and row[x] != row[x]:
            continue
        if x - left > 1:
            a = row[left] if left >= 0 else (row[x] if x < n else np.float32(0.0))
            b = row[x] if x < n else a
            for i in range(left + 1, x):
                out[i] = a + (b - a) * np.float32((i - left) / (x - left))
        left = x


@nb.njit(cache=True, nogil=True)
def fill_rows(g: Any) -> Any:
    """`fill_row` for all rows."""
    out = np.empty_like(g)
    for y in range(g.shape[0]):
        fill_row(g[y], out[y])
    return out


@nb.njit(cache=True, nogil=True)
def _add(row: Any, out: Any) -> None:
    for i in range(out.size):
        out[i] += row[i]


@nb.njit(cache=True, nogil=True)
def bin_mean(g: Any, factor: int) -> Any:
    """Mean over factor x factor blocks of the filled image; the remainder at right and bottom is left out."""
    h, w = g.shape[0] // factor, g.shape[1] // factor
    out = np.empty((h, w), np.float32)
    row, col = np.empty(g.shape[1], np.float32), np.empty(g.shape[1], np.float32)
    scale = np.float32(1.0 / factor**2)
    for y in range(h):
        fill_row(g[y * factor], col)
        for k in range(1, factor):
            fill_row(g[y * factor + k], row)
            _add(row, col)
        for x in range(w):
            s = np.float32(0.0)
            for k in range(factor):
                s += col[x * factor + k]
            out[y, x] = s * scale
    return out


@nb.njit(cache=True, nogil=True)
def _count_up_to(bits: Any, limit: Any) -> Any:
    count = np.int32(0)
    for i in range(bits.size):
        count += np.int32(bits[i] <= limit)
    return count


@nb.njit(cache=True, nogil=True)
def ranked(values: Any, k: int) -> Any:
    """The k-th smallest (from 0) of float32 numbers, none negative; the first is overwritten.

    By bisection over their bits, which sort as the numbers do: counting vectorises, selection by swaps takes 3 times as
    long.
    """
    bits = values.view(np.int32)
    low, high = np.int32(-1), np.int32(0x7F800000)
    while high - low > 1:
        middle = np.int32(low + (high - low) // 2)
        if _count_up_to(bits, middle) > k:
            high = middle
        else:
            low = middle
    bits[0] = high
    return values[0]


@nb.njit(cache=True, nogil=True)
def bend_quartiles(g: Any, rows: Any, cols: Any, lag: int, least: int, out: Any) -> None:
    """Lower quartile of |g[x - lag] - 2 g[x] + g[x + lag]| over the pixels of each tile; NaN below `least` of them.

    Parameters
    ----------
    rows : (down, R) rows of the tiles' pixels
    cols : (across, C) their columns
    out : (down, across)
    """
    bend, last = np.empty(rows.shape[1] * cols.shape[1], np.float32), g.shape[1] - 1
    for j in range(rows.shape[0]):
        for i in range(cols.shape[0]):
            n = 0
            for k in range(rows.shape[1]):
                row = g[rows[j, k]]
                for m in range(cols.shape[1]):
                    x = cols[i, m]
                    bend[n] = abs(row[x - lag] - np.float32(2.0) * row[x] + row[min(x + lag, last)])
                    n += bend[n] == bend[n]
            out[j, i] = ranked(bend[:n], n // 4) if n >= least else np.nan


@nb.njit(cache=True, nogil=True)
def _next_sums(new: Any, old: Any, sums: Any) -> None:
    for i in range(sums.size):
        sums[i] += new[i] - old[i]


@nb.njit(cache=True, nogil=True)
def _both(win: Any, core: Any, a: Any, b: Any, out: Any) -> None:
    for i in range(out.size):
        out[i] = a * win[i] - b * core[i]


@nb.njit(cache=True, nogil=True)
def _three(a: Any, b: Any, c: Any, out: Any) -> None:
    for i in range(out.size):
        out[i] = a[i] + (b[i] + c[i])


@nb.njit(cache=True, nogil=True)
def _add_pairs(a: Any, b: Any, wa: Any, c: Any, d: Any, wc: Any, out: Any) -> None:
    for i in range(out.size):
        out[i] += wa * (a[i] + b[i]) + wc * (c[i] + d[i])


@nb.njit(cache=True, nogil=True)
def _box_depth(win: Any, both: Any, c: int, h: int, weight: Any, out: Any) -> None:
    """Sum over the box less the inner one of weight * win, plus the sum over the inner one of both; out starts at h."""
    n = out.size
    _three(both[h : h + n], both[h - 1 : h - 1 + n], both[h + 1 : h + 1 + n], out)
    for k in range(2, h + 1, 2):
        one, a = np.float32(1.0), both if k <= c else win
        m = min(k + 1, h)
        b = both if m <= c else win
        wb = np.float32(0.0) if m == k else (one if m <= c else weight)
        _add_pairs(
            a[h - k : h - k + n], a[h + k : h + k + n], one if k <= c else weight,
            b[h - m : h - m + n], b[h + m : h + m + n], wb, out,
        )  # fmt: skip


@nb.njit(cache=True, nogil=True)
def _row_peaks(above: Any, here: Any, below: Any, limit: Any, tile: int, out: Any) -> int:
    """Columns of the local maxima (3 x 3) of one row above the limit of their tile; rows have a margin of 1."""
    n, count = here.size - 2, 0
    for t in range(limit.size):
        floor, part, high = limit[t], here[t * tile + 1 : min((t + 1) * tile, n) + 1], np.int32(0)
        for i in range(part.size):
            high += np.int32(part[i] > floor)
        if high == 0:
            continue
        for i in range(t * tile + 1, min((t + 1) * tile, n) + 1):
            v = here[i]
            if v > floor:
                side = max(here[i + 1], max(below[i - 1], max(below[i], below[i + 1])))
                if v >= side and v > max(here[i - 1], max(above[i - 1], max(above[i], above[i + 1]))):
                    out[count] = i - 1
                    count += 1
    return count


@nb.njit(cache=True, nogil=True)
def _padded_row(g: Any, y: int, h: int, out: Any) -> None:
    """Row y, filled, its ends repeated over margins of width h; beyond the image the border row."""
    n = g.shape[1]
    fill_row(g[min(max(y, 0), g.shape[0] - 1)], out[h : h + n])
    out[:h] = out[h]
    out[h + n :] = out[h + n - 1]


@nb.njit(cache=True, nogil=True)
def depth_peaks(g: Any, c: int, h: int, gate: Any, tile: int) -> Any:
    """Local maxima (3 x 3) of the box depth above the gate of their tile: (K, 3) columns x, y, depth.

    The box depth is the mean of the box of half width h less the inner one (half width c < h), minus the mean of the
    inner box. Column sums go from row to row; their rows of the last 2 h + 2 are kept, filled and padded. The depth is
    taken times the numbers of both means' pixels: sums of 8-bit grey levels stay whole numbers.
    """
    rows, n = g.shape
    n_core, n_ring = (2 * c + 1) ** 2, (2 * h + 1) ** 2 - (2 * c + 1) ** 2
    scale, wide, size = 1.0 / (n_core * n_ring), n + 2 * h, 2 * h + 2
    ring = np.empty((size, wide), np.float32)
    core, win, both = np.zeros(wide, np.float32), np.zeros(wide, np.float32), np.empty(wide, np.float32)
    d, found = np.full((3, n + 2), np.float32(-np.inf)), np.empty(n, np.int64)
    out, count = np.empty((1024, 3)), 0
    limit = gate * np.float32(n_core * n_ring)
    for k in range(-h, h):
        _padded_row(g, k, h, ring[k % size])
        _add(ring[k % size], win)
        if -c - 1 <= k < c:
            _add(ring[k % size], core)
    ring[h + 1] = np.float32(0.0)  # taken off in row 0, where nothing has to go
    for y in range(rows + 1):
        below = d[(y + 1) % 3]
        if y < rows:
            _padded_row(g, y + h, h, ring[(y + h) % size])
            _next_sums(ring[(y + h) % size], ring[(y - h - 1) % size], win)
            _next_sums(ring[(y + c) % size], ring[(y - c - 1) % size], core)
            _both(win, core, np.float32(n_core), np.float32(n_core + n_ring), both)
            _box_depth(win, both, c, h, np.float32(n_core), below[1 : n + 1])
        else:
            below[:] = np.float32(-np.inf)
        if y > 0:
            here = d[y % 3]
            k = _row_peaks(d[(y - 1) % 3], here, below, limit[(y - 1) // tile], tile, found)
            while count + k > out.shape[0]:
                out = grown(out)
            for i in range(k):
                x = found[i]
                out[count + i, 0], out[count + i, 1], out[count + i, 2] = x, y - 1, here[x + 1] * scale
            count += k
    return out[:count]
