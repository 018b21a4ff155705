"""A part on its way along one parameter of its law, and what spots its markers come onto there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import pdtrc

from windmark.deformation import Deformation
from windmark.deformation.law import LawError
from windmark.deformation.turned import rotated, turns
from windmark.deformation.volumes import Placed
from windmark.geometry import Camera, Pose
from windmark.tasks.deform.task import DeformationTest

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

HALF = 0.5
"""A part with spots for less than this part of its markers in view is asked; at its place so many must have one."""
LEAST = 3
"""... and at least so many: two spots are as far from each other as two markers are too often."""
REACH_PX = 3.0
"""So near to a spot a marker must come; steps move none of them farther."""
APART = 2
"""Steps: nearer to each other two places are the same."""
STEPS = 600
"""At most each way: a full turn of markers that are 250 pixels from the hinge."""
CHANCE = 1e-3
"""That spots which lie at random, as densely as they do, are so many anywhere on the way."""


@dataclass(frozen=True, eq=False)
class View:
    """A camera, and the spots of its picture that no marker of another part has."""

    camera: Camera
    pose: Pose
    free: cKDTree

    @property
    def chance(self) -> float:
        """Of a spot so near to a place."""
        return min(self.free.n * np.pi * REACH_PX**2 / float(np.prod(self.camera.size_px)), 1.0)


@dataclass(frozen=True, eq=False)
class Peak:
    """Parameters of all laws, where that puts the markers in each picture, and how many spots these come onto."""

    q: Array
    xy: Array  # NaN out of the picture
    spots: int
    in_view: int
    by_chance: float
    off2: float

    def is_at(self, other: Peak) -> bool:
        """Whether it is the same place, by a step: an angle comes round."""
        out = np.isnan(self.xy) & np.isnan(other.xy)
        return bool((out | (np.abs(self.xy - other.xy) < 2 * REACH_PX)).all())


@dataclass(frozen=True, eq=False)
class Way:
    """A part on its way along one parameter of its law, from where it is both ways.

    Parameters
    ----------
    placed : its markers, bound to the laws
    normal : (n, 3) of these, undeformed
    """

    column: int
    state: Deformation
    views: list[View]
    placed: Placed
    normal: Array

    @staticmethod
    def of(own: Ints, column: int, state: Deformation, views: list[View], test: DeformationTest) -> Way:
        """Of the markers (n,) of a part along one parameter of all laws, from a state."""
        placed = state.volumes.bind(state.placed.xyz[own], state.placed.names[own])
        return Way(column, state, views, placed, test.markers.normal[own])

    def peaks(self) -> list[Peak]:
        """The best place, and the next best one apart from it, of those that are no chance."""
        back, on = self._walked(-1.0), self._walked(1.0)
        walked = [*reversed(back), *on]
        if on and self._comes_round(on):  # half a turn each way is all of it
            walked = [*reversed(back[: len(back) // 2]), *on[: len(on) // 2 + 1]]
        best: list[int] = []
        for k in sorted(range(len(walked)), key=lambda k: (-walked[k].spots, walked[k].off2)):
            at = walked[k]
            few = at.spots < max(LEAST, HALF * at.in_view)
            if few or len(walked) * pdtrc(at.spots - 1, at.by_chance) > CHANCE:
                continue
            if all(abs(k - other) > APART and not at.is_at(walked[other]) for other in best):
                best.append(k)
            if len(best) > 1:
                break
        return [walked[k] for k in best]

    def _walked(self, way: float) -> list[Peak]:
        """Steps one way, to the bound of the parameter, the end of its law or of the pictures."""
        parameter = self.state.volumes.parameters[self.column]
        out, at, step = list[Peak](), self._at(self.state.q), parameter.step
        for _ in range(STEPS):
            if at is None:
                break
            there = at.q.copy()
            there[self.column] = np.clip(there[self.column] + way * step, parameter.lower, parameter.upper)
            if there[self.column] == at.q[self.column] or (after := self._at(there)) is None:
                break
            moved = float(np.nan_to_num(np.abs(after.xy - at.xy)).max(initial=0.0))
            if moved == 0:
                break
            step *= min(max(REACH_PX / moved, 0.1), 1e3)
            if moved > 2 * REACH_PX or (not out and moved < REACH_PX / 10):
                continue
            out.append(after)
            at = after
            if not at.in_view or self._comes_round(out):
                break
        return out

    def _comes_round(self, walked: list[Peak]) -> bool:
        """Whether the markers are back where they were first, after they had been elsewhere."""
        first, last = walked[0], walked[-1]
        return len(walked) > 2 * APART and last.is_at(first) and not walked[len(walked) // 2].is_at(first)

    def _at(self, q: Array) -> Peak | None:
        """What the markers come onto with some parameters; None where the laws have no place."""
        try:
            xyz = self.state.tunnel_from_model.apply(self.placed.place(q))
        except LawError:
            return None
        normal = self.state.tunnel_from_model.rotate(rotated(turns(self.placed, q, self.normal), self.normal))
        places, spots, in_view, by_chance, off2 = [], 0, 0, 0.0, 0.0
        for view in self.views:
            center = view.pose.apply(xyz)
            xy, valid = view.camera.project(center)
            facing = ~((view.pose.rotate(normal) * center).sum(axis=1) >= 0)  # without a normal: facing
            inside = valid & view.camera.in_image(xy)
            seen = inside & facing
            away, spot = view.free.query(xy[seen], distance_upper_bound=REACH_PX)
            near = np.isfinite(away)
            spots, in_view = spots + len(np.unique(spot[near])), in_view + int(seen.sum())
            by_chance, off2 = by_chance + view.chance * int(seen.sum()), off2 + float((away[near] ** 2).sum())
            places.append(np.where(inside[:, None], xy, np.nan))
        return Peak(q, np.concatenate(places), spots, in_view, by_chance, off2) if places else None
