"""A part that may be one place further on in its own rows of markers than it was taken to be.

On regular rows of a part that slides or turns the markers next to the right ones are as near, or nearer, to where these
were expected, once it moved by about half a spacing or more; they fit as well. Only the ends tell: markers lack at one,
and beyond the other there are as many spots that nobody asked for. So where markers of such a part lack, those places
are looked at, and what explains more spots is right. Rows may go on beyond the table, with marks that are no markers;
whether they do is seen while none of the part's markers lacks, or cannot be told. Where it was seen those marks are
looked for like markers: without them a part that slipped towards them lacks nothing. What explains as many spots is
told by the motion before alone, and where there is none, by nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.deformation import Deformation
from windmark.deformation.slides import NEAR, Slide, slides_of
from windmark.scene import MarkerSet
from windmark.tasks.deform.memory import displaced
from windmark.tasks.deform.rival import SURE, Rival
from windmark.tasks.deform.spots import OWN_PX, Labelled, near
from windmark.tasks.deform.task import DeformationTest, Image

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Label = tuple[int, int]
Masks = Mapping[str, NDArray[np.bool_]]


@dataclass
class Slips:
    """What is asked of each frame, and what is known of the rows beyond the table.

    Parameters
    ----------
    test : what does not change
    beyond : camera, number of the slide -> markers at whose places after it there are spots that are no markers'; not
        there where that was never seen
    asked : cameras that were asked what is beyond the rows; one may join late
    open : the part that was left in doubt in the last frame
    """

    test: DeformationTest
    beyond: dict[tuple[str, int], frozenset[int]] = field(default_factory=dict)
    asked: frozenset[str] = frozenset()
    open: str = ""
    _slides: tuple[Slide, ...] | None = None
    _places: dict[str, tuple[object, dict[int, Ints]]] = field(default_factory=dict)

    def rivals(
        self, state: Deformation, labelled: Mapping[str, Labelled], images: Mapping[str, Image], hidden: Masks,
        *, cold: bool,
    ) -> tuple[Rival, ...]:  # fmt: skip
        """What explains more spots than a state does, by a part that is further on; or all that explain as many.

        ``images`` of the instant, of some of the cameras that have ``labelled`` spots; ``cold``: this frame tells what
        is beyond the rows, too, where no marker lacks.
        """
        if self._slides is None:
            self._slides = slides_of(state.placed, self.test.markers.role == "wall")
        names = [n for n in images if n in labelled]
        own = {n: self._marks(images[n], n, state, labelled[n], hidden.get(n)) for n in names}
        lacks = any(len(spots.marker) < spots.expected for spots in labelled.values())
        cold = cold or not self.asked.issuperset(names)
        if not cold and not lacks and not any(marks.lack for marks in own.values()):
            return ()
        best, alike, tied = None, False, list[Rival]()
        beyond = dict[tuple[str, int], frozenset[int]]()
        for number, slide in enumerate(self._slides):
            q = slide.of(state.q)
            if q is None:
                continue
            other = replace(state, q=q)
            marks = {n: self._marks(images[n], n, other, labelled[n], hidden.get(n)) for n in names}
            left = {n: labelled[n].xy[np.isin(labelled[n].marker, slide.vacated)] for n in names}
            # A part that slipped so far has no spots left where it would leave, but for a few that are others'.
            lost = sum(int(_apart(left[n], marks[n].xy).sum()) for n in names)
            if not cold and 2 * lost > len(slide.entering) * len(names):
                continue
            there = {n: self._there(images[n], n, other, slide, labelled[n], hidden.get(n)) for n in names}
            new = {n: _new(there[n], marks[n], labelled[n], own[n]) for n in names}
            less = {n: _lost(left[n], there[n], marks[n], labelled[n], slide, own[n]) for n in names}
            more = sum(len(new[n]) - less[n] for n in names)
            by_markers = sum(len(there[n].labels) - len(left[n]) for n in names)
            rival = Rival(other, slide, max(more, 0), more - by_markers, False)
            if more <= 0:
                beyond.update({(n, number): frozenset(m for _, m in there[n].labels) for n in names})
                shown = any(np.isin(labelled[n].marker, slide.own).any() for n in names)
                tied += [rival] if shown and more == 0 else []
                continue
            known = [n for n in names if (n, number) in self.beyond]  # a camera that joined late knows nothing
            places = len(frozenset[Label]().union(*(new[n] for n in known)))
            sure = min(sum(len(new[n]) - less[n] for n in known), places) >= SURE
            alike = best is not None and (more == best.more or (alike and more < best.more))
            if best is None or more > best.more:
                best = replace(rival, sure=sure)
        if best is not None:  # a part that slipped has its own spots there
            return (replace(best, sure=best.sure and not alike),)
        for key, seen in beyond.items():  # a mark that was seen once is there, whether it can be seen now or not
            self.beyond[key] = self.beyond.get(key, frozenset()) | seen
        self.asked = self.asked.union(names)
        return tuple(tied)

    def _marks(
        self, image: Image, name: str, state: Deformation, labelled: Labelled, hidden: NDArray[np.bool_] | None
    ) -> _Seen:
        """The spots of marks that are known to be beyond the rows, where they are in a state: one look for all."""
        numbers, parts = list[Label](), list[MarkerSet]()
        for number, which in self._known(name, state).items():
            if (q := (self._slides or ())[number].of(state.q)) is not None:
                parts.append(displaced(self.test.markers, replace(state, q=q)).take(which))
                numbers += [(number + 1, m) for m in which.tolist()]
        if not parts:
            return _Seen.none()
        like = np.array([m for _, m in numbers])
        columns: dict[str, Any] = {c: np.concatenate([p.columns[c] for p in parts]) for c in parts[0].columns}
        columns["name"] = np.arange(len(like)).astype(str)  # a marker may come to several marks
        marks = replace(parts[0], **columns)
        own = self._near(image, name, state, marks, labelled, None if hidden is None else hidden[like], like)
        return _Seen(tuple(numbers[k] for k in own.marker.tolist()), own.xy, len(own.marker) < own.expected)

    def _known(self, name: str, state: Deformation) -> dict[int, Ints]:
        """Number of a slide -> markers at whose places after it a camera looks for marks: each of these once.

        Two of its spacings on the one before the last is where the last is after one. Marks go with their part, so that
        this is the same in all states.
        """
        own = {number: which for (n, number), which in self.beyond.items() if n == name and which}
        if self._places.get(name, (None,))[0] != own:
            slides, seen, once = self._slides or (), np.zeros((0, 3)), dict[int, Ints]()
            for number in sorted(own, key=lambda k: (slides[k].spacing, k)):
                if (q := slides[number].of(state.q)) is None:
                    return {k: np.array(sorted(which)) for k, which in own.items()}
                which = np.array(sorted(own[number]))
                xyz = displaced(self.test.markers, replace(state, q=q)).xyz[which]
                new = cKDTree(seen).query(xyz)[0] > NEAR * slides[number].spacing if len(seen) else which >= 0
                if new.any():
                    seen, once[number] = np.concatenate([seen, xyz[new]]), which[new]
            self._places[name] = own, once
        return self._places[name][1]

    def _there(
        self, image: Image, name: str, state: Deformation, slide: Slide, labelled: Labelled,
        hidden: NDArray[np.bool_] | None,
    ) -> _Seen:  # fmt: skip
        """Markers that enter and have a spot where they would be, which is nobody's yet."""
        placed = displaced(self.test.markers, state)
        aside = np.ones(len(placed), bool)
        aside[slide.entering] = False
        seen = self._near(image, name, state, placed, labelled, aside if hidden is None else aside | hidden)
        return _Seen.of(seen, _apart(seen.xy, labelled.xy))

    def _near(
        self, image: Image, name: str, state: Deformation, placed: MarkerSet, labelled: Labelled,
        hidden: NDArray[np.bool_] | None, like: Ints | None = None,
    ) -> Labelled:  # fmt: skip
        """The spots at some places in a state."""
        station = self.test.station(name)
        return near(
            image, self.test, station, state.cameras.get(name, station.camera),
            state.cam_from_tunnel.get(name, station.cam_from_tunnel), placed, 0.0, labelled, hidden, like,
            labelled.saturation,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Seen:
    """Spots at some places of a picture.

    Parameters
    ----------
    labels : of each, the number of the slide and the marker
    xy : (n, 2) where they are
    lack : whether some places that should be seen have none
    """

    labels: tuple[Label, ...]
    xy: Array
    lack: bool = False

    @staticmethod
    def none() -> _Seen:
        return _Seen((), np.zeros((0, 2)))

    @staticmethod
    def of(seen: Labelled, which: NDArray[np.bool_]) -> _Seen:
        """Some of the markers that were seen."""
        return _Seen(tuple((0, m) for m in seen.marker[which].tolist()), seen.xy[which])


def _lost(left: Array, there: _Seen, marks: _Seen, labelled: Labelled, slide: Slide, own: _Seen) -> int:
    """How many spots a part that is further on leaves unexplained.

    ``left`` (n, 2) of its markers that leave, ``own`` of known marks beyond its rows; ``there`` is what its markers
    that enter have then, and ``marks`` what those marks have.
    """
    spots = np.concatenate([left, own.xy])
    stay = labelled.xy[~np.isin(labelled.marker, slide.vacated)]
    return int((_apart(spots, marks.xy) & _apart(spots, stay) & _apart(spots, there.xy)).sum())


def _new(there: _Seen, marks: _Seen, labelled: Labelled, own: _Seen) -> frozenset[Label]:
    """The spots that it explains in their place."""
    xy, labels = np.concatenate([there.xy, marks.xy]), (*there.labels, *marks.labels)
    once = np.r_[np.ones(len(there.xy), bool), _apart(marks.xy, there.xy)]
    new = once & _apart(xy, labelled.xy) & _apart(xy, own.xy)
    return frozenset(label for label, is_new in zip(labels, new.tolist(), strict=True) if is_new)


def _apart(xy: Array, others: Array) -> NDArray[np.bool_]:
    """(n,) which spots are none of some others."""
    return np.asarray(cKDTree(others).query(xy)[0] > OWN_PX) if len(others) else np.ones(len(xy), bool)
