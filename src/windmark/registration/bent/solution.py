"""Deformed solutions: what they are worth, and when to look for them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve

from windmark.geometry import Camera
from windmark.registration._kernels.fit import (
    COST_END,
    COST_START,
    EXCESS,
    EXPECTED,
    ITERATIONS,
    MISFIT,
    Markers,
    Spots,
    State,
    state_of,
)
from windmark.registration.bent.fit import Bent, Setting
from windmark.registration.bent.grow import Grown, finish, grow
from windmark.registration.budget import BEND, BEND_PAIR, Budget
from windmark.registration.evidence import Evidence, weigh
from windmark.registration.result import Deformation
from windmark.registration.search.plane import Plane
from windmark.registration.search.pool import Candidate
from windmark.registration.solution import HIDING_ROUNDS, SAME_SHARE, Solution, without_hidden

Array = NDArray[np.float64]

PRIOR = 0.3
"""1 sigma of the prior of the displacement, as part of the largest one allowed."""
SHARE = 0.6
"""No more is grown once that has taken this part of the limit of work."""
CORE_ANGLE = float(np.radians(10.0))
"""A candidate within this angle of a solution that has most of its pairs is a core of it."""
LOOSE = 1.5
"""Residuals this many sigma above what the covariances say are a sign of a deformation; ..."""
NEAR_BY_CHANCE, MORE = np.array([0.15, 0.03, 0.006]), 2.0
"""... so is a number of missing markers with a free spot near, this many sigma above chance; near is where the chance
of a foreign spot is one of these, and not beyond the largest deformation."""


@dataclass(frozen=True, eq=False)
class BentSolution(Solution):
    """A solution with a deformation.

    ``state`` holds the pose alone, with the covariance that it has while the deformation is unknown.

    Parameters
    ----------
    grown, setting : labels, deformation and normal equations; what they were made with
    """

    grown: Grown
    setting: Setting

    @property
    def parameters(self) -> float:
        """Parameters that the pairs determine: of the pose, and of the deformation as far as not the prior does."""
        return super().parameters + self.modes_seen

    @property
    def modes_seen(self) -> float:
        """How many parameters of the deformation the pairs determine."""
        return float(len(self.grown.bent.q) - np.trace(self._cov_q))

    def unit_xyz(self, plane: Plane) -> Array:
        """(N, 3) markers of the unit model, displaced."""
        return plane.model.xyz + self.unit_displacement

    @property
    def unit_displacement(self) -> Array:
        """(N, 3) displacement of all markers of the unit model."""
        return np.tensordot(self.grown.bent.q, self.setting.modes, 1)

    @property
    def _cov_q(self) -> Array:
        size, factor = self.setting.pose_size, self.grown.bent.factor
        return np.asarray(cho_solve((factor, True), np.eye(len(factor))[:, size:])[size:])

    def deformation(self, plane: Plane, camera: Camera) -> Deformation:
        """The deformation in the model's own units and in the picture."""
        scale, modes = plane.frame.scale, self.setting.modes
        displacement = scale * self.unit_displacement
        variance = np.einsum("knc,kj,jnc->nc", modes, self._cov_q, modes, optimize=True)
        xyz, pose = plane.task.markers.xyz, self.cam_from_model
        shift = camera.project(pose.apply(xyz + displacement))[0] - camera.project(pose.apply(xyz))[0]
        size = scale * plane.layout.size
        largest = float(np.linalg.norm(displacement[self.marker], axis=1).max()) / size
        return Deformation(displacement, scale * np.sqrt(variance), shift, largest, self.modes_seen)


