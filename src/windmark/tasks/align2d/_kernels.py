"""Numba kernel of the constellation search; a readable twin is in tests/tasks/test_align2d_matching.py."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@nb.njit(cache=True, nogil=True)
def seed_turns(
    xa: Array, na: Ints, xb: Array, near_b: Ints, first: Ints, arms: int, allowed: Mask, scale: float,
    tolerance: float, noise: float,
) -> tuple[Ints, Array, Array, int]:  # fmt: skip
    """Best turn and scale that take the neighbourhood of a spot in a to that of a spot in b, for every pair of spots.

    xa (A, 2), na (A, K) neighbours nearest first; xb (B, 2), near_b (B, L); first (S,) spots of a that are tried; arms:
    how many of the nearest neighbours make, with the spot, a frame; allowed (A, B) pairs that may be, (0, 0) for all.
    A neighbour is met if a spot of b lies within ``tolerance`` times its distance and ``noise`` px. Never mirrors.

    Returns (S, B) met neighbours (-1: none), (S, B) their squared offsets in units of the reach, summed, (S, B, 2) the
    factor as a complex number, and how many were tried.
    """
    met = np.full((len(first), len(xb)), -1, np.int64)
    offset = np.full((len(first), len(xb)), np.inf)
    turn = np.zeros((len(first), len(xb), 2))
    tried = 0
    for s in range(len(first)):
        p = first[s]
        for q in range(len(xb)):
            if len(allowed) and not allowed[p, q]:
                continue
            for i in range(min(arms, na.shape[1])):
                u0, u1 = xa[na[p, i], 0] - xa[p, 0], xa[na[p, i], 1] - xa[p, 1]
                square = u0 * u0 + u1 * u1
                for k in range(near_b.shape[1]):
                    if len(allowed) and not allowed[na[p, i], near_b[q, k]]:
                        continue
                    v0, v1 = xb[near_b[q, k], 0] - xb[q, 0], xb[near_b[q, k], 1] - xb[q, 1]
                    area = (v0 * v0 + v1 * v1) / square
                    if area > scale * scale or area * scale * scale < 1:
                        continue
                    z0, z1 = (v0 * u0 + v1 * u1) / square, (v1 * u0 - v0 * u1) / square
                    tried += 1
                    count, total = 0, 0.0
                    for n in range(na.shape[1]):
                        w0, w1 = xa[na[p, n], 0] - xa[p, 0], xa[na[p, n], 1] - xa[p, 1]
                        y0, y1 = z0 * w0 - z1 * w1, z1 * w0 + z0 * w1
                        reach = tolerance * math.sqrt(y0 * y0 + y1 * y1) + noise
                        best = np.inf
                        for t in range(near_b.shape[1]):
                            e0 = xb[near_b[q, t], 0] - xb[q, 0] - y0
                            e1 = xb[near_b[q, t], 1] - xb[q, 1] - y1
                            best = min(best, e0 * e0 + e1 * e1)
                        if best < reach * reach:
                            count += 1
                            total += best / (reach * reach)
                    if count > met[s, q] or (count == met[s, q] and total < offset[s, q]):
                        met[s, q], offset[s, q] = count, total
                        turn[s, q, 0], turn[s, q, 1] = z0, z1
    return met, offset, turn, tried
