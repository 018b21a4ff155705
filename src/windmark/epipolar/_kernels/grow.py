"""A point hypothesis grown through all views: predict, look for the one spot there, take it, predict better."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.epipolar._kernels.algebra import (
    between_rays,
    distance2,
    image_of,
    inverse3,
    kalman_step,
    pose_noise,
    spread,
)
from windmark.epipolar._kernels.arrays import Spots, Stations
from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

NONE, AMBIGUOUS, OUTSIDE = -1, -2, -3
"""In place of a spot: none near the prediction; several; the prediction is not in the picture."""
CROWDED = 0.5
"""At first only predictions so narrow that they hold fewer spots by chance are used."""
RIVAL = 9.0
"""A second spot less than this much worse (difference of the squared distances) leaves the choice open."""
LOOSE = 0.5
"""The first depth is not known better than this part of it: a start for the two rays' own information."""
REPEATS, REMEMBERED = 4, 8
"""A pair whose spots so many points have already, both of them, is not grown: it would be that point once more, as of n
pictures of a point n (n - 1) / 2 pairs are. Of each spot so many points are remembered."""


@nb.njit(cache=True, nogil=True)
def grow_points(
    stations: Stations, spots: Spots, free: Mask, rows: Ints, start: Ints, gate2: float, patience: int, xyz: Array,
    cov: Array, gain: Array,
) -> None:  # fmt: skip
    """Grow H hypotheses: ``rows`` (H, V) hold the spots that each starts with and then those that it has.

    The most promising pair first: of those that are in `REPEATS` points already none is grown. ``start`` (H,) is the
    view whose neighbours come first; ``xyz`` (H, 3), ``cov`` (H, 3, 3) and ``gain`` (H,), the
    sum of log(p / q) over the spots taken (p the density of the spot there when it is the point's, q that of spots by
    chance), are results; gain is -inf where there is no point, or none of its own, the pair's spots are not in it at
    the end, or more than ``patience`` more views have, at first sight, no spot than have one.
    """
    views = len(stations.near)
    each = np.empty(views)
    points, number = np.empty((len(spots.views), REMEMBERED), np.int64), np.zeros(len(spots.views), np.int64)
    for h in range(len(rows)):
        x, c, row = xyz[h], cov[h], rows[h]
        gain[h] = -math.inf
        s, t = -1, -1
        for v in range(views):
            if row[v] >= 0:
                s, t = (row[v], t) if s < 0 else (s, row[v])
        met = 0
        for k in range(number[s]):
            met += rows[points[s, k], spots.views[t]] == t
        if met >= REPEATS:
            continue
        for v in range(views):
            each[v] = 0.0
        if not place(stations, spots, s, t, row, x, c):
            continue
        missing = 0
        for sweep in range(2):
            for n in range(views):
                v = stations.order[start[h], n]
                if row[v] < 0 and missing <= patience:
                    each[v] = look(stations, spots, free, v, x, c, row, gate2, sweep)
                    if sweep == 0:
                        missing += (row[v] == NONE) - (row[v] >= 0)
        if missing > patience:
            continue
        if not settle(stations, spots, row, gate2, x, c):
            continue
        if row[spots.views[s]] != s or row[spots.views[t]] != t:
            continue
        gain[h] = 0.0
        for v in range(views):
            if row[v] >= 0:
                gain[h] += each[v]
                if number[row[v]] < REMEMBERED:
                    points[row[v], number[row[v]]] = h
                    number[row[v]] += 1


@nb.njit(cache=True, nogil=True)
def place(stations: Stations, spots: Spots, s: int, t: int, row: Ints, x: Array, c: Array) -> bool:
    """The point and its covariance from the two spots of a row: where their rays meet, then Gauss-Newton."""
    a, b = spots.views[s], spots.views[t]
    if not between_rays(
        stations.rotation[a], stations.center[a], spots.xy[s, 0], spots.xy[s, 1],
        stations.rotation[b], stations.center[b], spots.xy[t, 0], spots.xy[t, 1], x,
    ):  # fmt: skip
        return False
    return adjust(stations, spots, row, x, c, LOOSE) and adjust(stations, spots, row, x, c, LOOSE)


