"""Dead pixels. Private; arrays in, arrays out."""

from __future__ import annotations

from typing import Any

import numpy as np

from windmark.detection._kernels.spot import grown
from windmark.geometry._jit import nb


@nb.njit(cache=True, nogil=True)
def _row_peaks(left: Any, here: Any, right: Any, limit: Any) -> Any:
    """Number of pixels that leave both neighbours of their row by more than the limit; vectorises."""
    count = np.int32(0)
    for i in range(here.size):
        a, b = here[i] - left[i], here[i] - right[i]
        count += np.int32(((a > limit) & (b > limit)) | ((a < -limit) & (b < -limit)))
    return count


@nb.njit(cache=True, nogil=True)
def _is_dead(g: Any, y: int, x: int, least: float, ratio: float) -> bool:
    """Whether a pixel leaves the range of its 8 neighbours, none of which is NaN."""
    v, low, high = g[y, x], np.inf, -np.inf
    for j in range(-1, 2):
        for i in range(-1, 2):
            w = g[y + j, x + i]
            if w != w:
                return False
            if i != 0 or j != 0:
                low, high = min(low, w), max(high, w)
    excess = max(v - high, low - v)
    return excess > least and excess > ratio * (high - low)


@nb.njit(cache=True, nogil=True)
def dead_pixels(g: Any, least: float, ratio: float) -> Any:
    """Pixels (K, 2: row, column) that leave the range of their 8 neighbours by `least` and by `ratio` times it.

    Nothing that an optic has imaged does that. Pixels of the border, and next to a NaN, are left alone.
    """
    rows, n = g.shape
    out, count = np.empty((64, 2), np.int64), 0
    limit = np.float32(least)
    for y in range(1, rows - 1):
        here = g[y]
        left = _row_peaks(here[: n - 2], here[1 : n - 1], here[2:], limit)
        x = 1
        while left > 0:
            a, b = here[x] - here[x - 1], here[x] - here[x + 1]
            if (a > limit and b > limit) or (a < -limit and b < -limit):
                left -= 1
                if _is_dead(g, y, x, least, ratio):
                    if count == out.shape[0]:
                        out = grown(out)
                    out[count, 0], out[count, 1] = y, x
                    count += 1
            x += 1
    return out[:count]
