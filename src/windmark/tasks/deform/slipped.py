"""A part that may be one place further on in its own rows of markers than it was taken to be.

On regular rows of a part that slides or turns the markers next to the right ones are as near, or nearer, to where these
were expected, once it moved by about half a spacing or more; they fit as well. Only the ends tell: markers lack at one,
and beyond the other there are as many spots that nobody asked for. So where markers of such a part lack, those places
are looked at, and what explains more spots is right. Rows may go on beyond the table, with marks that are no markers;
whether they do is seen while none of the part's markers lacks, or cannot be told.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.deformation import Deformation
from windmark.deformation.misfit import length_unit
from windmark.deformation.slides import Slide, slides_of
from windmark.errors import g3
from windmark.scene import Doubt, MarkerSet
from windmark.tasks.deform.memory import displaced
from windmark.tasks.deform.sights import OWN_PX
from windmark.tasks.deform.spots import Labelled, near
from windmark.tasks.deform.task import DeformationTest, Image

Ints = NDArray[np.int64]
Masks = Mapping[str, NDArray[np.bool_]]

SURE = 2
"""So many spots more than the other explanation has, at so many places, are no chance: each is within a pixel of its
predicted place. One disc is seen by several cameras."""


@dataclass(frozen=True)
class Rival:
    """The state with a part further on, and why that may be right.

    Parameters
    ----------
    state : the one that was found, with other parameters of the part's law
    slide : how it came there
    more : how many spots more it explains
    sure : whether it is known that the rows do not go on beyond the table, and those spots are enough
    """

    state: Deformation
    slide: Slide
    more: int
    sure: bool

    def doubt(self, found: Deformation) -> Doubt:
        """That the state that was found may be slipped."""
        return self._doubt("may be slipped by", self._values(self.state, found))

    def taken(self, other: Deformation, found: Deformation) -> Deformation:
        """The state with the part further on, in place of the one that was found, which is said.

        That its spots are its markers' rests on those at its ends alone: something else may stand there.
        """
        ends = " nearer than its ends show, and was moved on"
        doubt = self._doubt("was found", self._values(other, found), ends)
        names = tuple(dict.fromkeys((*other.suspect, *doubt.names)))
        return replace(other, doubts=(*other.doubts, doubt), suspect=names)

    def _values(self, first: Deformation, second: Deformation) -> str:
        return " and ".join(
            f"{first.volumes.names[k]} = {g3(first.q[k])} in place of {g3(second.q[k])}"
            for k in self.slide.columns.tolist()
        )

    def _doubt(self, what: str, values: str, then: str = "") -> Doubt:
        unit = length_unit(self.state.volumes)
        return Doubt((self.slide.volume,), (
            f"{{}} {what} one spacing of {g3(self.slide.spacing)} {unit}".rstrip() + f"{then}: with {values} "
            f"{self.more} more of its spots are explained; see in the pictures which of its markers are at its ends"
        ), "layout")  # fmt: skip


@dataclass
class Slips:
    """What is asked of each frame, and what is known of the rows beyond the table.

    Parameters
    ----------
    test : what does not change
    beyond : camera, number of the slide -> markers at whose places after it there are spots that are no markers'; not
        there where that was never seen
    """

    test: DeformationTest
    beyond: dict[tuple[str, int], frozenset[int]] = field(default_factory=dict)
    _slides: tuple[Slide, ...] | None = None

    def rival(
        self, state: Deformation, labelled: Mapping[str, Labelled], images: Mapping[str, Image], hidden: Masks,
        *, cold: bool,
    ) -> Rival | None:  # fmt: skip
        """What explains more spots than a state does, by a part that is further on; None where nothing does.

        ``images`` of the instant, of some of the cameras that have ``labelled`` spots; ``cold``: this frame tells what
        is beyond the rows, too, where no marker lacks.
        """
        if not cold and all(len(spots.marker) >= spots.expected for spots in labelled.values()):
            return None
        if self._slides is None:
            self._slides = slides_of(state.placed, self.test.markers.role == "wall")
        best: Rival | None = None
        alike, beyond = False, dict[tuple[str, int], frozenset[int]]()
        for number, slide in enumerate(self._slides):
            lost = {n: int(np.isin(labelled[n].marker, slide.vacated).sum()) for n in images if n in labelled}
            # A part that slipped so far has no spots left where it would leave, but for a few that are others'.
            if not cold and 2 * sum(lost.values()) > len(slide.entering) * len(lost):
                continue
            q = slide.of(state.q)
            if q is None:
                continue
            other = replace(state, q=q)
            placed = displaced(self.test.markers, other)
            there = {n: self._there(images[n], n, other, placed, slide, labelled[n], hidden.get(n)) for n in lost}
            new = {n: there[n] - self.beyond.get((n, number), frozenset()) for n in lost}
            more = sum(len(new[n]) - lost[n] for n in lost)
            places = len(frozenset[int]().union(*new.values()))
            if more <= 0:
                beyond.update({(n, number): there[n] for n in lost})
                continue
            known = all((n, number) in self.beyond for n in lost)
            alike = best is not None and (more == best.more or (alike and more < best.more))
            if best is None or more > best.more:
                best = Rival(other, slide, more, known and min(more, places) >= SURE)
        if best is None:  # a part that slipped has its own spots there
            self.beyond.update(beyond)
            return None
        return replace(best, sure=best.sure and not alike)

    def _there(
        self, image: Image, name: str, state: Deformation, placed: MarkerSet, slide: Slide, labelled: Labelled,
        hidden: NDArray[np.bool_] | None,
    ) -> frozenset[int]:  # fmt: skip
        """Markers that enter and have a spot where they would be, which is nobody's yet."""
        station = self.test.station(name)
        aside = np.ones(len(placed), bool)
        aside[slide.entering] = False
        seen = near(
            image, self.test, station, state.cameras.get(name, station.camera),
            state.cam_from_tunnel.get(name, station.cam_from_tunnel), placed, 0.0, labelled,
            aside if hidden is None else aside | hidden,
        )  # fmt: skip
        if not len(seen.marker) or not len(labelled.xy):
            return frozenset(seen.marker.tolist())
        return frozenset(seen.marker[cKDTree(labelled.xy).query(seen.xy)[0] > OWN_PX].tolist())