@nb.njit(cache=True, nogil=True)
def adjust(stations: Stations, spots: Spots, row: Ints, x: Array, c: Array, loose: float) -> bool:
    """One Gauss-Newton step on the row's spots; ``loose`` > 0 holds the point to so large a part of its depth."""
    h, g, j, noise = np.zeros((3, 3)), np.zeros(3), np.empty((2, 3)), np.empty(3)
    for v in range(len(row)):
        if row[v] < 0:
            continue
        s = row[v]
        u, w, z = image_of(stations.rotation[v], stations.translation[v], x, j)
        if z < 0.0:
            return False
        if loose > 0.0:
            for k in range(3):
                h[k, k] += 1.0 / (loose * z) ** 2
        pose_noise(stations.pose_cov[v], u, w, z, noise)
        xx, xy, yy = noise[0] + spots.cov[s, 0], noise[1] + spots.cov[s, 1], noise[2] + spots.cov[s, 2]
        determinant = xx * yy - xy * xy
        du, dw = spots.xy[s, 0] - u, spots.xy[s, 1] - w
        for i in range(3):
            p = (yy * j[0, i] - xy * j[1, i]) / determinant
            q = (xx * j[1, i] - xy * j[0, i]) / determinant
            g[i] += p * du + q * dw
            for k in range(3):
                h[i, k] += p * j[0, k] + q * j[1, k]
    if not inverse3(h, c):
        return False
    for i in range(3):
        x[i] += c[i, 0] * g[0] + c[i, 1] * g[1] + c[i, 2] * g[2]
    return math.isfinite(x[0] + x[1] + x[2])


@nb.njit(cache=True, nogil=True)
def look(
    stations: Stations, spots: Spots, free: Mask, v: int, x: Array, c: Array, row: Ints, gate2: float, sweep: int
) -> float:
    """Look for the point's spot in one view, and take it; its log(p / q), 0 where there is none."""
    j, noise, p, q = np.empty((2, 3)), np.empty(3), np.empty(3), np.empty(3)
    u, w, z = image_of(stations.rotation[v], stations.translation[v], x, j)
    row[v] = OUTSIDE
    if (
        z < 0.0
        or u < stations.low[v, 0]
        or u > stations.high[v, 0]
        or w < stations.low[v, 1]
        or w > stations.high[v, 1]
    ):
        return 0.0
    row[v] = NONE
    pose_noise(stations.pose_cov[v], u, w, z, noise)
    width, height = spots.shape[v]
    cell, left, top = spots.cell[v], spots.origin[v, 0], spots.origin[v, 1]
    determinant = spread(c, j, noise, p)
    if sweep == 0 and math.pi * gate2 * math.sqrt(max(determinant, 0.0)) * spots.crowd[v] > CROWDED:
        row[v] = AMBIGUOUS
        return 0.0
    reach_u, reach_w = math.sqrt(gate2 * (p[0] + spots.widest[v])), math.sqrt(gate2 * (p[2] + spots.widest[v]))
    c0, c1 = int(max((u - reach_u - left) / cell, 0.0)), int(min((u + reach_u - left) / cell, width - 1.0))
    l0, l1 = int(max((w - reach_w - top) / cell, 0.0)), int(min((w + reach_w - top) / cell, height - 1.0))
    best, second, chosen = gate2, math.inf, -1
    for i in range(l0, l1 + 1):
        base = spots.base[v] + i * width
        for m in range(spots.first[base + c0], spots.first[base + c1 + 1]) if c1 >= c0 else range(0):
            s = spots.member[m]
            if not free[s]:
                continue
            for k in range(3):
                q[k] = p[k] + spots.cov[s, k]
            d2 = distance2(q, q[0] * q[2] - q[1] * q[1], spots.xy[s, 0] - u, spots.xy[s, 1] - w)
            if d2 < best:
                best, second, chosen = d2, best if chosen >= 0 else second, s
            elif d2 < second:
                second = d2
    if chosen < 0:
        return 0.0
    if second < gate2 + RIVAL and (sweep == 0 or second - best < RIVAL):
        row[v] = AMBIGUOUS
        return 0.0
    row[v] = chosen
    for k in range(3):
        p[k] += spots.cov[chosen, k]
    determinant = p[0] * p[2] - p[1] * p[1]
    kalman_step(x, c, j, p, determinant, spots.xy[chosen, 0] - u, spots.xy[chosen, 1] - w)
    return -0.5 * best - math.log(2.0 * math.pi * math.sqrt(determinant) * spots.density[chosen])


@nb.njit(cache=True, nogil=True)
def settle(stations: Stations, spots: Spots, row: Ints, gate2: float, x: Array, c: Array) -> bool:
    """The point from all its spots; those that do not fit leave, worst first. False where fewer than two remain."""
    j, noise = np.empty((2, 3)), np.empty(3)
    while True:
        count = 0
        for v in range(len(row)):
            count += row[v] >= 0
        if count < 2 or not (adjust(stations, spots, row, x, c, 0.0) and adjust(stations, spots, row, x, c, 0.0)):
            return False
        worst, at = gate2, -1
        for v in range(len(row)):
            if row[v] < 0:
                continue
            u, w, z = image_of(stations.rotation[v], stations.translation[v], x, j)
            if z < 0.0:
                return False
            pose_noise(stations.pose_cov[v], u, w, z, noise)
            for k in range(3):
                noise[k] += spots.cov[row[v], k]
            d2 = distance2(
                noise, noise[0] * noise[2] - noise[1] * noise[1], spots.xy[row[v], 0] - u, spots.xy[row[v], 1] - w
            )
            if d2 > worst:
                worst, at = d2, v
        if at < 0:
            return True
        row[at] = NONE
