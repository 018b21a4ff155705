"""Other explanations of the residuals: a camera that is not as given, a model that is bent; and what cannot be told.

Both are the same least squares with more unknowns, whose priors say how large such errors are. To first order their
gain is known from the normal equations; only where that promises something are they settled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2, g3
from windmark.geometry import Camera
from windmark.registration import rules
from windmark.registration.cached import cached_property
from windmark.registration.judge.first_order import Look, look_at, shown
from windmark.registration.judge.own import is_loose
from windmark.registration.result import Cause, Unchecked
from windmark.registration.settle._kernels.doubt import (
    DOUBTED_ASPECT,
    DOUBTED_CENTRE,
    DOUBTED_EDGE,
    DOUBTED_FOCAL,
    doubt_kernel,
)
from windmark.registration.settle._kernels.places import places_kernel
from windmark.registration.settle.settling import accepted, opened, with_freedom
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import Views

Array = NDArray[np.float64]

PARTS = {"focal length": (0,), "aspect": (1,), "principal point": (2, 3), "lens": (4,)}
"""Columns of `doubted_camera`."""
UNITS = {
    "focal length": DOUBTED_FOCAL, "aspect": DOUBTED_ASPECT, "principal point": DOUBTED_CENTRE, "lens": DOUBTED_EDGE,
}  # fmt: skip
"""1 sigma of the prior of each, in the units of `rules.CHECKED`."""
EXCHANGED = "exchanged"
"""What is wrong of two cameras that are in each other's place."""
UNSEEN = {
    "focal length": "a focal length that is off by less than {size} %",
    "aspect": "an aspect that is off by less than {size} %",
    "principal point": "a principal point that is off by less than {size} px",
    "lens": "a lens that shifts the image's corner by less than {size} % of its distance from the centre",
}


@dataclass(frozen=True, eq=False)
class OtherCamera:
    """A camera that explains the spots better than the given one: what of it is wrong, in words, and the solution.

    ``is_slight``: it is off by so little that the pose as given can be had with a sigma that covers it.
    """

    what: str
    words: str
    solution: Solution
    is_slight: bool

    @property
    def cause(self) -> Cause:
        """Of a refusal for it."""
        if self.what == EXCHANGED:
            return "exchanged"
        return "wrong_focal" if self.what == "focal length" else "wrong_camera"


