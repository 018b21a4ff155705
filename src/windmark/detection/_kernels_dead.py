"""Dead pixels. Private; arrays in, arrays out."""

from __future__ import annotations

from typing import Any

import numpy as np

from windmark.geometry._jit import nb


@nb.njit(cache=True, nogil=True)
def dead_pixels(g: Any, least: float, ratio: float) -> tuple[Any, Any]:
    """Rows and columns of the pixels that leave the range of their 8 neighbours by `least` and by `ratio` times it.

    Nothing that an optic has imaged does that. Pixels of the border, and next to a NaN, are left alone.
    """
    rows, n = g.shape
    out, count = np.empty((2, 64), np.int64), 0
    limit = np.float32(least)
    for y in range(1, rows - 1):
        here = g[y]
        for x in range(1, n - 1):
            v = here[x]
            a, b = v - here[x - 1], v - here[x + 1]
            if (a > limit and b > limit) or (a < -limit and b < -limit):
                low, high, known = np.float32(np.inf), np.float32(-np.inf), True
                for j in range(-1, 2):
                    for i in range(-1, 2):
                        w = g[y + j, x + i]
                        known = known and w == w
                        if i != 0 or j != 0:
                            low, high = min(low, w), max(high, w)
                excess = max(v - high, low - v)
                if known and excess > least and excess > ratio * (high - low):
                    if count == out.shape[1]:
                        out = np.concatenate((out, np.empty_like(out)), axis=1)
                    out[0, count], out[1, count] = y, x
                    count += 1
    return out[0, :count], out[1, :count]
