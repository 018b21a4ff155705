"""The best distinct solutions of the fast search, kept as arrays; readable twin: tests/registration/test_quads.py."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

SEEN = 64
"""So many of the last grown solutions are remembered, good or bad, and not grown again."""
ALIKE_TRACE = 1.0 + 2.0 * math.cos(math.radians(3.0))
ALIKE_SHARE = 0.6
"""Alike are two solutions with nearly the same rotation and more than this share of the pairs in common."""


class Best(NamedTuple):
    """The best distinct solutions, in no order; ``score`` is -inf where there is none."""

    rotation: Array  # (P, 3, 3)
    translation: Array  # (P, 3)
    focal: Array  # (P,)
    score: Array  # (P,) log-likelihood ratio
    matched: Ints  # (P,)
    match: Ints  # (P, N) spot of every marker or -1
    seen: Ints  # (SEEN, N) the same of the last solutions grown
    serial: NDArray[np.int64]  # (P + 2,) tells solutions apart; then how many were kept, and grown


def room_for_best(size: int, markers: int) -> Best:
    """Empty arrays for ``size`` solutions."""
    return Best(
        np.zeros((size, 3, 3)), np.zeros((size, 3)), np.zeros(size),
        np.full(size, -np.inf), np.zeros(size, np.int32), np.full((size, markers), -1, np.int32),
        np.full((SEEN, markers), -1, np.int32), np.zeros(size + 2, np.int64),
    )  # fmt: skip


@nb.njit(cache=True, nogil=True)
def holds(known: Ints, i: int, j: int, k: int, m: int, a: int, b: int, c: int, d: int) -> bool:
    """Whether one of these solutions has these four pairs."""
    for n in range(known.shape[0]):
        if known[n, i] == a and known[n, j] == b and known[n, k] == c and known[n, m] == d:
            return True
    return False


@nb.njit(cache=True, nogil=True)
def keep(best: Best, r: Array, t: Array, f: float, score: float, count: int, match: Ints) -> bool:
    """Keep a solution unless one like it is as good or the room is full of better ones; True if kept.

    Alike are nearly the same rotation (3 degrees) with mostly the same pairs. Two poses of one labelling, as
    mirrored in a plane, are *not* alike; nor is a shift along a row.
    """
    size = best.score.shape[0]
    worst = 0
    for n in range(size):
        if best.score[n] < best.score[worst]:
            worst = n
        if best.score[n] >= score and _alike(best, n, r, count, match):
            return False
    if best.score[worst] >= score:
        return False
    for n in range(size):
        if best.score[n] > -math.inf and _alike(best, n, r, count, match):
            best.score[n] = -math.inf
            best.match[n] = -1
            worst = n
    best.rotation[worst], best.translation[worst], best.focal[worst] = r, t, f
    best.score[worst], best.matched[worst], best.match[worst] = score, count, match
    best.serial[size] += 1
    best.serial[worst] = best.serial[size]
    return True


@nb.njit(cache=True, nogil=True)
def _alike(best: Best, n: int, r: Array, count: int, match: Ints) -> bool:
    trace = 0.0
    for i in range(3):
        for j in range(3):
            trace += r[i, j] * best.rotation[n, i, j]
    if trace < ALIKE_TRACE:
        return False
    shared = 0
    for m in range(match.shape[0]):
        shared += match[m] >= 0 and match[m] == best.match[n, m]
    return shared > ALIKE_SHARE * min(count, best.matched[n])
