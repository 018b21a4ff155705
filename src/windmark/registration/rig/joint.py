"""A solution of all cameras: labels and pose that agree with each other, and what they are worth together."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import SolveReport
from windmark.geometry import Pose
from windmark.registration._kernels.evidence import likelihood_ratio, log10_nfa
from windmark.registration._kernels.fit import EXPECTED, State, pose_covariance_kernel
from windmark.registration._kernels.rig import (
    FIT_END,
    FIT_START,
    FIT_STEPS,
    Rig,
    RigState,
    accept_rig_kernel,
    rig_state_of,
    settle_rig_kernel,
)
from windmark.registration._kernels.settle import STEADY
from windmark.registration.evidence import Evidence
from windmark.registration.final import DISC_ROUNDS, are_discs, eccentricity, moved
from windmark.registration.search.plane import Plane
from windmark.registration.solution import (
    SAME_ANGLE,
    SAME_DISTANCE2,
    SAME_SHARE,
    Solution,
    solution_of,
)

Array = NDArray[np.float64]
Ints = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Joint:
    """A refined labelling of all cameras with its evidence.

    Parameters
    ----------
    cameras : whose it is
    scores : evidence of each camera in nats; they add up to that of the whole
    evidence : how much it is worth
    state : the kernels' view of it
    """

    cameras: Cameras
    scores: tuple[float, ...]
    evidence: Evidence
    state: RigState

    @cached_property
    def rig_from_model(self) -> Pose:
        """The pose."""
        return self.cameras.layout.frame.pose(self.state.rotation, self.state.translation)

    @cached_property
    def views(self) -> tuple[Solution, ...]:
        """What each camera sees of it; their covariances are those of the joint pose."""
        planes = enumerate(self.cameras.planes)
        return tuple(solution_of(plane, plane.markers, _one(self.state, c), plane.fit) for c, plane in planes)

    @property
    def cam_from_model(self) -> Pose:
        """The pose as the first camera sees it."""
        return self.views[0].cam_from_model

    @property
    def count(self) -> int:
        """Pairs of all cameras."""
        return int((self.state.match >= 0).sum())

    @property
    def expected(self) -> int:
        """Markers that should be seen, over all cameras."""
        return int(self.state.numbers[:, EXPECTED].sum())

    @cached_property
    def cov(self) -> Array:
        """(6, 6) of [rotation, translation] for ``exp(delta) @ rig_from_model``."""
        state, scale = self.state, self.cameras.layout.frame.scale
        return np.asarray(pose_covariance_kernel(state.factor, 6, state.translation, scale, 1.0))

    @property
    def report(self) -> SolveReport:
        """How the last fit ended."""
        fit = self.state.fit
        steps = int(fit[FIT_STEPS])
        return SolveReport("converged_gradient", True, steps, steps, float(fit[FIT_START]), float(fit[FIT_END]))

    def shared(self, other: Joint) -> float:
        """Share of the pairs that two solutions have in common, of the smaller one's."""
        same = (self.state.match == other.state.match) & (self.state.match >= 0)
        return float(same.sum()) / min(self.count, other.count)

    def same_as(self, other: Joint) -> bool:
        """Mostly the same pairs, and poses that agree within three degrees or six sigma of the less certain one."""
        if self.shared(other) <= SAME_SHARE:
            return False
        if self.rig_from_model.angle_to(other.rig_from_model) < SAME_ANGLE:
            return True
        delta = (self.rig_from_model @ other.rig_from_model.inverse()).log()
        return bool(min(delta @ np.linalg.solve(s.cov, delta) for s in (self, other)) < SAME_DISTANCE2)