class Bender:
    """Looks for deformed solutions of one task.

    Parameters
    ----------
    plane : the task
    max_deformation : largest displacement of a marker, as part of the model's size; > 0
    budget : work of the whole registration
    """

    def __init__(self, plane: Plane, max_deformation: float, budget: Budget) -> None:
        self._plane, self._most, self._budget = plane, max_deformation, budget
        self._setting: Setting | None = None
        self._spent = 0.0
        self._settled: dict[Candidate, BentSolution | None] = {}

    def solutions(self, candidates: list[Candidate], *, in_a_hurry: bool = True) -> list[BentSolution]:
        """Distinct deformed solutions, best first; a core of one that is known already is not grown again.

        ``in_a_hurry`` no more than `SHARE` of the work is done, and some candidates may be left.
        """
        found: list[BentSolution] = []
        share = SHARE if in_a_hurry else 1.0
        for candidate in candidates:
            if any(_core_of(candidate, known) for known in found):
                continue
            if candidate not in self._settled:
                if self._budget.over or self._spent > share * self._budget.max_work:
                    break
                work = BEND + BEND_PAIR * candidate.count
                self._spent += work
                self._budget.spend(work)
                self._settled[candidate] = self._settle(candidate)
            solution = self._settled[candidate]
            if solution is not None:
                found.append(solution)
        return sorted(found, key=lambda s: -s.evidence.score)

    def all_tried(self, candidates: list[Candidate]) -> bool:
        """Whether no candidate was left for want of time."""
        known = [s for s in self._settled.values() if s is not None]
        return all(c in self._settled or any(_core_of(c, solution) for solution in known) for c in candidates)

    def _settle(self, candidate: Candidate) -> BentSolution | None:
        """Grow a candidate; None where it falls apart, leaves the prior or a fixed label."""
        plane, task, setting = self._plane, self._plane.task, self._prepared()
        rotation, translation = plane.frame.unit(candidate.cam_from_model)
        q, nothing = np.zeros(len(setting.modes)), np.zeros((0, 0))
        bent, match = Bent(rotation, translation, candidate.focal_px, q, nothing), candidate.match
        hidden = task.hidden(candidate.cam_from_model, candidate.focal_px)
        solution: BentSolution | None = None
        for _ in range(HIDING_ROUNDS):
            markers = without_hidden(plane, hidden, bent.rotation, bent.translation)
            grown = grow(plane, markers, setting, bent, np.where(hidden, -1, match).astype(np.int32))
            if grown is None or not task.keeps(grown.match):
                return None
            solution, match, before = _solution(plane, markers, setting, grown), grown.match, hidden
            hidden = task.hidden(solution.cam_from_model, solution.focal_px)
            if (hidden == before).all():
                break
        kept = solution is not None and task.allows(solution.cam_from_model, solution.focal_px)
        return solution if kept else None

    def largest(self, solution: BentSolution) -> float:
        """Largest displacement of a labelled marker, as part of the model's size."""
        moved = np.linalg.norm(solution.unit_displacement[solution.marker], axis=1)
        return float(moved.max()) / self._plane.layout.size

    def signs(self, solution: Solution) -> bool:
        """Whether a rigid solution leaves so much unexplained that the model may be deformed."""
        # Of markers without a spot it is zero.
        noise = solution.state.spread[:, ::2].sum() / (2 * solution.count) - solution.excess_px**2
        freedom = max(2 * solution.count - solution.size, 1)
        if solution.misfit_px**2 > noise * (1 + LOOSE * (2 / freedom) ** 0.5):
            return True
        return solution.count < solution.expected and self._spots_near_missing(solution)

    def _spots_near_missing(self, solution: Solution) -> bool:
        """Whether more of the missing markers than by chance have a free spot near."""
        plane, state = self._plane, solution.state
        free = np.delete(plane.spots.p, solution.detection, axis=0)
        missing = np.flatnonzero(state.match < 0)
        xyz, normal = plane.model.xyz[missing], solution.markers.normal[missing]
        facing = (normal * (-state.rotation.T @ state.translation - xyz)).sum(axis=1)
        seen = xyz @ state.rotation.T + state.translation
        # A normal that is not known is zero.
        seen = seen[(facing > 0) | ~normal.any(axis=1)]
        uv = solution.focal_px * seen[:, :2] / seen[:, 2:]
        if not len(free) or not len(uv):
            return False
        density = len(free) / float(np.prod(plane.task.camera.size_px))
        widest = self._most * plane.layout.size * solution.focal_px / float(state.translation[2])
        reach2 = np.minimum(widest**2, NEAR_BY_CHANCE / (np.pi * density))
        u, v = free[:, 0] - uv[:, :1], free[:, 1] - uv[:, 1:]
        nearest2 = (u * u + v * v).min(axis=1)
        near, expected = (nearest2[:, None] < reach2).sum(axis=0), len(uv) * np.pi * reach2 * density
        return bool((near > 1 + expected + MORE * np.sqrt(expected)).any())

    def _prepared(self) -> Setting:
        if self._setting is None:
            plane, layout = self._plane, self._plane.layout
            modes = PRIOR * self._most * layout.size * layout.modes
            self._setting = Setting(
                plane.model.xyz, plane.markers.sigma, modes, plane.fit.focal_start, plane.fit.focal_weight
            )
        return self._setting