@dataclass(frozen=True, eq=False)
class Doubts:
    """What a rigid solution leaves to doubt.

    Parameters
    ----------
    views : what was seen, rigid and with the cameras as given
    best : the solution; rigid, or the bent one that is to be judged
    bend : 1 sigma of the deformation that the model may have, in sizes of the unit model; 0: none
    margin : lead (nats) that counts as one
    """

    views: Views
    best: Solution
    bend: float
    margin: float

    @cached_property
    def look(self) -> Look:
        """To first order."""
        return look_at(self.best, 0.0 if self.best.is_bent else self.bend, self.margin)

    @property
    def camera_promises(self) -> bool:
        """Whether another camera may explain the spots better."""
        if self.best.is_bent or self.best.count < rules.UNFOUND * self.best.expected:
            return True
        return self.look.camera > rules.DOUBT

    @cached_property
    def bending_promises(self) -> bool:
        """Whether a bent model may explain the spots better."""
        if not self.bend > 0.0:
            return False
        if any(is_loose(self.best, c) for c in range(len(self.best.counts))):
            return True
        if self.best.count < self.best.expected and self._near_missing():
            return True
        return self.look.bending > rules.DOUBT

    def _near_missing(self) -> bool:
        """Whether more of the missing markers than by chance have a free spot near, as far as bending could be."""
        for c, plane in enumerate(self.best.views.planes):
            if _free_spots_near(self.best, c, plane.task.tolerance_px):
                return True
        return False

    @cached_property
    def _others(self) -> list[tuple[Solution, str]]:
        """The solutions with cameras that may be wrong in one thing, and in everything; and what is wrong in each."""
        free = all(plane.task.free_focal for plane in self.views.planes)
        parts = {what: columns for what, columns in PARTS.items() if not (free and what == "focal length")}
        # A rigid solution may leave a spot to no marker; a bent one competes with other cameras of a straight model.
        found, views = [], self.views if self.best.is_bent else self.best.views
        if (every := with_freedom(views.doubted(), self.best)) is not None:
            found.append((every, max(parts, key=lambda what: self._most_off(every, what)[0] / rules.CHECKED[what])))
            if not self.best.is_bent and every.fit < self.best.fit + rules.DOUBT:
                return found  # a single thing explains no more than all of them do
        for what, columns in parts.items():
            if (single := with_freedom(views.doubted(columns=columns), self.best)) is not None:
                found.append((single, what))
        return found

    def other_camera(self, rigid: float) -> OtherCamera | None:
        """Another camera that explains the spots better; None where none does.

        It must be better by the margin than a rigid model with the given camera (``rigid`` nats, where that is an
        answer beside a bent one), and at least as good as a bent one. And beside a rigid one the pose must be another
        by it, in its own sigmas: a misfit that the sigmas know of does no harm. A deformation that is none does.
        """
        if not self._others:
            return None
        other, what = max(self._others, key=lambda f: f[0].evidence)
        if self.best.is_bent and (straight := with_freedom(self.views, self.best)) is not None:
            rigid = max(rigid, straight.evidence)
        least = max(rigid + self.margin, self.best.evidence + (0.0 if self.best.is_bent else self.margin))
        if other.evidence < least or not (self.best.is_bent or self._moves(other)):
            return None
        off, c = self._most_off(other, what)
        is_slight = off <= rules.SLIGHT * rules.CHECKED[what] and fits_slightly(self.best)
        return OtherCamera(what, self._words(what, c, other), other, is_slight)

    def is_open(self, other: OtherCamera) -> bool:
        """Whether a bent model does nearly as well: which of the two it is the picture does not tell."""
        return self.best.is_bent and other.solution.evidence < self.best.evidence + self.margin

    def _moves(self, other: Solution) -> bool:
        """Whether another solution has another pose, by the sigmas of the one that is judged."""
        delta = (other.rig_from_model @ self.best.rig_from_model.inverse()).log()
        return bool(delta @ np.linalg.solve(self.best.cov, delta) > rules.MOVED**2)

    def _most_off(self, solution: Solution, what: str) -> tuple[float, int]:
        """How far the farthest camera is from the given one, in the units of `rules.CHECKED`, and which it is."""
        off = [
            _off(what, self.best.camera(c), solution.camera(c), _diagonal(self.views, c))
            for c in range(len(self.views.planes))
        ]
        return max(off), int(np.argmax(off))

    def _words(self, what: str, c: int, single: Solution) -> str:
        given, found = self.best.camera(c), single.camera(c)
        head = f"camera {self.views.names[c]}: " if len(self.best.counts) > 1 else ""
        misfit = f"the misfit falls from {g2(self.best.misfit_px[c])} to {g2(single.misfit_px[c])} px"
        if what == "focal length":
            return (
                f"{head}the given focal length of {given.focal_px:.5g} px does not fit: with {found.focal_px:.5g} px "
                f"{misfit}; correct it, or set free_focal"
            )
        if what == "principal point":
            return (
                f"{head}the given principal point does not fit: with one that is {found.cx - given.cx:+.0f}, "
                f"{found.cy - given.cy:+.0f} px away {misfit}; is the picture a crop of the calibrated one?"
            )
        if what == "aspect":
            return f"{head}the given aspect does not fit: with {found.aspect:.4f} for {given.aspect:.4f} {misfit}"
        return (
            f"{head}the given lens does not fit: with k1 = {g3(found.k1)} for {g3(given.k1)} {misfit}; "
            "calibrate its distortion"
        )

    def loose_focal(self, most: float) -> str:
        """Why a free focal length is not determined to ``most`` (relative 1 sigma); empty if it is."""
        for c, plane in enumerate(self.views.planes):
            if plane.task.free_focal and (sigma := self._focal_sigma(c)) > most:
                return (
                    f"the labelling is clear, but this view fixes the focal length only to {100 * sigma:.0f} % "
                    f"(1 sigma; limit {100 * most:.0f} %): give the focal length, or a view that is less frontal or of "
                    "a less flat set of markers"
                )
        return ""

    def _focal_sigma(self, c: int) -> float:
        """Relative 1 sigma of a free focal length as it would be reported, and where the lens may be a little wrong.

        A focal length that is read out of the distortion alone is as good as the lens model: errors of it that count
        as checked are nowhere else.
        """
        best = accepted(self.best)
        views = best.views.doubted(columns=PARTS["lens"])
        normal, _ = doubt_kernel(views.sights, opened(views, best.state))
        cameras, columns = len(views.planes), views.loose.shape[2]
        known = np.ones((cameras, columns))
        known[:, -1] = (DOUBTED_EDGE / rules.CHECKED["lens"]) ** 2
        normal[6:, 6:] += np.diag(np.append(known, np.ones(len(views.modes))))
        at = 6 + c * columns
        return self.views.planes[c].task.focal_sigma * float(np.sqrt(np.linalg.inv(normal)[at, at]))

    def unchecked(self) -> tuple[Unchecked, ...]:
        """What of the cameras this picture would not show if it alone were wrong."""
        found, told = [], self.look.told.tolist()
        for c in self.best.seeing:
            for what, columns in PARTS.items():
                if what == "focal length" and self.views.planes[c].task.free_focal:
                    continue
                # What the spots tell least of may be off most.
                size = shown(min(told[c][k] for k in columns), self.margin) * UNITS[what]
                if size > rules.CHECKED[what]:
                    much = 100 * size if what != "principal point" else size * _diagonal(self.views, c)
                    words = UNSEEN[what].format(size=g2(much)) + " would go unnoticed here"
                    found.append(Unchecked(what, words, self.views.names[c]))
        return tuple(found)


