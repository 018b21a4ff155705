"""From a candidate to a solution: labels and pose that agree with each other, and what they are worth.

The search works with one tolerance and with some of the spots. Here all spots, their covariances and those of the
markers count, and the gates, weights and covariances are as wide as the data say (`_kernels.fit`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import SolveReport
from windmark.geometry import Pose
from windmark.registration._kernels.fit import (
    COST_END,
    COST_START,
    EXCESS,
    EXPECTED,
    FOCAL,
    ITERATIONS,
    MISFIT,
    Fit,
    Markers,
    Spots,
    State,
    copy_of,
    pose_covariance_kernel,
    state_of,
)
from windmark.registration._kernels.settle import STEADY, accept_kernel, settle_kernel
from windmark.registration.evidence import Evidence, weigh
from windmark.registration.search.layout import Frame
from windmark.registration.search.plane import Plane
from windmark.registration.search.pool import Candidate

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SAME_SHARE, SAME_ANGLE, SAME_DISTANCE2 = 0.6, float(np.radians(3.0)), 36.0
"""Two solutions are one if more than this share of the pairs is, and the poses agree."""

HIDING_ROUNDS = 3
"""How often what hides what is asked again from a better pose."""
FREED_SIGMA = 0.3
"""Relative 1 sigma of a given focal length that is doubted."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A refined labelling with its evidence.

    Parameters
    ----------
    cam_from_model, focal_px : pose and focal length
    detection, marker : (K,) the pairs, in order of markers
    expected : number of markers that should be seen
    excess_px : 1 sigma per coordinate of the misfit that the given covariances do not explain
    misfit_px : 1 sigma per coordinate of the residuals, by the redundancy
    evidence : how much it is worth
    markers : the kernels' view of the markers; those that something hides are turned away from the camera
    state : the kernels' view of the solution
    frame, size : of the unit model; 7 parameters with a free focal length, else 6
    """

    cam_from_model: Pose
    focal_px: float
    detection: Ints
    marker: Ints
    expected: int
    excess_px: float
    misfit_px: float
    evidence: Evidence
    markers: Markers
    state: State
    frame: Frame
    size: int

    @property
    def count(self) -> int:
        """Matched markers."""
        return len(self.marker)

    @property
    def parameters(self) -> float:
        """Parameters that the pairs determine."""
        return float(self.size)

    @cached_property
    def cov(self) -> Array:
        """(6, 6) of [rotation, translation] for ``exp(delta) @ pose``; (7, 7) with the focal length if that is free."""
        state = self.state
        return np.asarray(
            pose_covariance_kernel(state.factor, self.size, state.translation, self.frame.scale, self.focal_px)
        )

    @property
    def focal_sigma(self) -> float:
        """Relative 1 sigma of the focal length; 0 where it is given."""
        return float(np.sqrt(self.cov[6, 6])) / self.focal_px if self.size == 7 else 0.0

    @property
    def report(self) -> SolveReport:
        """How the last fit ended."""
        n = self.state.numbers
        steps = int(n[ITERATIONS])
        return SolveReport("converged_gradient", True, steps, steps, float(n[COST_START]), float(n[COST_END]))

    def places(self, plane: Plane) -> Array:
        """(N, 2) where it has the markers, in the search plane."""
        x, y, z = (self.unit_xyz(plane) @ self.state.rotation.T + self.state.translation).T
        return self.focal_px * np.stack([x, y], axis=1) / z[:, None]

    def unit_xyz(self, plane: Plane) -> Array:
        """(N, 3) markers of the unit model as it has them."""
        return plane.model.xyz

    def shared(self, other: Solution) -> float:
        """Share of the pairs that two solutions have in common, of the smaller one's."""
        same = (self.state.match == other.state.match) & (self.state.match >= 0)
        return float(same.sum()) / min(self.count, other.count)

    def same_as(self, other: Solution) -> bool:
        """Mostly the same pairs, and poses that agree within three degrees or six sigma of the less certain one."""
        if self.shared(other) <= SAME_SHARE:
            return False
        if self.cam_from_model.angle_to(other.cam_from_model) < SAME_ANGLE:
            return True
        delta = (self.cam_from_model @ other.cam_from_model.inverse()).log()
        return bool(min(delta @ np.linalg.solve(s.cov[:6, :6], delta) for s in (self, other)) < SAME_DISTANCE2)