def _core_of(candidate: Candidate, known: BentSolution) -> bool:
    """Whether a candidate has mostly the pairs and nearly the pose of a deformed solution."""
    shared = (candidate.match == known.state.match) & (candidate.match >= 0)
    alike = candidate.cam_from_model.angle_to(known.cam_from_model) < CORE_ANGLE
    return bool(alike and shared.sum() > SAME_SHARE * candidate.count)


def accepted_bent(plane: Plane, solution: BentSolution, spots: Spots) -> BentSolution:
    """The solution as it is reported, see `registration.solution.accepted`."""
    final = _solution(plane, solution.markers, solution.setting, finish(spots, solution.setting, solution.grown))
    return replace(final, evidence=solution.evidence, misfit_px=solution.misfit_px)


def _solution(plane: Plane, markers: Markers, setting: Setting, grown: Grown) -> BentSolution:
    bent, marker = grown.bent, np.flatnonzero(grown.match >= 0)
    state = _state(setting, grown, marker)
    detection = grown.match[marker].astype(np.int64)
    evidence = weigh(plane, detection, grown.residual, grown.spread, grown.expected)
    cells = _cells(setting, bent)
    # Of the deformation as in a Laplace approximation of its marginal likelihood; chance may try every one that this
    # view tells from the others.
    evidence = Evidence(evidence.score - 0.5 * float(bent.q @ bent.q) - cells, evidence.log10_nfa + cells / np.log(10))
    return BentSolution(
        cam_from_model=plane.frame.pose(bent.rotation, bent.translation),
        focal_px=bent.focal,
        detection=detection,
        marker=marker,
        expected=grown.expected,
        excess_px=float(np.sqrt(grown.excess)),
        misfit_px=float(np.sqrt(grown.misfit)),
        evidence=evidence,
        markers=markers,
        state=state,
        frame=plane.frame,
        size=setting.pose_size,
        grown=grown,
        setting=setting,
    )


def _cells(setting: Setting, bent: Bent) -> float:
    """Logarithm of how many deformations within the prior this view tells apart (the Occam factor)."""
    size = setting.pose_size
    normal = bent.factor[:size] @ bent.factor[:size].T
    return float(np.log(np.diag(bent.factor)).sum() - 0.5 * np.linalg.slogdet(normal)[1])


def _state(setting: Setting, grown: Grown, marker: NDArray[np.int64]) -> State:
    bent, size = grown.bent, setting.pose_size
    state = state_of(bent.rotation, bent.translation, bent.focal, grown.match)
    state.numbers[[EXCESS, MISFIT, EXPECTED]] = grown.excess, grown.misfit, grown.expected
    state.numbers[[ITERATIONS, COST_START, COST_END]] = bent.steps, bent.cost_start, bent.cost
    state.residual[marker], state.spread[marker] = grown.residual, grown.spread
    cov = cho_solve((bent.factor, True), np.eye(len(bent.factor))[:, :size])[:size]
    state.factor[:size, :size] = np.linalg.cholesky(np.linalg.inv(cov))
    return state