def fits_slightly(best: Solution) -> bool:
    """Whether what is wrong leaves no more than a slightly wrong camera may."""
    return all(best.excess_px[c] < rules.SLIGHT_PX for c in best.seeing)


def _diagonal(views: Views, c: int) -> float:
    return float(np.hypot(*views.planes[c].task.camera.size_px))


def _off(what: str, given: Camera, found: Camera, diagonal: float) -> float:
    """How far a camera is from the given one, in the units of `rules.CHECKED`."""
    if what == "focal length":
        return abs(math.log(found.focal_px / given.focal_px))
    if what == "aspect":
        return abs(found.aspect - given.aspect)
    if what == "principal point":
        return math.hypot(found.cx - given.cx, found.cy - given.cy) / diagonal
    return _corner_shift(given, replace(given, k1=found.k1))


def _corner_shift(given: Camera, found: Camera) -> float:
    """How far another lens shifts the image's corners, as part of their distance from the centre.

    Measured in the image, as coefficients mean something else in each lens model; where the given lens ends before the
    corner (a fisheye's circle), at its end.
    """
    middle = np.array([given.cx, given.cy])
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * (np.array(given.size_px) - 1.0)
    share = np.linspace(0.0, 1.0, 33)[1:, None, None]
    xy = middle + share * (corners - middle)
    there, valid = found.project(given.directions(xy))
    shift = np.linalg.norm(there - xy, axis=2) / np.linalg.norm(xy - middle, axis=2)
    ends = np.where(valid.any(axis=0), len(share) - 1 - valid[::-1].argmax(axis=0), 0)
    at_end = shift[ends, np.arange(4)]
    return float(np.where(np.isfinite(at_end), at_end, 0.0).max())


NEAR_BY_CHANCE, MORE = np.array([0.15, 0.03, 0.006]), 2.0
"""A sign of bending: a number of missing markers with a free spot near, this many sigma above chance; near is where the
chance of a foreign spot is one of these."""


def _free_spots_near(best: Solution, c: int, most_px: float) -> bool:
    plane, state = best.views.planes[c], best.state
    free = np.delete(plane.task.xy, best.pairs(c)[0], axis=0)
    missing = np.flatnonzero((state.match[c] < 0) & state.faces[c])
    seen = places_kernel(best.views.sights, state, c)[missing]
    seen = seen[np.isfinite(seen[:, 0])]
    if not len(free) or not len(seen):
        return False
    density = len(free) / float(np.prod(plane.task.camera.size_px))
    widest = 6 * most_px
    reach2 = np.minimum(widest**2, NEAR_BY_CHANCE / (np.pi * density))
    u, v = free[:, 0] - seen[:, :1], free[:, 1] - seen[:, 1:]
    nearest2 = (u * u + v * v).min(axis=1)
    near, expected = (nearest2[:, None] < reach2).sum(axis=0), len(seen) * np.pi * reach2 * density
    return bool((near > 1 + expected + MORE * np.sqrt(expected)).any())