def settle(plane: Plane, candidate: Candidate) -> Solution | None:
    """Refine a candidate to a fixed point of labelling; None where it falls apart or leaves the prior."""
    rotation, translation = plane.frame.unit(candidate.cam_from_model)
    state = state_of(rotation, translation, candidate.focal_px, candidate.match)
    markers = _settled(plane, plane.fit, state)
    if markers is None:
        return None
    solution = solution_of(plane, markers, state, plane.fit)
    return solution if plane.task.allows(solution.cam_from_model, solution.focal_px) else None


def _settled(plane: Plane, fit: Fit, state: State) -> Markers | None:
    """Settle a state, with what hides what; the markers as they were seen, None where it falls apart.

    What is hidden depends on the pose and the pose on what is matched; it comes to rest at once but for markers
    on a silhouette, which stay as the last pose has them.
    """
    if settle_kernel(plane.markers, plane.spots, fit, state, 0) != STEADY:
        return None
    markers, before = plane.markers, np.zeros(len(state.match), dtype=bool)
    for _ in range(HIDING_ROUNDS if plane.task.visible is not None else 0):
        pose = plane.frame.pose(state.rotation.copy(), state.translation.copy())
        hidden = plane.task.hidden(pose, float(state.numbers[FOCAL]))
        if (hidden == before).all():
            break
        before, markers = hidden, without_hidden(plane, hidden, state.rotation, state.translation)
        state.match[hidden] = -1
        if settle_kernel(markers, plane.spots, fit, state, 0) != STEADY:
            return None
    return markers


def without_hidden(plane: Plane, hidden: NDArray[np.bool_], rotation: Array, translation: Array) -> Markers:
    """The markers with those that something hides (N,) turned away from a camera with this pose of the unit model.

    A marker that faces away is neither matched nor missed, and that is what hidden means.
    """
    from_eye = plane.markers.xyz + rotation.T @ translation
    normal = np.where(hidden[:, None], from_eye, plane.markers.normal)
    return plane.markers._replace(normal=np.ascontiguousarray(normal))


def with_free_focal(plane: Plane, solution: Solution, without: int | None = None) -> Solution | None:
    """The solution as it would be with an unknown focal length; None where it falls apart.

    The pair of marker ``without`` has to earn its place again.
    """
    fit = plane.fit._replace(focal_weight=FREED_SIGMA**-2)
    state = copy_of(solution.state)
    if without is not None:
        state.match[without] = -1
    markers = _settled(plane, fit, state)
    return None if markers is None else solution_of(plane, markers, state, fit)


def accepted(plane: Plane, solution: Solution, spots: Spots) -> Solution:
    """The solution as it is reported: its excess by the residuals alone, with the given places of the spots.

    While labels may still be wrong, the gates are kept a little open. Once they are accepted that doubt has
    no place in the covariance.
    """
    state = copy_of(solution.state)
    if not accept_kernel(solution.markers, spots, plane.fit, state):
        return solution
    return replace(
        solution,
        cam_from_model=plane.frame.pose(state.rotation, state.translation),
        focal_px=float(state.numbers[FOCAL]),
        excess_px=float(np.sqrt(state.numbers[EXCESS])),
        state=state,
    )


def solution_of(plane: Plane, markers: Markers, state: State, fit: Fit) -> Solution:
    """The solution that a settled state is, with the markers as they were seen."""
    numbers = state.numbers
    marker = np.flatnonzero(state.match >= 0)
    detection = state.match[marker].astype(np.int64)
    expected = int(numbers[EXPECTED])
    return Solution(
        cam_from_model=plane.frame.pose(state.rotation, state.translation),
        focal_px=float(numbers[FOCAL]),
        detection=detection,
        marker=marker,
        expected=expected,
        excess_px=float(np.sqrt(numbers[EXCESS])),
        misfit_px=float(np.sqrt(numbers[MISFIT])),
        evidence=weigh(plane, detection, state.residual[marker], state.spread[marker], expected),
        markers=markers,
        state=state,
        frame=plane.frame,
        size=7 if fit.focal_weight > 0 else 6,
    )
