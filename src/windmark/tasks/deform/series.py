"""What the frames so far say together, and what that does to the state of a frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation
from windmark.deformation.evidence import Evidence, Instant, instant_of
from windmark.deformation.late import Late, lateness
from windmark.deformation.solve import Solved
from windmark.scene import Doubt
from windmark.tasks.deform.task import DeformationTest, FrameImages

Array = NDArray[np.float64]

OF_ONE_INSTANT = ("moved", "picture")
"""Causes of doubts that a frame by itself gives to what a late camera shows."""


@dataclass(frozen=True, eq=False)
class Series:
    """The frames so far.

    Parameters
    ----------
    evidence : what they say together
    place, instant : where the markers were in the tunnel at the last of them, (N, 3), and when that was
    last : what the last one says; None where nothing was added
    late : the camera that all of them show at another time than the others
    """

    evidence: Evidence
    place: Array | None = None
    instant: float = 0.0
    last: Instant | None = None
    late: Late | None = None

    @staticmethod
    def of(test: DeformationTest) -> Series | None:
        """Before the first frame; None where errors of the table are not known, which are the same in all of them."""
        model = test.markers.role != "wall"
        if test.marker_cov is None and not np.isfinite(test.markers.sigma[model]).all():
            return None
        return Series(Evidence.none(tuple(s.name for s in test.stations), len(test.markers)))

    def plus(self, solved: Solved, frame: FrameImages) -> Series:
        """One frame more.

        Spots between two pictures are where they were at the instant already: of such frames nothing tells lateness.
        """
        moving, cov = None, solved.task.place_cov
        if self.place is not None and not frame.shots:
            moving = (solved.task.tunnel_place(solved.values) - self.place) / (frame.instant - self.instant)
        instant = instant_of(solved, self.evidence.views, moving)
        if instant is None:
            return self.without()
        evidence = self.evidence.plus(instant, cov)
        return Series(evidence, instant.place, frame.instant, instant, lateness(evidence, cov))

    def without(self) -> Series:
        """The frames so far without what the last one says by itself; all that a frame hands on that says nothing."""
        return self if self.last is None else replace(self, last=None)

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """What is to be said of the series."""
        return () if self.late is None else (self.late.doubt,)

    def judged(self, state: Deformation) -> Deformation:
        """The state of the last frame with what all of them say; the same where that is nothing."""
        if self.late is None:
            return state
        kept = tuple(d for d in state.doubts if d.cause not in OF_ONE_INSTANT)
        doubts = (*self.doubts, *kept)
        names = tuple(dict.fromkeys(n for d in doubts for n in d.names))
        cov = state.cov
        if self.last is not None:
            cov = cov + _by_name(self.late.covariance(self.last), self.last.names, state.names)
        return replace(state, cov=cov, doubts=doubts, suspect=names)


def _by_name(cov: Array, names: tuple[str, ...], wanted: tuple[str, ...]) -> Array:
    """Covariance of some unknowns as that of others; 0 for those that are not among them."""
    own = {n: k for k, n in enumerate(names)}
    at = np.array([own.get(n, -1) for n in wanted], dtype=np.int64)
    there = at >= 0
    return np.where(np.outer(there, there), cov[np.ix_(at, at)], 0.0)
