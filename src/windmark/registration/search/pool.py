"""Candidates of the search, and the pool that keeps the best distinct ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.registration import rules
from windmark.registration._kernels.best import ALIKE_SHARE, ALIKE_TRACE, Best, keep, room_for_best
from windmark.registration.cached import cached_property
from windmark.registration.search.layout import Frame

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A pose that the search found.

    Parameters
    ----------
    cam_from_model, focal_px : the pose and the focal length it was found with
    score : log-likelihood ratio in the search plane
    count : matched markers
    match : (N,) spot of every marker or -1
    """

    cam_from_model: Pose
    focal_px: float
    score: float
    count: int
    match: NDArray[np.int32]

    def is_like(self, rotation: Array, match: NDArray[np.int32], count: int) -> bool:
        """Whether it is nearly the same solution as another one, more or less grown, see `_kernels.best.keep`."""
        if float((self.cam_from_model.rotation * rotation).sum()) < ALIKE_TRACE:
            return False
        shared = int(((self.match == match) & (self.match >= 0)).sum())
        return shared > ALIKE_SHARE * min(self.count, count)


def is_rival(score: float, count: int, least: float, best_count: int) -> bool:
    """Whether a candidate may rival the best one: by its score, or as it explains nearly as many spots.

    Those may be all that counts (`settle.common`).
    """
    return score > least or (score > -np.inf and count >= rules.AS_MANY * best_count)


class Pool:
    """The best distinct solutions: ``best`` for the kernels, and an object for each of them.

    Parameters
    ----------
    frame : of the markers
    size, markers : numbers of solutions kept, and of markers
    """

    def __init__(self, frame: Frame, size: int, markers: int) -> None:
        self._frame, self._room = frame, (size, markers)
        self._made: dict[int, Candidate] = {}
        self._order: tuple[int, list[int], list[float]] = (-1, [], [])  # how many were kept, best first, and scores

    @cached_property
    def best(self) -> Best:
        """The solutions for the kernels."""
        return room_for_best(*self._room)

    def top(self, count: int | None = None, within: float = np.inf) -> list[Candidate]:
        """The candidates, best first; so many, and none that is no rival of the best (`is_rival`)."""
        kept = int(self.best.serial[self._room[0]])
        if self._order[0] != kept:
            score = self.best.score.tolist()
            self._order = kept, sorted(range(len(score)), key=lambda n: -score[n]), score
        _, order, score = self._order
        least, count_of = score[order[0]] - within, self.best.matched
        best = int(count_of[order[0]])
        return [self._candidate(n) for n in order[:count] if is_rival(score[n], int(count_of[n]), least, best)]

    def add(self, rotation: Array, translation: Array, focal_px: float, score: float, match: NDArray[np.int32]) -> None:
        """Keep a solution of the unit model unless one like it is as good."""
        keep(self.best, rotation, translation, focal_px, score, int((match >= 0).sum()), match)

    def _candidate(self, n: int) -> Candidate:
        """One object for each solution kept."""
        best = self.best
        serial = int(best.serial[n])
        if serial not in self._made:
            pose = self._frame.pose(best.rotation[n].copy(), best.translation[n].copy())
            focal, score, count = float(best.focal[n]), float(best.score[n]), int(best.matched[n])
            self._made[serial] = Candidate(pose, focal, score, count, best.match[n].copy())
        return self._made[serial]
