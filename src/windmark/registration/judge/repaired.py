"""Solutions of few pairs without one that is wrong: it can open the gates for itself, or hold what nothing checks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.registration import rules
from windmark.registration.budget import SETTLE, SETTLE_PAIR, Budget
from windmark.registration.judge import one_pair, own
from windmark.registration.settle._kernels.settle import fit_kernel
from windmark.registration.settle._kernels.state import REST_PX
from windmark.registration.settle.settling import copied, settle
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import Views

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

NEIGHBOURS = 4
"""Of a marker, that its spot may be of."""
BESIDE, TURNS = 3, np.linspace(-np.pi, np.pi, 72, endpoint=False)
"""So many pairs beside a row may be wrong together; they are tried at turns about it (radians)."""
ABOUT = TURNS[6::6]
"""Turns about the markers that are left at which the rest of a solution is begun again (radians)."""
MOST_TURNED, TURNED_FAR = 24, 4.0
"""So many markers are tried, nearest first, as far from a spot as so many times the search looks for one: what half a
step of a turn moves a marker by."""


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
        self._less: dict[Solution, list[Solution]] = {}
        self.tried: list[Solution] = []  # all that came of it

    def of(self, solution: Solution) -> Solution:
        """The best of a solution and of those that one pair less, or another one, leads to."""
        if solution not in self._kept:
            best = max([solution, *self.less_unheld(solution)], key=lambda s: s.evidence)
            if solution.count <= rules.FEW:
                if any(own.is_loose(solution, c) for c in range(len(solution.counts))):
                    best = max([best, *self.with_one_less(best)], key=lambda s: s.evidence)
                best = max([best, *self._with_one_other(best)], key=lambda s: s.evidence)
                best = max([best, *self._turned(best)], key=lambda s: s.evidence)
            self._kept[solution] = best
        return self._kept[solution]

    def rivals(self, best: Solution, margin: float) -> list[Solution]:
        """What was tried that is not worse than a solution by so much (nats), of the same spots and elsewhere."""
        near = (s for s in self.tried if s.views is best.views and s.evidence > best.evidence - margin)
        return [s for s in near if not s.same_as(best)]

    def less_unheld(self, solution: Solution) -> list[Solution]:
        """Rigid solutions where the spot that the others hardly check is a foreign one, the nearest of each first."""
        if solution not in self._less:
            self._less[solution] = found = []
            for c, (_, _, marker, wide) in enumerate(solution.openness):
                if one_pair.is_unheld(solution, c, marker, wide):
                    self._budget.spend(SETTLE + SETTLE_PAIR * solution.count)
                    if (less := one_pair.less_one(solution, solution.views, c, marker)) is not None:
                        self.tried.append(less)
                        found.extend([less, *self._about(less)])
        return self._less[solution]

    def _about(self, less: Solution) -> Iterator[Solution]:
        """What a solution of one camera becomes from where the model is turned about the axis along its markers: a row
        that waves a little fits in two ways at most, and what held it is gone.
        """  # fmt: skip
        if len(less.counts) == 1:
            turns, shifts = _turned_about(less, less.pairs()[1], ABOUT)
            for turn, shift in zip(turns, shifts, strict=True):
                yield from self._begun(less, less.state.match, (turn, shift))

    def _with_one_other(self, solution: Solution) -> Iterator[Solution]:
        """Rigid solutions where the spot that the others hardly check is that of a neighbouring marker."""
        for c, plane in enumerate(self._views.planes):
            marker, wide = solution.openness[c][2:]
            if not one_pair.is_unheld(solution, c, marker, wide):
                continue
            match = solution.state.match
            for other in plane.model.near[marker, :NEIGHBOURS]:
                if match[c, other] < 0 and solution.state.faces[c, other]:
                    moved = match.copy()
                    moved[c, other], moved[c, marker] = match[c, marker], -1
                    yield from self._begun(solution, moved)

    def _turned(self, solution: Solution) -> Iterator[Solution]:
        """Rigid solutions of one camera where a row of markers stays as it is and the few spots beside it, which alone
        tell how the model is turned about the row, are those of other markers.
        """  # fmt: skip
        if len(self._views.planes) > 1 or (row := _row_of(solution)) is None:
            return
        xyz, state, plane = self._views.sights.xyz, solution.state, self._views.planes[0]
        turns, shifts = _turned_about(solution, row, TURNS)
        free = np.setdiff1d(np.arange(len(xyz)), row)
        seen, valid = solution.camera().project(xyz[free] @ turns.transpose(0, 2, 1) + shifts[:, None])
        seen[~valid] = np.nan
        beside = np.setdiff1d(solution.pairs()[1], row)
        begun: list[tuple[float, int, int, int]] = []
        for spot in state.match[0, beside].tolist():
            away = np.nan_to_num(np.linalg.norm(seen - plane.task.xy[spot], axis=2), nan=np.inf)
            nearest = away.argmin(axis=0).tolist()
            begun.extend((float(away[k, n]), spot, k, int(free[n])) for n, k in enumerate(nearest))
        for off, spot, k, marker in sorted(begun)[:MOST_TURNED]:
            if off < plane.task.tolerance_px * TURNED_FAR and state.match[0, marker] != spot:
                match = np.full_like(state.match, -1)
                match[0, row], match[0, marker] = state.match[0, row], spot
                yield from self._begun(solution, match, (turns[k], shifts[k]))

    def _begun(
        self, solution: Solution, match: Ints, pose: tuple[Array, Array] | None = None
    ) -> Iterator[Solution]:  # fmt: skip
        """What a solution becomes with other labels (C, N), or from another pose, to begin with, if anything."""
        self._budget.spend(SETTLE + SETTLE_PAIR * solution.count)
        start = (*(pose or (solution.state.rotation, solution.state.translation)), match)
        views = self._views if solution.is_bent else solution.views
        if (other := settle(views, *start, focal_px=solution.state.camera[:, 0])) is not None:
            self.tried.append(other)
            yield other

    def with_one_less(self, solution: Solution) -> Iterator[Solution]:
        """Rigid solutions that begin without one of the pairs."""
        for c, marker in zip(*np.nonzero(solution.state.match >= 0), strict=True):
            match = solution.state.match.copy()
            match[c, marker] = -1
            yield from self._begun(solution, match)


def _turned_about(solution: Solution, row: NDArray[np.int64], angles: Array) -> tuple[Array, Array]:
    """(T, 3, 3), (T, 3) poses of the unit model that is turned by so many radians about the axis of some markers."""
    xyz, state = solution.views.sights.xyz[row], solution.state
    middle = xyz.mean(axis=0)
    axis = np.linalg.svd(xyz - middle, full_matrices=False)[2][0]
    turns = state.rotation @ Pose.exp(np.pad(np.outer(angles, axis), ((0, 0), (0, 3)))).rotation
    return turns, state.translation + (state.rotation - turns) @ middle


def _row_of(solution: Solution) -> NDArray[np.int64] | None:
    """The matched markers but a few that leave the place of a marker open, if these few are taken away; None where the
    others hold the pose without them.
    """  # fmt: skip
    rows, marker = [], solution.pairs()[1]
    for _ in range(min(BESIDE, len(marker) - 4)):
        off = solution.views.sights.xyz[marker]
        off = off - off.sum(axis=0) / len(off)
        axis = np.linalg.eigh(off.T @ off)[1][:, 2]
        away = off - (off @ axis)[:, None] * axis
        marker = np.delete(marker, (away * away).sum(axis=1).argmax())
        rows.append(marker)
    # The fewer markers there are the more they leave open, and most solutions need be asked only once.
    if not rows or not _leaves_open(solution, rows[-1]):
        return None
    return next(row for row in rows if _leaves_open(solution, row))


def _leaves_open(solution: Solution, row: NDArray[np.int64]) -> bool:
    """Whether some of the matched markers alone leave the place of another open."""
    state = copied(solution.views, solution.state)
    state.match[0] = -1
    state.match[0, row] = solution.state.match[0, row]
    if not fit_kernel(solution.views.sights, state):
        return True
    return bool(state.open[0, REST_PX] > solution.views.planes[0].task.tolerance_px)
