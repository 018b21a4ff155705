"""Which point hypotheses stand: a spot belongs to one point, the better evidence has it, near ties have none."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

REFUSED, ACCEPTED, DOUBLE, BEATEN, TIED = 0, 1, 2, 3, 4
"""What became of a hypothesis: too little evidence; stands; the same point as a better one; spots lost; a near tie."""


@nb.njit(cache=True, nogil=True)
def choose(rows: Ints, score: Array, order: Ints, least: float, lead: float, owner: Ints, verdict: Ints) -> None:
    """Go through hypotheses, best first (``order``); ``verdict`` (H,) and ``owner`` (S,) of the spots are results.

    Two hypotheses with two common spots are one point; a spot over which they differ belongs to it no more where their
    scores differ by less than ``lead``. With one spot in common they are rivals: both wait where the scores differ by
    less.
    """
    for h in order:
        row = rows[h]
        if not score[h] > least - lead:
            break
        first, same, other = -1, 0, 0
        for v in range(len(row)):
            if row[v] >= 0 and owner[row[v]] >= 0:
                t = owner[row[v]]
                if first < 0:
                    first = t
                if t == first:
                    same += 1
                else:
                    other += 1
        if first < 0:
            if score[h] > least:
                verdict[h] = ACCEPTED
                for v in range(len(row)):
                    if row[v] >= 0:
                        owner[row[v]] = h
            continue
        if other == 0 and same >= 2:
            verdict[h] = DOUBLE
            continue
        verdict[h] = BEATEN
        for v in range(len(row)):
            if row[v] >= 0 and owner[row[v]] >= 0:
                t = owner[row[v]]
                shared = 0
                for n in range(len(row)):
                    shared += row[n] >= 0 and row[n] == rows[t, n]
                if shared < 2 and score[h] > score[t] - lead:
                    verdict[t] = TIED
    for s in range(len(owner)):
        if owner[s] >= 0 and verdict[owner[s]] == TIED:
            owner[s] = -1
