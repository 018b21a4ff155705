"""Dead pixels. Private; arrays in, arrays out."""

from __future__ import annotations

from typing import Any

import numpy as np

from windmark.detection._kernels.spot import grown
from windmark.geometry._jit import nb


@nb.njit(cache=True, nogil=True)
def _stands_out(left: Any, right: Any, above: Any, below: Any, here: Any, limit: Any, ratio: Any) -> Any:
    """Number of pixels that leave the range of four neighbours by more than limit and ratio times it; vectorises.

    A dead pixel does: of eight neighbours the range is not smaller, and what leaves it leaves that of four.
    """
    count = np.int32(0)
    for i in range(here.size):
        v = here[i]
        low, high = (left[i], right[i]) if left[i] < right[i] else (right[i], left[i])
        floor, top = (above[i], below[i]) if above[i] < below[i] else (below[i], above[i])
        low = low if low < floor else floor
        high = high if high > top else top
        over, under = v - high, low - v
        excess = over if over > under else under
        count += np.int32((excess > limit) & (excess > ratio * (high - low)))
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
    limit, share = np.float32(0.999 * least), np.float32(0.999 * ratio)
    for y in range(1, rows - 1):
        above, here, below = g[y - 1], g[y], g[y + 1]
        if _stands_out(here[: n - 2], here[2:], above[1 : n - 1], below[1 : n - 1], here[1 : n - 1], limit, share) == 0:
            continue
        for x in range(1, n - 1):
            a, b = here[x] - here[x - 1], here[x] - here[x + 1]
            if ((a > limit and b > limit) or (a < -limit and b < -limit)) and _is_dead(g, y, x, least, ratio):
                if count == out.shape[0]:
                    out = grown(out)
                out[count, 0], out[count, 1] = y, x
                count += 1
    return out[:count]
