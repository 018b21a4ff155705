"""A state with a part one place further on in its rows of markers, beside the one that was found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from windmark.deformation import Deformation
from windmark.deformation.attached import LIKELIER
from windmark.deformation.misfit import length_unit
from windmark.deformation.slides import Slide
from windmark.errors import g3
from windmark.scene import Doubt
from windmark.tasks.deform.memory import displaced
from windmark.tasks.deform.states import doubted
from windmark.tasks.deform.task import DeformationTest

SURE = 2
"""So many spots more than the other explanation has, at so many places, are no chance: each is within a pixel of its
predicted place. One disc is seen by several cameras."""
NEARER = 1 / 3
"""Of two places a spacing apart that is the one that was expected which is nearer to it by this factor."""


@dataclass(frozen=True)
class Rival:
    """The state with a part further on, and why that may be right.

    Parameters
    ----------
    state : the one that was found, with other parameters of the part's law
    slide : how it came there
    more : how many spots more it explains; 0 where it explains as many
    of_marks : how many of these are of marks that are no markers
    sure : whether it is known that the rows do not go on beyond the table, and those spots are enough
    """

    state: Deformation
    slide: Slide
    more: int
    of_marks: int
    sure: bool

    def doubt(self, found: Deformation) -> Doubt:
        """That the state that was found may be slipped."""
        return self._doubt("may be slipped by", self._values(self.state, found))

    def as_good(self, other: Deformation, found: Deformation, apart: int) -> bool:
        """Whether the adjusted state, ``other``, is to be thought of beside the one that was found.

        Rows are never quite regular: where the places of their markers are known well enough, these tell by themselves.
        By the spots that both have the difference of the sums of squares is a ratio of likelihoods, up to `LIKELIER`:
        so large is chi-square of 2 in one of 100. The number of spots ``apart``, which only one of both has, adds to
        it: chi-square of some minus chi-square of the others is as uncertain as chi-square of all of them.
        """
        more = int(other.used.sum()) + self.of_marks - int(found.used.sum())
        worse = (other.chi2 - found.chi2) / max(np.nan_to_num(found.sigma0, nan=1.0), 1.0) ** 2
        terms = 2 * apart
        most = chdtri(2 + terms, np.exp(-LIKELIER / 2)) - terms + other.redundancy - found.redundancy
        return more > 0 if self.more and not self.of_marks else bool(more >= min(self.more, 1) and worse < most)

    def told(
        self, found: Deformation, expected: Deformation, reach_px: Mapping[str, float], test: DeformationTest
    ) -> bool:
        """Whether the motion before tells that the part is not further on, in all of some cameras.

        It is farther from where it was expected than expectations reach then; and where it was found it is within their
        reach, or nearer by far: what moved farther than was expected may have moved to either place.
        """
        there = displaced(test.markers, expected).xyz[self.slide.own]
        for name, reach in reach_px.items():
            station, pose = test.station(name), expected.cam_from_tunnel.get(name)
            to_cam = pose or station.cam_from_tunnel
            xy = station.camera.project(to_cam.apply(there))[0]
            on, back = (
                float(np.median(np.linalg.norm(station.camera.project(to_cam.apply(
                    displaced(test.markers, s).xyz[self.slide.own]))[0] - xy, axis=1)))
                for s in (self.state, found)
            )  # fmt: skip
            if not (on > reach and back <= max(reach, NEARER * on)):
                return False
        return True

    def taken(self, other: Deformation, found: Deformation) -> Deformation:
        """The state with the part further on, in place of the one that was found, which is said.

        That its spots are its markers' rests on those at its ends alone: something else may stand there.
        """
        ends = " nearer than its ends show, and was moved on"
        return doubted(other, self._doubt("was found", self._values(other, found), ends))

    def _values(self, first: Deformation, second: Deformation) -> str:
        return " and ".join(
            f"{first.volumes.names[k]} = {g3(first.q[k])} in place of {g3(second.q[k])}"
            for k in self.slide.columns.tolist()
        )

    def _doubt(self, what: str, values: str, then: str = "") -> Doubt:
        unit = length_unit(self.state.volumes)
        explained = f"{self.more} more of its spots are explained"
        if not self.more:
            explained = "as many of its spots are explained as well, and no motion before tells"
        return Doubt((self.slide.volume,), (
            f"{{}} {what} one spacing of {g3(self.slide.spacing)} {unit}".rstrip() + f"{then}: with {values} "
            f"{explained}; see in the pictures which of its markers are at its ends"
        ), "layout")  # fmt: skip
