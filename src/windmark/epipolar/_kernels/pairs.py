"""Pairs of spots of two views that may be one point: near each other's epipolar line, at a possible depth."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.epipolar._kernels.algebra import pose_noise
from windmark.epipolar._kernels.arrays import Spots, Stations
from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

LEAST_DEPTH = 1e-3
"""Of a point in one view, in units of its depth in the other."""


@nb.njit(cache=True, nogil=True)
def pair_candidates(
    stations: Stations, spots: Spots, free: Mask, pairs: Ints, gate2: float, depth: Array, found: Ints, gain: Array
) -> int:
    """Candidates (first spot, second spot) of all ``pairs`` (P, 2) of views; their number, which may exceed the room.

    ``gain`` is log(p / q): p the density of the second spot when it is the first one's point at any inverse depth
    that is allowed, q the density of spots there. ``depth`` (V,) is where the poses' uncertainty is judged.
    """
    count = 0
    noise, noise_b = np.empty((len(spots.views), 3)), np.zeros(3)
    for s in range(len(spots.views)):
        pose_noise(stations.pose_cov[spots.views[s]], spots.xy[s, 0], spots.xy[s, 1], depth[spots.views[s]], noise_b)
        for k in range(3):
            noise[s, k] = spots.cov[s, k] + noise_b[k]
    loudest = np.zeros(len(stations.near))
    for s in range(len(spots.views)):
        if free[s]:
            loudest[spots.views[s]] = max(loudest[spots.views[s]], noise[s, 0] + noise[s, 2])
    r, e, o = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for p in range(len(pairs)):
        a, b = pairs[p]
        far_out = 1.0
        for k in range(2):
            far_out += max(stations.low[b, k] ** 2, stations.high[b, k] ** 2)
        for i in range(3):
            o[i] = stations.translation[b, i]
            for k in range(3):
                r[i, k] = 0.0
                for n in range(3):
                    r[i, k] += stations.rotation[b, i, n] * stations.rotation[a, k, n]
        for i in range(3):
            for k in range(3):
                o[i] -= r[i, k] * stations.translation[a, k]
        for k in range(3):
            e[0, k] = o[1] * r[2, k] - o[2] * r[1, k]
            e[1, k] = o[2] * r[0, k] - o[0] * r[2, k]
            e[2, k] = o[0] * r[1, k] - o[1] * r[0, k]
        slope = 0.0  # of the other line's coefficients, at most
        for i in range(3):
            slope += (e[i, 0] ** 2 + e[i, 1] ** 2) * far_out
        for s in range(spots.start[a], spots.start[a + 1]):
            if not free[s]:
                continue
            x, y = spots.xy[s, 0], spots.xy[s, 1]
            l0 = e[0, 0] * x + e[0, 1] * y + e[0, 2]
            l1 = e[1, 0] * x + e[1, 1] * y + e[1, 2]
            l2 = e[2, 0] * x + e[2, 1] * y + e[2, 2]
            length2 = l0 * l0 + l1 * l1
            d0 = r[0, 0] * x + r[0, 1] * y + r[0, 2]
            d1 = r[1, 0] * x + r[1, 1] * y + r[1, 2]
            d2 = r[2, 0] * x + r[2, 1] * y + r[2, 2]
            reach = line_length(stations, b, o, d0, d1, d2, 1.0 / stations.near[a], 1.0 / stations.far[a])
            if reach < 0.0:
                continue
            most = gate2 * (length2 * loudest[b] + slope * loudest[a])
            for t in range(spots.start[b], spots.start[b + 1]):
                u, v = spots.xy[t, 0], spots.xy[t, 1]
                error = l0 * u + l1 * v + l2
                if error * error > most or not free[t]:
                    continue
                m0 = e[0, 0] * u + e[1, 0] * v + e[2, 0]
                m1 = e[0, 1] * u + e[1, 1] * v + e[2, 1]
                variance = (
                    l0 * l0 * noise[t, 0] + 2.0 * l0 * l1 * noise[t, 1] + l1 * l1 * noise[t, 2]
                    + m0 * m0 * noise[s, 0] + 2.0 * m0 * m1 * noise[s, 1] + m1 * m1 * noise[s, 2]
                )  # fmt: skip
                if error * error > gate2 * variance:
                    continue
                # Inverse depth in a of the point of the line next to the spot: both components of o + z d ~ (u, v).
                q0, q1 = o[0] - u * o[2], o[1] - v * o[2]
                w0, w1 = u * d2 - d0, v * d2 - d1
                top, low = q0 * w0 + q1 * w1, q0 * q0 + q1 * q1
                slack = 3.0 * math.sqrt((noise[t, 0] + noise[t, 2] + noise[s, 0] + noise[s, 2]) / low)
                inverse = top / low
                if inverse > 1.0 / stations.near[a] + slack or inverse < 1.0 / stations.far[a] - slack:
                    continue
                if not d2 + inverse * o[2] > 0.0:
                    continue
                if count < len(found):
                    found[count, 0], found[count, 1] = s, t
                    sigma = math.sqrt(variance / length2)
                    wide = reach + math.sqrt(noise[t, 0] + noise[t, 2] + noise[s, 0] + noise[s, 2])
                    gain[count] = -0.5 * error * error / variance - math.log(
                        math.sqrt(2.0 * math.pi) * sigma * wide * spots.density[t]
                    )
                count += 1
    return count


@nb.njit(cache=True, nogil=True)
def line_length(
    stations: Stations, b: int, o: Array, d0: float, d1: float, d2: float, nearest: float, farthest: float
) -> float:
    """Length in view b of the ray d + w o between two inverse depths w, cut at the picture; -1 outside of it."""
    # Behind the camera: the end of the line moves to where it comes in front of it.
    zn, zf = d2 + nearest * o[2], d2 + farthest * o[2]
    if zn < LEAST_DEPTH and zf < LEAST_DEPTH:
        return -1.0
    if zn < LEAST_DEPTH:
        nearest += (LEAST_DEPTH - zn) / o[2]
    if zf < LEAST_DEPTH:
        farthest += (LEAST_DEPTH - zf) / o[2]
    zn, zf = d2 + nearest * o[2], d2 + farthest * o[2]
    ax, ay = (d0 + nearest * o[0]) / zn, (d1 + nearest * o[1]) / zn
    bx, by = (d0 + farthest * o[0]) / zf, (d1 + farthest * o[1]) / zf
    enter, leave = 0.0, 1.0
    for k in range(2):
        p, q = (ax, bx) if k == 0 else (ay, by)
        low, high = stations.low[b, k], stations.high[b, k]
        if p == q:
            if p < low or p > high:
                return -1.0
            continue
        s, t = (low - p) / (q - p), (high - p) / (q - p)
        enter, leave = max(enter, min(s, t)), min(leave, max(s, t))
    if leave < enter:
        return -1.0
    return (leave - enter) * math.hypot(bx - ax, by - ay)