class Cameras:
    """Planes of C cameras (of the same markers, each with spots) and where these are in the rig."""

    def __init__(self, planes: Sequence[Plane], cam_from_rig: Sequence[Pose]) -> None:
        self.planes, self.cam_from_rig = tuple(planes), tuple(cam_from_rig)
        self.layout, self.markers = planes[0].layout, planes[0].markers
        self.focal = np.array([plane.fit.focal_start for plane in planes])
        spots = [plane.spots for plane in planes]
        self.rig = Rig(
            np.stack([pose.rotation for pose in cam_from_rig]),
            np.stack([pose.translation for pose in cam_from_rig]) / self.layout.frame.scale,
            np.cumsum([0, *(len(s.p) for s in spots)]),
            np.concatenate([s.p for s in spots]),
            np.concatenate([s.cov for s in spots]),
            np.concatenate([s.density for s in spots]),
            np.concatenate([s.by_x for s in spots]),
            np.concatenate([s.x for s in spots]),
            np.stack([s.camera for s in spots]),
            np.stack([s.size for s in spots]),
            np.array([s.radius for s in spots]),
            np.array([plane.fit.tolerance for plane in planes]),
        )

    def settle(self, rotation: Array, translation: Array, match: Ints) -> Joint | None:
        """Refine a pose of the unit model in the rig, with labels (C, N), to a fixed point; None where it falls apart.

        Also where it leaves the prior.
        """
        state = rig_state_of(rotation, translation, self.focal, match)
        if settle_rig_kernel(self.markers, self.rig, state) != STEADY:
            return None
        joint = Joint(self, *weigh_all(self.planes, state), state)
        if self.planes[0].task.prior is None:
            return joint
        views = zip(self.planes, joint.views, strict=True)
        return joint if all(p.task.allows(v.cam_from_model, v.focal_px) for p, v in views) else None

    def finish(self, joint: Joint) -> tuple[Joint, list[Array]]:
        """The solution as it is reported, and the eccentricity (K, 2) of the discs of each camera (see `final`)."""
        joint = self.accepted(joint, self.rig)
        off = [np.zeros((view.count, 2)) for view in joint.views]
        for _ in range(DISC_ROUNDS if are_discs(self.planes[0]).any() else 0):
            views = list(zip(self.planes, joint.views, strict=True))
            off = [eccentricity(plane, view) for plane, view in views]
            spots = [moved(plane, view, o).p for (plane, view), o in zip(views, off, strict=True)]
            joint = self.accepted(joint, self.rig._replace(p=np.concatenate(spots)))
        return joint, off

    def accepted(self, joint: Joint, rig: Rig) -> Joint:
        """The excess by the residuals alone, with the given places of the spots; the evidence as it was judged."""
        state = copy.deepcopy(joint.state)
        if not accept_rig_kernel(self.markers, rig, state):
            return joint
        return replace(joint, state=state)


def weigh_all(planes: Sequence[Plane], state: RigState) -> tuple[tuple[float, ...], Evidence]:
    """Evidence of each camera, and of all together (see `registration.evidence`).

    Likelihood ratios add up; each camera's is the best over prefixes of its list of spots. For the false-alarm number
    the spots of all cameras are one list, which counts the ways to fix a pose by three of them on the safe side.
    """
    scores, residuals, densities, spots, leads = [], [], [], 0, 0.0
    for c, plane in enumerate(planes):
        best, expected = -np.inf, int(state.numbers[c, EXPECTED])
        for lead in plane.leads:
            used = np.flatnonzero((state.match[c] >= 0) & (state.match[c] < lead))
            residual, density = state.residual[c, used], plane.picture(lead).density[state.match[c, used]]
            score = likelihood_ratio(residual, state.spread[c, used], density, expected)
            if score > best:
                best, kept = score, (residual, density, lead)
        scores.append(best - float(np.log(len(plane.leads))))
        residuals.append(kept[0])
        densities.append(kept[1])
        spots, leads = spots + kept[2], leads + float(np.log10(len(plane.leads)))
    nfa = log10_nfa(
        np.concatenate(residuals), np.concatenate(densities), int(state.numbers[:, EXPECTED].sum()),
        len(planes[0].task.markers), spots, 3, float(np.log(planes[0].task.prior_share)),
    )  # fmt: skip
    return tuple(scores), Evidence(sum(scores), nfa + leads)


def _one(state: RigState, c: int) -> State:
    """What one camera has of a state."""
    return State(
        state.rotations[c], state.translations[c], state.numbers[c], state.match[c],
        state.residual[c], state.spread[c], state.factors[c],
    )  # fmt: skip
