"""A part that its own law moved farther than it was looked for: where its spots are now.

A flap that is set anew between two pictures, or a panel that jumps, leaves the places at which its markers are looked
for. One or two of them come near a spot of another marker there, and with one parameter that is an answer: a wrong one
with a small sigma. So a part is asked anew where most of its markers in view have no spot. One parameter of its law at
a time goes through its whole range; where most of its markers come onto spots that no marker of another part has, by
no chance, there it is. Where that tells nothing though as many spots more than before are nobody's, the part is in
doubt.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.deformation import Deformation, Volumes, with_parameters
from windmark.deformation.law import Law
from windmark.deformation.misfit import carried
from windmark.errors import g3
from windmark.geometry import Camera, Pose
from windmark.scene import Detections, Doubt
from windmark.tasks.deform.memory import displaced
from windmark.tasks.deform.rival import SURE
from windmark.tasks.deform.spots import OWN_PX, Labelled
from windmark.tasks.deform.states import doubted
from windmark.tasks.deform.task import DeformationTest
from windmark.tasks.deform.way import HALF, LEAST, View, Way
from windmark.tasks.predictions import from_camera

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Masks = Mapping[str, NDArray[np.bool_]]


@dataclass(frozen=True, eq=False)
class Part:
    """A part with a law of its own that moves some of the markers.

    Parameters
    ----------
    name : of the volume
    columns : (k,) its law's parameters among all
    own : (n,) the markers that it moves, among all
    """

    name: str
    columns: tuple[int, ...]
    own: Ints

    def is_named(self, test: DeformationTest, names: Collection[str]) -> bool:
        """Whether any of its parameters is among some."""
        return any(test.volumes.names[k] in names for k in self.columns)

    def values(self, state: Deformation) -> str:
        """Its parameters in a state, in words."""
        return " and ".join(f"{state.volumes.names[k]} = {g3(state.q[k])}" for k in self.columns)


def parts_of(test: DeformationTest) -> tuple[Part, ...]:
    """All parts that can be set anew."""
    out, wall, first = [], test.markers.role == "wall", 0
    for volume in test.volumes.parts:
        count = 0 if volume.law is None else len(volume.law.parameters)
        own = np.flatnonzero(np.isin(test.markers.volume, carried(test.volumes, volume.name)) & ~wall)
        if count and len(own) >= LEAST and len(own) < np.count_nonzero(~wall):
            out.append(Part(volume.name, tuple(range(first, first + count)), own))
        first += count
    return tuple(out)


def holding(test: DeformationTest, parts: Sequence[Part], q: Array) -> DeformationTest:
    """The test with parameters of some parts known to be as in ``q`` (K,): what is told without their markers."""
    held = dict[str, Law]()
    for part in parts:
        (law,) = [v.law for v in test.volumes.parts if v.name == part.name]
        assert law is not None
        known = zip(part.columns, law.parameters, strict=True)
        held[part.name] = with_parameters(law, {p.name: {"start": float(q[k]), "sigma": p.step} for k, p in known})
    volumes = tuple(replace(v, law=held.get(v.name, v.law)) for v in test.volumes.parts)
    return replace(test, volumes=Volumes.of(volumes, test.volumes.unit))


def thin_parts(
    parts: tuple[Part, ...], test: DeformationTest, state: Deformation, labelled: Mapping[str, Labelled],
    hidden: Masks,
) -> dict[str, tuple[int, int]]:  # fmt: skip
    """Parts most of whose markers in view have no spot: name -> spots and markers, all cameras together."""
    out = {}
    placed = displaced(test.markers, state)
    for part in parts:
        seen = sum(int(np.isin(s.marker, part.own).sum()) for s in labelled.values())
        if seen >= HALF * len(part.own) * len(labelled):
            continue  # of all of them, so of those in view
        expected = 0
        for name, spots in labelled.items():
            own = part.own if name not in hidden else part.own[~hidden[name][part.own]]
            camera, pose = _camera(test, state, name)
            expected += len(from_camera(camera, pose, placed.take(own), spots.radius_px))
        if expected >= LEAST and seen < HALF * expected:
            out[part.name] = seen, expected
    return out


def free_spots(spots: Mapping[str, Detections | str], taken: Mapping[str, Array]) -> dict[str, Array]:
    """Camera -> (F, 2) spots of the whole image that are none of those that are ``taken``."""
    every = {n: s for n, s in spots.items() if isinstance(s, Detections) and n in taken}
    return {n: s.xy[cKDTree(taken[n]).query(s.xy)[0] > OWN_PX] if len(taken[n]) else s.xy for n, s in every.items()}


def whereabouts(
    part: Part, state: Deformation, labelled: Mapping[str, Labelled], spots: Mapping[str, Detections | str],
    test: DeformationTest,
) -> Whereabouts | None:  # fmt: skip
    """One parameter of a part's law so that its markers have spots; None where nothing tells.

    Parameters
    ----------
    state : where all else is
    labelled, spots : camera -> spots with a marker, and all of the image
    """
    others = {n: s.xy[~np.isin(s.marker, part.own)] for n, s in labelled.items()}
    free = {n: xy for n, xy in free_spots(spots, others).items() if len(xy)}
    views = [View(*_camera(test, state, n), cKDTree(xy)) for n, xy in free.items()]
    peaks = [peak for column in part.columns for peak in Way.of(part.own, column, state, views, test).peaks()]
    peaks.sort(key=lambda peak: -peak.spots)
    # What fits as well elsewhere tells nothing.
    if not peaks or (len(peaks) > 1 and peaks[1].spots == peaks[0].spots):
        return None
    near = [p.q for p in peaks[1:2] if p.spots > peaks[0].spots - SURE]
    return Whereabouts(part, peaks[0].q, near[0] if near else None)


@dataclass(frozen=True, eq=False)
class Whereabouts:
    """Where a part is.

    Parameters
    ----------
    part : it
    q : (K,) parameters of all laws
    or_q : ... of another place, at which its markers come onto one spot fewer; None if it is clear
    """

    part: Part
    q: Array
    or_q: Array | None

    def doubt(self, state: Deformation) -> tuple[Doubt, ...]:
        """That the part may be at the other place: a row by which it is known may lack a marker and have a mark."""
        if self.or_q is None:
            return ()
        other = self.part.values(replace(state, q=self.or_q))
        return (Doubt((self.part.name,), (
            f"{{}} may be set otherwise: with {other} in place of {self.part.values(state)} its markers come onto just "
            "one spot fewer; see in the pictures which of its markers are at its ends"
        ), "layout"),)  # fmt: skip


def in_doubt(part: Part, state: Deformation, seen: int, expected: int, more: int) -> Doubt:
    """That a part may be set otherwise: ``more`` spots than before are nobody's."""
    names = " or ".join(state.volumes.names[k] for k in part.columns)
    return Doubt((part.name,), (
        f"{{}} may be set otherwise: {seen} of its {expected} markers in view have a spot with {part.values(state)}, "
        f"and {more} more spots than before are no marker's; give {names} a start and a sigma"
    ), "layout")  # fmt: skip


