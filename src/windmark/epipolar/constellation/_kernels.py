"""Numba kernels of the constellation matching: arrays in, arrays out; readable twins are in tests/epipolar."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SHARPEST = 0.4
"""Sine of the angle between the two arms of a frame below which it is too thin to fix an affine map."""
WITHIN = 0.9
"""Part of the neighbourhood's radius within which spots of b without a partner count against a map."""
NEIGHBOURS = 6
"""Matched neighbours that predict where a spot lies."""
CLEAR = 2.0
"""The nearest spot counts if the next one is so many times farther from the prediction."""
SWEEPS = 40


@nb.njit(cache=True, nogil=True)
def neighbours_met(
    xa: Array, na: Ints, xb: Array, nb_: Ints, p: int, q: int, m: tuple[float, float, float, float],
    tolerance: float, noise: float, least: int,
) -> tuple[int, float]:  # fmt: skip
    """How many neighbours of p an affine map about (p, q) takes onto spots, less the spots it leaves out; their offset.

    -1 where fewer than ``least`` are met. Offsets are squared, in units of the reach, and summed.
    """
    area = m[0] * m[3] - m[1] * m[2]
    k_count, met, total, last = na.shape[1], 0, 0.0, 0.0
    for n in range(k_count):
        w0, w1 = xa[na[p, n], 0] - xa[p, 0], xa[na[p, n], 1] - xa[p, 1]
        last = w0 * w0 + w1 * w1
        y0, y1 = xb[q, 0] + m[0] * w0 + m[1] * w1, xb[q, 1] + m[2] * w0 + m[3] * w1
        reach = tolerance * math.sqrt(last * area) + noise
        best = np.inf
        for t in range(nb_.shape[1]):
            e0, e1 = xb[nb_[q, t], 0] - y0, xb[nb_[q, t], 1] - y1
            best = min(best, e0 * e0 + e1 * e1)
        if best < reach * reach:
            met += 1
            total += best / (reach * reach)
        elif k_count - 1 - n + met < least:
            return -1, np.inf
    if met < least:
        return -1, np.inf
    inside = 0
    for t in range(nb_.shape[1]):
        e0, e1 = xb[nb_[q, t], 0] - xb[q, 0], xb[nb_[q, t], 1] - xb[q, 1]
        w0, w1 = (m[3] * e0 - m[1] * e1) / area, (m[0] * e1 - m[2] * e0) / area
        inside += w0 * w0 + w1 * w1 < WITHIN * WITHIN * last
    return met - max(inside - k_count, 0), total


@nb.njit(cache=True, nogil=True)
def seed_maps(
    xa: Array, na: Ints, xb: Array, nb_: Ints, first: Ints, arms: Ints, tolerance: float, noise: float, scale: float,
    stretch: float, least: int,
) -> tuple[Ints, Array, Array, int]:  # fmt: skip
    """Best affine map that takes the neighbourhood of a spot in a to that of a spot in b, for every pair of spots.

    xa (A, 2), na (A, K) neighbours nearest first; xb (B, 2), nb_ (B, L); first (S,) spots of a that are tried, arms
    (2,) how many of the nearest neighbours in a and b make frames. Maps may change size by ``scale`` either way and
    shape by ``stretch``; they never mirror. A neighbour is met if a spot lies within ``tolerance`` times its distance.

    Returns (S, B) met neighbours less those left out (-1: no map), (S, B) offsets, (S, B, 4) maps, and the number of
    maps that were tried.
    """
    met = np.full((len(first), len(xb)), -1, np.int64)
    offset = np.full((len(first), len(xb)), np.inf)
    maps = np.zeros((len(first), len(xb), 4))
    tried = 0
    for s in range(len(first)):
        p = first[s]
        for i in range(arms[0]):
            for j in range(i + 1, arms[0]):
                u0, u1 = xa[na[p, i], 0] - xa[p, 0], xa[na[p, i], 1] - xa[p, 1]
                v0, v1 = xa[na[p, j], 0] - xa[p, 0], xa[na[p, j], 1] - xa[p, 1]
                d = u0 * v1 - u1 * v0
                if abs(d) < SHARPEST * math.sqrt((u0 * u0 + u1 * u1) * (v0 * v0 + v1 * v1)):
                    continue
                for q in range(len(xb)):
                    for k in range(arms[1]):
                        a0, a1 = xb[nb_[q, k], 0] - xb[q, 0], xb[nb_[q, k], 1] - xb[q, 1]
                        for n in range(arms[1]):
                            b0, b1 = xb[nb_[q, n], 0] - xb[q, 0], xb[nb_[q, n], 1] - xb[q, 1]
                            area = (a0 * b1 - b0 * a1) / d
                            if area * scale * scale < 1 or area > scale * scale:
                                continue
                            m = (
                                (a0 * v1 - b0 * u1) / d, (b0 * u0 - a0 * v0) / d,
                                (a1 * v1 - b1 * u1) / d, (b1 * u0 - a1 * v0) / d,
                            )  # fmt: skip
                            if m[0] ** 2 + m[1] ** 2 + m[2] ** 2 + m[3] ** 2 > (stretch + 1 / stretch) * area:
                                continue
                            tried += 1
                            count, total = neighbours_met(xa, na, xb, nb_, p, q, m, tolerance, noise, least)
                            if count > met[s, q] or (count == met[s, q] and total < offset[s, q]):
                                met[s, q], offset[s, q] = count, total
                                for c in range(4):
                                    maps[s, q, c] = m[c]
    return met, offset, maps, tried


