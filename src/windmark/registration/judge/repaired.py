"""Solutions of few pairs without one that is wrong: it can open the gates for itself, or hold what nothing checks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from windmark.registration.budget import SETTLE, SETTLE_PAIR, Budget
from windmark.registration.judge import own, rules
from windmark.registration.settle._kernels.places import open_kernel
from windmark.registration.settle.settling import settle
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import Views

Ints = NDArray[np.int32]

NEIGHBOURS = 4
"""Of a marker, that its spot may be of."""


class Repaired:
    """What becomes of solutions whose pairs are doubted one by one; kept, so asking again costs nothing.

    Parameters
    ----------
    views : what was seen, rigid
    budget : of the whole registration
    """

    def __init__(self, views: Views, budget: Budget) -> None:
        self._views, self._budget = views, budget
        self._kept: dict[Solution, Solution] = {}
        self.tried: list[Solution] = []  # all that came of it

    def of(self, solution: Solution) -> Solution:
        """The best of a solution and of those that one pair less, or another one, leads to."""
        if solution not in self._kept:
            best = solution
            if solution.count <= rules.FEW:
                if any(own.is_loose(solution, c) for c in range(len(solution.counts))):
                    best = max([best, *self.with_one_less(best)], key=lambda s: s.evidence)
                best = max([best, *self._with_one_other(best)], key=lambda s: s.evidence)
            self._kept[solution] = best
        return self._kept[solution]

    def _with_one_other(self, solution: Solution) -> Iterator[Solution]:
        """Rigid solutions where the spot that the others hardly check is that of a neighbouring marker."""
        for c, plane in enumerate(self._views.planes):
            marker, wide = open_kernel(solution.state, solution.state.place, c)[2:]
            if not own.is_unheld(solution, c, marker, wide):
                continue
            match = solution.state.match
            for other in plane.model.near[marker, :NEIGHBOURS]:
                if match[c, other] < 0 and solution.state.faces[c, other]:
                    moved = match.copy()
                    moved[c, other], moved[c, marker] = match[c, marker], -1
                    yield from self._begun(solution, moved)

    def _begun(self, solution: Solution, match: Ints) -> Iterator[Solution]:
        """What a solution becomes with other labels (C, N) to begin with, if anything."""
        self._budget.spend(SETTLE + SETTLE_PAIR * solution.count)
        start = solution.state.rotation, solution.state.translation, match
        if (other := settle(self._views, *start, focal_px=solution.state.camera[:, 0])) is not None:
            self.tried.append(other)
            yield other

    def with_one_less(self, solution: Solution) -> Iterator[Solution]:
        """Rigid solutions that begin without one of the pairs."""
        for c, marker in zip(*np.nonzero(solution.state.match >= 0), strict=True):
            match = solution.state.match.copy()
            match[c, marker] = -1
            yield from self._begun(solution, match)
