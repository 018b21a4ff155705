"""A settled explanation of the spots: labels, pose, cameras and deformation that agree, and what they are worth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.geometry._cholesky_kernels import inverse_factor
from windmark.registration import rules
from windmark.registration._kernels.evidence import log10_nfa
from windmark.registration.cached import cached_property
from windmark.registration.settle._kernels import state as at
from windmark.registration.settle._kernels.state import State
from windmark.registration.settle._kernels.worth import smooth_kernel, worth_kernel
from windmark.registration.settle.common import goes_on, of_both
from windmark.registration.settle.views import Views

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

SAME_ANGLE, SAME_DISTANCE2 = float(np.radians(3.0)), 36.0
"""Two solutions with mostly the same pairs are one if the poses agree in angle or in so many sigma."""
SCALES = math.log(100.0)
"""Logarithm of the range of distances that a model may be at: a factor of ten either way."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A settled explanation.

    Parameters
    ----------
    views : what it explains, and with how much freedom
    state : the kernels' view of it
    """

    views: Views
    state: State

    # --- unknowns ------------------------------------------------------------------------
    @cached_property
    def rig_from_model(self) -> Pose:
        """The pose in the rig; for a single camera that of the camera."""
        return self.views.layout.frame.pose(self.state.rotation, self.state.translation)

    def cam_from_model(self, c: int = 0) -> Pose:
        """The pose as camera c sees it."""
        return self._poses[c]

    @cached_property
    def _poses(self) -> list[Pose]:
        frame, state = self.views.layout.frame, self.state
        return [frame.pose(r, t) for r, t in zip(state.rotations, state.translations, strict=True)]

    def camera(self, c: int = 0) -> Camera:
        """Camera c as it has it."""
        return self.views.camera(c, self.state.camera[c])

    @cached_property
    def inverse(self) -> Array:
        """(P, P) inverse of the lower Cholesky factor of the normal equations."""
        return inverse_factor(self.state.factor, len(self.state.factor))

    @cached_property
    def unit_cov(self) -> Array:
        """(P, P) covariance of all unknowns: pose of the unit model, nuisances, coefficients."""
        return np.asarray(self.inverse.T @ self.inverse)

    @cached_property
    def cov(self) -> Array:
        """(6, 6) of [rotation, translation] for ``exp(delta) @ rig_from_model``, model errors as random ones."""
        change = self.to_model()
        return np.asarray(change @ self.unit_cov[:6, :6] @ change.T)

    def to_model(self) -> Array:
        """(6, 6) from the unit model, turned about its centre, to the model and ``exp(delta) @ pose``."""
        return self.views.layout.frame.change(self.state.translation)

    @cached_property
    def displacement(self) -> Array:
        """(N, 3) of all markers of the unit model."""
        return np.tensordot(self.state.bent, self.views.modes, 1)

    @cached_property
    def largest(self) -> float:
        """Largest displacement of a labelled marker beyond a rigid motion of all, as part of the model's size."""
        seen = np.flatnonzero((self.state.match >= 0).any(axis=0))
        rest = beyond_rigid(self.views.layout.model.xyz[seen], self.displacement[seen])
        return float(np.linalg.norm(rest, axis=1).max()) / self.views.layout.size

    @property
    def is_bent(self) -> bool:
        """Whether the model may be deformed in it."""
        return len(self.state.bent) > 0

    # --- labels --------------------------------------------------------------------------
    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """(C,) matched markers of each camera."""
        return np.asarray((self.state.match >= 0).sum(axis=1))

    @cached_property
    def seeing(self) -> list[int]:
        """Cameras that have pairs."""
        return [c for c, count in enumerate(self.counts.tolist()) if count]

    @cached_property
    def count(self) -> int:
        """Pairs of all cameras."""
        return int(self.counts.sum())

    @cached_property
    def expected(self) -> int:
        """Markers that should be seen, over all cameras."""
        return int(self.state.numbers[:, at.EXPECTED].sum())

    def pairs(self, c: int = 0) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Spots and markers (K,) of camera c, in order of markers."""
        return self._pairs[c]

    @cached_property
    def _pairs(self) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        markers = [np.flatnonzero(match >= 0) for match in self.state.match]
        return [(match[m].astype(np.int64), m) for match, m in zip(self.state.match, markers, strict=True)]

    @property
    def keeps_labels(self) -> bool:
        """Whether it has the fixed labels of all cameras."""
        pairs = zip(self.views.planes, self.state.match, strict=True)
        return all(plane.task.keeps(match) for plane, match in pairs)

    @cached_property
    def openness(self) -> list[tuple[int, float, int, float]]:
        """Of each camera, which markers' places the pairs leave most open, see `State.open`."""
        return opened_in(self.state)

    @cached_property
    def excess_px(self) -> Array:
        """(C,) 1 sigma per coordinate of the misfit that the given covariances do not explain."""
        return np.asarray(np.sqrt(self.state.numbers[:, at.EXCESS]))

    @cached_property
    def misfit_px(self) -> Array:
        """(C,) 1 sigma per coordinate of the residuals, by the redundancy."""
        return np.asarray(np.sqrt(self.state.numbers[:, at.MISFIT]))

    def shared(self, other: Solution) -> float:
        """Share of the pairs that two solutions have in common, of the smaller one's."""
        same = (self.state.match == other.state.match) & (self.state.match >= 0)
        return float(same.sum()) / min(self.count, other.count)

    def same_as(self, other: Solution) -> bool:
        """Mostly the same pairs, and poses that agree within three degrees or six sigma of the less certain one."""
        if other is self:
            return True
        if self.shared(other) <= rules.SAME_SHARE:
            return False
        if self.rig_from_model.angle_to(other.rig_from_model) < SAME_ANGLE:
            return True
        delta = (self.rig_from_model @ other.rig_from_model.inverse()).log()
        return bool(min(delta @ np.linalg.solve(s.cov, delta) for s in (self, other)) < SAME_DISTANCE2)

    # --- worth ---------------------------------------------------------------------------
    @cached_property
    def readings(self) -> Array:
        """(C, READINGS) what each camera's labels are worth, see `State.readings`."""
        readings = self.weighed
        smooth_kernel(self.views.sights, self.state)
        return readings

    @property
    def weighed(self) -> Array:
        """The same, without what a smooth misfit explains better (NaN), which only leads ask for."""
        if math.isnan(self.state.readings[0, at.PAIRS]):
            worth_kernel(self.views.sights, self.state)
        return self.state.readings

    @cached_property
    def freedom(self) -> float:
        """What the unknowns' freedom costs (nats, negative): the volume that the spots leave of the prior's.

        Laplace's approximation: rotations, places in the first image that has pairs and distances within
        a factor of ten either way are alike before the picture; nuisances and coefficients have their normal priors.
        Place and distance are those of the markers that are seen: the middle of a large board may be behind the camera.
        """
        state, c = self.state, int(self.counts.argmax())
        task = self.views.planes[c].task
        volume = 3 * math.log(2 * math.pi) - sum(map(math.log, state.factor.diagonal().tolist()))
        middle = self.views.layout.model.xyz[self.pairs(c)[1]].mean(axis=0)
        depth = max(float(state.rotations[c, 2] @ middle + state.translations[c, 2]), 1e-9)
        volume += 2 * math.log(state.camera[c, 0] / depth) - math.log(depth)
        prior = math.log(8 * math.pi**2 * math.prod(task.camera.size_px) * SCALES * task.prior_share)
        return volume - prior - self._strain

    @property
    def _strain(self) -> float:
        """What the priors of nuisances and coefficients have against their values (nats)."""
        nuisance, bent = self.state.nuisance, self.state.bent
        return 0.5 * float((nuisance**2).sum() + (bent**2).sum()) if nuisance.size or bent.size else 0.0

    @property
    def fit(self) -> float:
        """Nats against chance without the price of the freedom, which more freedom can only raise."""
        return self.score - self._strain

    @cached_property
    def scores(self) -> Array:
        """(C,) log-likelihood ratio of each camera in nats: matched spots against chance, missing markers against it.

        Markers are missing each by itself, or hidden in one piece, whichever is likelier.
        """
        pairs = zip(self.weighed.tolist(), self.counts.tolist(), strict=True)
        return np.array([r[at.PAIRS] + max(r[at.ALONE], r[at.PIECES]) if count else 0.0 for r, count in pairs])

    @cached_property
    def score(self) -> float:
        """Log-likelihood ratio in nats of all cameras, against "the spots are where they are by chance"."""
        return float(self.scores.sum())

    @cached_property
    def evidence(self) -> float:
        """Nats against chance, the price of the unknowns' freedom included: what explanations compete by."""
        return self.score + self.freedom

    @cached_property
    def log10_nfa(self) -> float:
        """Decimal logarithm of the false-alarm number: how many labellings this good chance would give.

        The spots of all cameras are one list, which counts the ways to fix a pose by three of them on the safe side.
        """
        if len(self.counts) == 1:
            return float(self.weighed[0, at.LOG10_NFA])
        residuals, densities, spots, leads, fixed = [], [], 0, 0.0, 3
        for c, plane in enumerate(self.views.planes):
            fixed += int(plane.task.free_focal)
            if not np.isfinite(self.weighed[c, at.LEAD]):
                spots += len(plane.task.xy)
                continue
            k = int(self.weighed[c, at.LEAD])
            lead = int(self.views.leads[c][k])
            spot, marker = self.pairs(c)
            used = spot < lead
            residuals.append(self.state.residual[c, marker[used]])
            densities.append(self.views.densities[c][k, spot[used]])
            spots, leads = spots + lead, leads + float(np.log10(len(self.views.leads[c])))
        if not residuals:
            return np.inf
        task = self.views.planes[0].task
        share = float(np.log(task.prior_share)) + sum(
            plane.task.log_label_share(len(plane.task.xy), 3) for plane in self.views.planes
        )
        return leads + float(log10_nfa(
            np.concatenate(residuals), np.concatenate(densities), self.expected, len(task.markers), spots, fixed, share
        ))  # fmt: skip

    def lead_over(self, other: Solution) -> float:
        """How much (nats) more it explains than another solution, in the reading that is worst for it.

        No lead is one that comes from an image border that hides what would be missing, from random errors where
        smooth ones of lens or table would do, or from the edge of the table where the picture goes on beyond it.
        """
        return min(self.leads_over(other))

    def leads_over(self, other: Solution) -> tuple[float, float]:
        """`lead_over` by all spots, and by those that both explain where only these count (infinite elsewhere)."""
        pairs = self._of(at.PAIRS) - other._of(at.PAIRS)
        alone, closed = (self._hiding(r) - other._hiding(r) for r in (at.ALONE, at.CLOSED))
        smooth = self._of(at.SYSTEMATIC) - other._of(at.SYSTEMATIC)
        leads = [float(np.sum(pairs + hiding + s)) for hiding in (alone, closed) for s in (0.0 * smooth, smooth)]
        where = [c for c in range(len(self.counts)) if goes_on(self, other, c)]
        common = self.lead_by_common(other, where) if where else math.inf
        return min(leads) + self.freedom - other.freedom, common

    def lead_by_common(self, other: Solution, cameras: Sequence[int]) -> float:
        """The lead (nats) by the spots of some cameras that both solutions explain, in the reading that is worst."""
        smooth = float((self._of(at.SYSTEMATIC) - other._of(at.SYSTEMATIC)).sum())
        common = sum(of_both(self, other, c) for c in cameras)
        return common + min(smooth, 0.0) + self.freedom - other.freedom

    def lead_by_missing(self, other: Solution) -> float:
        """The lead (nats) by the markers in view that have no spot."""
        return float((self._hiding(at.ALONE) - other._hiding(at.ALONE)).sum())

    def _hiding(self, reading: int) -> Array:
        return np.maximum(self._of(reading), self._of(at.PIECES))

    def _of(self, reading: int) -> Array:
        return np.where(self.counts > 0, self.readings[:, reading], 0.0)


def opened_in(state: State) -> list[tuple[int, float, int, float]]:
    """`State.open` of each camera."""
    return [(int(rest), rest_px, int(pair), pair_px) for rest, rest_px, pair, pair_px in state.open.tolist()]


def beyond_rigid(xyz: Array, moved: Array) -> Array:
    """Displacements (..., K, 3) of markers (K, 3) without the rigid motion of all that is nearest to them."""
    rigid, (x, y, z) = np.zeros((len(xyz), 3, 6)), (xyz - xyz.mean(axis=0)).T
    rigid[:, :, 3:] = np.eye(3)
    rigid[:, 1, 0], rigid[:, 2, 0], rigid[:, 0, 1], rigid[:, 2, 1], rigid[:, 0, 2], rigid[:, 1, 2] = -z, y, z, -x, -y, x
    # A line has no motion about itself, so not all six need be independent.
    basis, size, _ = np.linalg.svd(rigid.reshape(-1, 6), full_matrices=False)
    basis = basis[:, size > 1e-9 * size[0]]
    flat = moved.reshape(-1, len(basis))
    return np.asarray((flat - flat @ basis @ basis.T).reshape(moved.shape))
