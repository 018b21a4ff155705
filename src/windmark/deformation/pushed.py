"""A camera taken as fixed that does not stand where it should, by all instants of a series together.

Pushed a little once, it makes each instant by itself look wrong in a way of its own: as a picture of another moment, as
a law that is too simple, as noise. What is the same in all of them is its pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import chance
from windmark.deformation.evidence import Evidence, Instant
from windmark.deformation.moved import how_far
from windmark.scene import Doubt

Array = NDArray[np.float64]

FALSE = 2.5e-4
"""Probability that a camera that stands where it should is said not to."""
INSTANTS = 2
"""Instants with wind that are needed: one tells as much by itself."""


@dataclass(frozen=True, eq=False)
class Pushed:
    """By how much the pose of a camera is off.

    Parameters
    ----------
    views : all cameras; ``which`` of them, the likeliest first: those of the others that would explain it as well
    value, cov : (k, 6) and (k, 6, 6) by which the pose of each of ``which`` would be off, in the mean of all instants
    unit : of lengths
    """

    views: tuple[str, ...]
    which: tuple[int, ...]
    value: Array
    cov: Array
    unit: str

    @property
    def doubt(self) -> Doubt:
        """As a sentence."""
        names = tuple(self.views[k] for k in self.which)
        far = [how_far(value, cov, self.unit) for value, cov in zip(self.value, self.cov, strict=True)]
        said = ("{} is taken as fixed and is not where it should be, by all frames together: in their mean it " + far[0]
                if len(far) == 1 else
                "a camera taken as fixed is not where it should be, by all frames together: in their mean "
                + " or ".join(f"{{}} {words}" for words in far)
                + "; these cameras alone do not tell which (markers on walls, or a third camera, would)")  # fmt: skip
        return Doubt(names, said, "moved")

    def shifts(self, instant: Instant) -> Array:
        """(F, k) by how much what is free in an instant is off, 1 sigma, whichever of the cameras it is."""
        out = []
        for k, value, cov in zip(self.which, self.value, self.cov, strict=True):
            size, along = np.linalg.eigh(np.outer(value, value) + cov)
            own = len(self.views) + 6 * k + np.arange(6)
            out.append(instant.follow[:, own] @ along * np.sqrt(np.maximum(size, 0.0)))
        return np.concatenate(out, axis=1)


def pushed(
    evidence: Evidence, place_cov: Array | None, instants: int, fixed: tuple[bool, ...], unit: str
) -> Pushed | None:
    """The camera whose pose is off by the same in all instants; None where none is.

    Parameters
    ----------
    instants : how many of them have wind
    fixed : of each camera whether its pose is taken as known
    unit : of lengths
    """
    if instants < INSTANTS:
        return None
    # What the laws lack, the same or with the load, may look like it.
    every, six = evidence.by_factors(evidence.course.factors), np.arange(6)
    lacking = every.with_loads(every.lacking)
    views = [v for v in range(len(evidence.views)) if fixed[v]]
    poses = {v: evidence.poses.reshape(-1, 6)[v] for v in views}
    tests = {v: every.added(poses[v], lacking, place_cov).fitted(six)[:2] for v in views}
    asked = [v for v in views if chance(*tests[v], *evidence.beside(tests[v][0])) < FALSE / len(views)]
    if not asked:
        return None
    asked.sort(key=lambda v: -tests[v][0])
    alike = [v for v in asked if tests[v][0] > tests[asked[0]][0] + 2 * np.log(FALSE)]
    found = [evidence.added(poses[v], poses[v][:0], place_cov).fitted(six)[2:] for v in alike]
    value, cov = (np.array([f[k] for f in found]) for k in (0, 1))
    return Pushed(evidence.views, tuple(alike), value, cov, unit)