@nb.njit(cache=True, nogil=True)
def predict(xa: Array, na: Ints, xb: Array, match: Ints, a: int, out: Array) -> int:
    """Where spot a should be in b, by an affine map fitted to its nearest matched neighbours (never to itself).

    ``out`` (3,) becomes the place and the mean distance of those neighbours in a. Returns the nearest of them, or -1
    where there are fewer than three, or all on a line.
    """
    used = np.empty(NEIGHBOURS, np.int64)
    count = 0
    for k in range(na.shape[1]):
        if match[na[a, k]] >= 0:
            used[count] = na[a, k]
            count += 1
            if count == NEIGHBOURS:
                break
    if count < 3:
        return -1
    # Weighted least squares of y = c + M (x - x_a): only c is wanted. Normal equations 3 x 3, near ones count more.
    s00 = s01 = s02 = s11 = s12 = s22 = far = 0.0
    t = np.zeros((3, 2))
    for i in range(count):
        u, v = xa[used[i], 0] - xa[a, 0], xa[used[i], 1] - xa[a, 1]
        d = u * u + v * v
        far += math.sqrt(d) / count
        w = 1.0 / (d + 1e-300)
        s00, s01, s02 = s00 + w, s01 + w * u, s02 + w * v
        s11, s12, s22 = s11 + w * u * u, s12 + w * u * v, s22 + w * v * v
        for c in range(2):
            y = xb[match[used[i]], c]
            t[0, c] += w * y
            t[1, c] += w * u * y
            t[2, c] += w * v * y
    c00, c01, c02 = s11 * s22 - s12 * s12, s02 * s12 - s01 * s22, s01 * s12 - s02 * s11
    det = s00 * c00 + s01 * c01 + s02 * c02
    if not det > 1e-3 * s00 * s11 * s22:  # 0 > 0 where all lie on a row
        return -1
    for c in range(2):
        out[c] = (c00 * t[0, c] + c01 * t[1, c] + c02 * t[2, c]) / det
    out[2] = far
    return int(used[0])


@nb.njit(cache=True, nogil=True)
def nearest(
    xb: Array, nb_: Ints, back: Ints, near: int, y0: float, y1: float, allowed: NDArray[np.bool_]
) -> tuple[int, float, float]:
    """The nearest spot of b to a place, of those round spot ``near``: index (-1: none), distance, next one's distance.

    ``allowed`` (B,) may take part (an empty one: all); those already matched (``back`` >= 0) are only rivals.
    """
    best, d1, d2 = -1, np.inf, np.inf
    for s in range(-1, nb_.shape[1]):
        q = near if s < 0 else nb_[near, s]
        if len(allowed) and not allowed[q]:
            continue
        d = math.hypot(xb[q, 0] - y0, xb[q, 1] - y1)
        if d < d1:
            best, d1, d2 = q, d, d1
        elif d < d2:
            d2 = d
    if best >= 0 and back[best] >= 0:
        return -1, d1, d2
    return best, d1, d2


@nb.njit(cache=True, nogil=True)
def grow(
    xa: Array, na: Ints, xb: Array, nb_: Ints, match: Ints, tolerance: float, noise: float, allowed: NDArray[np.bool_]
) -> Ints:
    """A matching grown from spot to spot, each predicted by its matched neighbours.

    match (A,) spot of b or -1 to start from. A spot joins if the one nearest to its prediction is within ``tolerance``
    times the distance of its neighbours and clearly nearer than the next; it leaves if its neighbours speak against it.
    ``allowed`` (A, B), or (0, 0) for all: pairs that may be.
    """
    match = match.copy()
    back = np.full(len(xb), -1, np.int64)
    for a in range(len(xa)):
        if match[a] >= 0:
            back[match[a]] = a
    out, barred = np.empty(3), np.zeros(len(xa), np.int64)
    for _ in range(SWEEPS):
        joined = 0
        for a in range(len(xa)):
            if match[a] >= 0 or barred[a] > 1:
                continue
            n = predict(xa, na, xb, match, a, out)
            if n < 0:
                continue
            row = allowed[a] if len(allowed) else np.zeros(0, np.bool_)
            q, d1, d2 = nearest(xb, nb_, back, match[n], out[0], out[1], row)
            if q >= 0 and d1 < tolerance * out[2] + noise and d2 > CLEAR * d1:
                match[a], back[q] = q, a
                joined += 1
        for a in range(len(xa)):
            if match[a] < 0:
                continue
            n = predict(xa, na, xb, match, a, out)
            if n >= 0:
                q = match[a]
                if math.hypot(xb[q, 0] - out[0], xb[q, 1] - out[1]) > 1.5 * tolerance * out[2] + noise:
                    match[a], back[q] = -1, -1
                    barred[a] += 1
        if joined == 0:
            break
    return match


@nb.njit(cache=True, nogil=True)
def expectations(xa: Array, na: Ints, xb: Array, nb_: Ints, match: Ints, tolerance: float, noise: float) -> Array:
    """(A, 3) where each spot should be in b and how near a spot must be to count; NaN where nothing predicts it."""
    found = np.full((len(xa), 3), np.nan)
    out = np.empty(3)
    for a in range(len(xa)):
        if predict(xa, na, xb, match, a, out) >= 0:
            found[a, 0], found[a, 1], found[a, 2] = out[0], out[1], tolerance * out[2] + noise
    return found
