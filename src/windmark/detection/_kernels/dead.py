"""Dead pixels. Private; arrays in, arrays out."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection._kernels.spot import grown
from windmark.geometry._jit import nb


@nb.njit(cache=True, nogil=True)
def stands_out(left: Any, right: Any, above: Any, below: Any, here: Any, limit: Any, ratio: Any, pairs: bool) -> Any:
    """Number of pixels that leave the range of four neighbours, of `pairs` but for one of them, by more than limit and
    ratio times it; vectorises.

    A dead pixel does: of eight neighbours the range is not smaller, and what leaves it leaves that of four.
    """
    count = np.int32(0)
    for i in range(here.size):
        v = here[i]
        low, high = (left[i], right[i]) if left[i] < right[i] else (right[i], left[i])
        floor, top = (above[i], below[i]) if above[i] < below[i] else (below[i], above[i])
        least, most = (low if low < floor else floor), (high if high > top else top)
        last, first = least, most
        if pairs:
            inner, outer = (high if high < top else top), (low if low > floor else floor)
            first, last = (inner if inner > outer else outer), (inner if inner < outer else outer)
        over, under = v - first, last - v
        wide = first - least if over > under else most - last
        excess = over if over > under else under
        count += np.int32((excess > limit) & (excess > ratio * wide))
    return count


@nb.njit(cache=True, nogil=True)
def _excess(g: Any, y: int, x: int, besides: int) -> Any:
    """How far a pixel leaves the range of its 8 neighbours above and below, that range, and which neighbours are the
    farthest above and below; without the neighbour `besides` (0 to 8, 4: with all), which has to be as far out as the
    pixel is. NaN where one of them is.
    """
    v, low, high, lowest, highest = g[y, x], np.inf, -np.inf, 4, 4
    for k in range(9):
        w = g[y - 1 + k // 3, x - 1 + k % 3]
        if w != w:
            return math.nan, math.nan, math.nan, lowest, highest
        if k not in (4, besides):
            if w < low:
                low, lowest = w, k
            if w > high:
                high, highest = w, k
    return v - high, low - v, high - low, lowest, highest


@nb.njit(cache=True, nogil=True)
def dead_pixels(g: Any, least: float, ratio: float, pair_ratio: float, corner_ratio: float) -> Any:
    """Pixels (K, 3: row, column, 0) that leave the range of their 8 neighbours by `least` and by `ratio` times it; and
    those which, with one neighbour that does so, too, leave that of all others by `pair_ratio` times it (0: not asked).

    Nothing that an optic has imaged does that. Pixels of the border, and next to a NaN, are left alone.

    With `corner_ratio` above 0 also corners of what may be a group, with -1 or 1 in place of 0: pixels that leave the
    range of the two next ones above and the two to the left, or of those below and to the right, by `least` and by
    that many times it, and by half at least of what the next ones on the other side do.
    """
    rows, n = g.shape
    out, count, pairs = np.empty((64, 3), np.int64), 0, pair_ratio > 0.0
    limit, share, corner_share = np.float32(0.999 * least), np.float32(0.999 * ratio), np.float32(corner_ratio)
    for y in range(1, rows - 1):
        for part in range(2 * ((n + 255) // 256) if corner_ratio > 0.0 and 2 < y < rows - 3 else 0):
            side = 2 * (part % 2) - 1
            first, last = max(part // 2 * 256, 2), min(part // 2 * 256 + 256, n - 2)
            here, one, two = g[y, first:last], g[y + side, first:last], g[y + 2 * side, first:last]
            next_one, next_two = g[y, first + side : last + side], g[y, first + 2 * side : last + 2 * side]
            if last <= first or stands_out(next_one, next_two, one, two, here, limit, corner_share, False) == 0:
                continue
            for x in range(first, last):
                v, a, b, c, d = g[y, x], g[y, x + side], g[y, x + 2 * side], g[y + side, x], g[y + 2 * side, x]
                low, high = min(a, b, c, d), max(a, b, c, d)
                excess, before, sign = max(v - high, low - v), 0.5 * (a + c), 1 if v > high else -1
                inner = max(sign * (g[y, x - side] - before), sign * (g[y - side, x] - before))
                if excess > max(limit, corner_share * (high - low)) and inner < 2.0 * sign * (v - before):
                    if count == out.shape[0]:
                        out = grown(out)
                    out[count, 0], out[count, 1], out[count, 2] = y, x, side
                    count += 1
        above, here, below = g[y - 1, 1 : n - 1], g[y], g[y + 1, 1 : n - 1]
        if stands_out(here[: n - 2], here[2:], above, below, here[1 : n - 1], limit, share, pairs) == 0:
            continue
        for x in range(1, n - 1):
            a, b = here[x] - here[x - 1], here[x] - here[x + 1]
            up, down = int(a > limit) + int(b > limit), int(a < -limit) + int(b < -limit)
            if max(up, down) + pairs < 2:
                continue
            over, under, wide, lowest, highest = _excess(g, y, x, 4)
            dead = max(over, under) > least and max(over, under) > ratio * wide
            for other in (highest, lowest) if pairs and not dead and wide > least else (4, 4):
                j, i = y - 1 + other // 3, x - 1 + other % 3
                if other == 4 or not (0 < j < rows - 1 and 0 < i < n - 1):
                    continue
                mine, its = _excess(g, y, x, other), _excess(g, j, i, 8 - other)
                own, partner = (mine[0], its[0]) if other == highest else (mine[1], its[1])
                dead |= min(own, partner) > least and own > pair_ratio * mine[2] and partner > pair_ratio * its[2]
            if dead:
                if count == out.shape[0]:
                    out = grown(out)
                out[count, 0], out[count, 1], out[count, 2] = y, x, 0
                count += 1
    return out[:count]
