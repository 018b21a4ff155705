"""Candidates of the search and the pool that keeps the best distinct ones."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose

ALIKE_COSINE = float(np.cos(np.radians(3.0)))
ALIKE_SHARE = 0.6


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

    def like(self, other: Candidate) -> bool:
        """Nearly the same rotation (3 degrees) and mostly the same pairs: one solution, more or less grown.

        Two poses of one labelling, as mirrored in a plane, are *not* alike; nor is a shift along a row.
        """
        return self.is_like(other.cam_from_model.rotation, other.match, other.count)

    def is_like(self, rotation: NDArray[np.float64], match: NDArray[np.int32], count: int) -> bool:
        """The same with the parts of the other one that matter."""
        if float((self.cam_from_model.rotation * rotation).sum()) < 1 + 2 * ALIKE_COSINE:
            return False
        shared = int(((self.match == match) & (self.match >= 0)).sum())
        return shared > ALIKE_SHARE * min(self.count, count)


@dataclass
class Pool:
    """The best distinct candidates, best first."""

    size: int = 12
    items: list[Candidate] = field(default_factory=list)

    def add(self, new: Candidate) -> bool:
        """Keep a candidate unless something like it is as good; True when it was kept."""
        if len(self.items) == self.size and new.score <= self.items[-1].score:
            return False
        alike = [old for old in self.items if old.like(new)]
        if any(old.score >= new.score for old in alike):
            return False
        self.items = sorted([*(old for old in self.items if old not in alike), new], key=lambda c: -c.score)
        del self.items[self.size :]
        return True

    @property
    def best(self) -> Candidate | None:
        """The best candidate, None if there is none."""
        return self.items[0] if self.items else None
