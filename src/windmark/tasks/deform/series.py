"""What the frames so far say together, and what that does to the state of a frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation
from windmark.deformation.equations import Equations
from windmark.deformation.evidence import Evidence, Instant, instant_of
from windmark.deformation.few_walls import walls_alone
from windmark.deformation.lasting import Lasting, lasting
from windmark.deformation.late import Late, lateness
from windmark.deformation.misfit import Misfit, length_unit
from windmark.deformation.patterns import fields_of
from windmark.deformation.pushed import Pushed, pushed
from windmark.deformation.solve import Solved, free_names
from windmark.deformation.wall_places import Displaced, WallPlaces, displaced
from windmark.scene import Doubt
from windmark.tasks.deform.task import DeformationTest, FrameImages

Array = NDArray[np.float64]

OF_ONE_INSTANT = ("moved", "picture")
"""Causes of doubts that a frame by itself gives to what a late camera shows."""
OF_ONE_POSE = ("moved", "picture", "bent", "noise")
"""Such causes where it was pushed."""


@dataclass(frozen=True, eq=False)
class Series:
    """The frames so far.

    Parameters
    ----------
    views : the cameras
    wind_off : names of the frames that the markers' places are of
    evidence : what they say together; None before the first one
    with_wind : how many of them are others than these
    place, instant : where the markers were in the tunnel at the last of them, (N, 3), and when that was
    moving : (N, 3) how far they moved per unit of time before it; None where that is not known
    moved2, changed2 : sum of squares of that, and of its changes, over the frames that have both
    last : what the last one says; None where nothing was added
    late : the camera that all of them show at another time than the others
    lasting : what the laws lack in all of them alike
    pushed : the camera that all of them show from elsewhere
    fixed : of each camera whether its pose is taken as known
    frames : how many of them have wind, those in which a camera contradicts the others included
    walls : what those with wind say of the places of markers on walls that alone hold the cameras; None for nothing
    displaced : the markers on walls that all of them show elsewhere
    """

    views: tuple[str, ...]
    wind_off: tuple[str, ...] = ()
    evidence: Evidence | None = None
    with_wind: int = 0
    place: Array | None = None
    instant: float = 0.0
    moving: Array | None = None
    moved2: float = 0.0
    changed2: float = 0.0
    last: Instant | None = None
    late: Late | None = None
    lasting: Lasting | None = None
    pushed: Pushed | None = None
    fixed: tuple[bool, ...] = ()
    frames: int = 0
    walls: WallPlaces | None = None
    displaced: Displaced | None = None

    @staticmethod
    def of(test: DeformationTest) -> Series | None:
        """Before the first frame; None where errors of the table are not known, which are the same in all of them."""
        model = test.markers.role != "wall"
        if test.marker_cov is None and not np.isfinite(test.markers.sigma[model]).all():
            return None
        fixed = tuple(not s.moves for s in test.stations)
        return Series(tuple(s.name for s in test.stations), test.wind_off, fixed=fixed)

    def plus(self, solved: Solved, frame: FrameImages, *, odd: bool = False) -> Series:
        """One frame more; ``odd``: a camera contradicts the others in it, so that nothing tells what the laws lack.

        Spots between two pictures are where they were at the instant already: of such frames nothing tells lateness.
        """
        if solved.redundancy < 1:
            return self.without()
        equations, moving, cov = Equations(solved), None, solved.task.place_cov
        wind_off = frame.key in self.wind_off
        if self.place is not None and not frame.shots and not wind_off:
            moving = (solved.task.tunnel_place(solved.values) - self.place) / (frame.instant - self.instant)
        still = odd or wind_off
        instant = instant_of(equations, self.views, moving, still)
        evidence = self.evidence if self.evidence is not None else Evidence.none(self.views, solved.task.placed)
        evidence, count = evidence.plus(instant, cov, wind_off, frame.instant), self.with_wind + (not still)
        moved2, changed2 = self.moved2, self.changed2
        if moving is not None and self.moving is not None:
            moved2 += float((moving**2).sum() + (self.moving**2).sum()) / 2
            changed2 += float(((moving - self.moving) ** 2).sum())
        uneven = float(np.sqrt(changed2 / moved2)) if moved2 > 0 else 0.0
        # By clocks or time stamps instants are times.
        late = lateness(evidence, cov, uneven, "s" if frame.time_s == frame.instant else "frames")
        # A camera that is late between its pictures, which nothing tells, looks pushed where the model moves steadily.
        walls, off = self._of_walls(equations, evidence, frame) if not wind_off else (self.walls, self.displaced)
        frames, left, moved = self.frames + (not wind_off and not frame.shots), None, None
        # What a camera that is late or elsewhere leaves over looks like much else.
        if late is None and not frame.shots:
            moved = pushed(evidence, cov, frames, self.fixed, length_unit(solved.task.volumes))
        if late is None and moved is None:
            left = self.lasting if still else lasting(evidence, instant, equations, count, self.lasting)
        return Series(
            self.views, self.wind_off, evidence, count, instant.place, frame.instant, moving, moved2, changed2, instant,
            late, left, moved, self.fixed, frames, walls, off,
        )  # fmt: skip

    def _of_walls(
        self, equations: Equations, evidence: Evidence, frame: FrameImages
    ) -> tuple[WallPlaces | None, Displaced | None]:
        """What the frames say of the places of markers on walls, one of them more, and which are displaced."""
        task, alone = equations.solved.task, walls_alone(equations.solved)
        if frame.shots or not len(alone):
            return self.walls, self.displaced
        walls = self.walls
        if walls is None:
            walls = WallPlaces.none(np.flatnonzero(task.wall), len(task.wall))
        walls = walls.plus(equations, free_names(equations.solved.problem), task.place_cov)
        names = [str(n) for n in task.markers.name[walls.walls]]
        told, unit = self.displaced is not None, length_unit(task.volumes)
        return walls, displaced(walls, evidence, task.place_cov, names, unit, told=told)

    def without(self) -> Series:
        """The frames so far without what the last one says by itself; all that a frame hands on that says nothing."""
        return self if self.last is None else replace(self, last=None)

    @property
    def _of_a_camera(self) -> Late | Pushed | None:
        return self.late if self.late is not None else self.pushed

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """What is to be said of the series."""
        walls = () if self.displaced is None else (self.displaced.doubt,)
        off = self._of_a_camera
        if off is not None:
            return (off.doubt, *walls)
        return walls if self.lasting is None else (*self.lasting.doubts, *walls)

    def judged(self, state: Deformation) -> Deformation:
        """The state of the last frame with what all of them say; the same where that is nothing."""
        state, of = self._with_displaced(state), self._of_a_camera
        if of is None:
            return self._with_what_is_left(state)
        better = OF_ONE_INSTANT if self.late is not None else OF_ONE_POSE
        kept = tuple(d for d in state.doubts if d.cause not in better)
        doubts = (of.doubt, *kept)
        names = tuple(dict.fromkeys(n for d in doubts for n in d.names))
        cov = state.cov
        if self.last is not None:
            off = _by_name(of.shifts(self.last), self.last.names, state.names)
            cov = cov + off @ off.T
        return replace(state, cov=cov, set_up=state.cov_of_set_up, doubts=doubts, suspect=names)

    def _with_displaced(self, state: Deformation) -> Deformation:
        """The state with what markers on walls are off by; the frame by itself names some of them, or fewer."""
        of, walls = self.displaced, self.walls
        if of is None or walls is None or self.last is None or walls.names != self.last.names:
            return state
        doubt = of.doubt
        doubts = (doubt, *(d for d in state.doubts if d.cause != "marker" or not set(d.names) & set(doubt.names)))
        own = _by_name(np.eye(len(walls.names)), walls.names, state.names)
        more = own @ of.more(walls.follow) @ own.T
        names = tuple(dict.fromkeys(n for d in doubts for n in d.names))
        return replace(state, cov=state.cov + more, set_up=state.cov_of_set_up, doubts=doubts, suspect=names)

    def _with_what_is_left(self, state: Deformation) -> Deformation:
        """The state with what the laws lack in all frames; what it has found by itself gives way, if it is that."""
        left, last = self.lasting, self.last
        if left is None or last is None or self.evidence is None:
            return state
        lacking, fields = self.evidence.lacking, fields_of(state.placed)
        if fields is None or not last.follow[:, lacking].any():  # one without wind
            return state
        set_up = state.cov_of_set_up
        if state.misfit is not None and left.explains(state.misfit, last, lacking):
            state = _without_misfit(state, left.doubts)
        own, which, (value, second) = state.misfit, left.which, left.at(last.load)
        more = np.ones(len(which), bool) if own is None else ~np.isin(which, own.chosen)
        said = {n for d in state.doubts if d.cause == "bent" for n in d.names}
        doubts = (*state.doubts, *(d for d in left.doubts if not set(d.names) <= said))
        if not more.any():
            return replace(state, doubts=doubts)
        follow = _by_name(last.follow[:, lacking[which[more]]], last.names, state.names)
        second = second[np.ix_(more, more)]
        misfit = Misfit(fields.shapes, which[more], value[more], second, follow)
        names = tuple(dict.fromkeys(n for d in doubts for n in d.names))
        return replace(
            state, cov=state.cov + follow @ second @ follow.T, doubts=doubts, suspect=names,
            misfit=misfit if own is None else _both(own, misfit), set_up=set_up,
        )  # fmt: skip


def _without_misfit(state: Deformation, better: tuple[Doubt, ...]) -> Deformation:
    """The state without what it has found by itself that the laws lack, of which there are ``better`` doubts."""
    own = state.misfit
    assert own is not None
    doubts = tuple(d for d in state.doubts if d.cause != better[0].cause)
    return replace(state, cov=state.cov - own.follow @ own.second @ own.follow.T, misfit=None, doubts=doubts)


def _both(a: Misfit, b: Misfit) -> Misfit:
    """Two misfits of the same shapes that have no column in common."""
    second = np.zeros((len(a.value) + len(b.value),) * 2)
    second[: len(a.value), : len(a.value)], second[len(a.value) :, len(a.value) :] = a.second, b.second
    return Misfit(a.shapes, np.r_[a.chosen, b.chosen], np.r_[a.value, b.value], second, np.c_[a.follow, b.follow])


def _by_name(values: Array, names: tuple[str, ...], wanted: tuple[str, ...]) -> Array:
    """(G, k) rows of some unknowns (F, k) as those of others; 0 for what is not among them."""
    own = {n: k for k, n in enumerate(names)}
    return np.array([values[own[n]] if n in own else np.zeros(values.shape[1]) for n in wanted])