@dataclass
class Thin:
    """Parts most of whose markers in view have no spot, from frame to frame.

    Parameters
    ----------
    more : of each such part, how many spots more than before were nobody's in the picture in which it became one
    free : camera -> spots that were nobody's in the last picture that was searched as a whole and had no such part
    """

    more: dict[str, int] = field(default_factory=dict)
    free: dict[str, int] = field(default_factory=dict)

    def doubted(
        self, parts: Sequence[Part], state: Deformation, labelled: Mapping[str, Labelled],
        spots: Mapping[str, Detections | str], thin: Mapping[str, tuple[int, int]],
    ) -> Deformation:  # fmt: skip
        """The state, in doubt of parts that may be set otherwise; ``spots`` of images that were searched as a whole."""
        self.more = {name: count for name, count in self.more.items() if name in thin}
        if spots:
            free = {n: len(xy) for n, xy in free_spots(spots, {n: s.xy for n, s in labelled.items()}).items()}
            if not thin:
                self.free |= free
            more = sum(max(count - self.free[n], 0) for n, count in free.items() if n in self.free)
            self.more |= dict.fromkeys(thin, more)
        doubts = [
            in_doubt(part, state, *thin[part.name], self.more[part.name]) for part in parts
            if part.name in thin and self.more.get(part.name, 0) >= HALF * (thin[part.name][1] - thin[part.name][0])
        ]  # fmt: skip
        return doubted(state, *doubts)


def _camera(test: DeformationTest, state: Deformation, name: str) -> tuple[Camera, Pose]:
    station = test.station(name)
    return (state.cameras.get(name, station.camera), state.cam_from_tunnel.get(name, station.cam_from_tunnel))
