"""From a candidate to a solution: label, refine, label again, until nothing changes.

The search works with ideal pixels, some of the spots and one tolerance. Here the full camera model, all spots,
their covariances and those of the markers count. What neither explains (table errors, lens, bending) is
estimated as one more isotropic variance, the *excess*, so that gates, weights and covariances are as wide as
the data say.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.adjust import PoseEstimate, refine_pose
from windmark.geometry import Camera, DegenerateGeometry, Pose
from windmark.geometry.rotations import hat
from windmark.registration._growth_kernels import PRIOR_WORTH
from windmark.registration._hypothesis_kernels import GRAZING
from windmark.registration._plane import local_density, to_plane
from windmark.registration.evidence import Evidence, weigh
from windmark.registration.pool import Candidate
from windmark.registration.task import Task, with_focal

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

GATE = 13.8
"""Squared Mahalanobis distance of a match (99.9 % of right ones)."""
MAX_FOREIGN = 0.5
"""A marker whose gate holds more foreign spots than this, by the density of spots, is not matched."""
MIN_MATCHES = 4
OPEN_ROUNDS, ROUNDS = 8, 20
"""Rounds in which pairs may come and go; after them they may only go, so that no cycle remains."""
FINAL_ROUNDS = 3
TRIM = 0.8
TRIMMED_MEAN = (1 - (1 - TRIM) * (1 - np.log(1 - TRIM))) / TRIM
"""Mean of the smallest four fifths of an exponential variable, which squared lengths of residuals are."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A refined labelling with its evidence.

    Parameters
    ----------
    estimate : pose, camera, covariance, residuals
    detection, marker : (K,) the pairs
    expected : number of markers that should be seen
    excess_px : 1 sigma per coordinate of the misfit that the given covariances do not explain
    misfit_px : 1 sigma per coordinate of the residuals, by the redundancy
    evidence : how much it is worth
    """

    estimate: PoseEstimate
    detection: Ints
    marker: Ints
    expected: int
    excess_px: float
    misfit_px: float
    evidence: Evidence

    @property
    def cam_from_model(self) -> Pose:
        """The pose."""
        return self.estimate.cam_from_model

    @property
    def count(self) -> int:
        """Matched markers."""
        return len(self.marker)

    def same_as(self, other: Solution) -> bool:
        """Mostly the same pairs, and poses that agree within six sigma of the less certain one."""
        mine = dict(zip(self.marker.tolist(), self.detection.tolist(), strict=True))
        shared = sum(mine.get(m) == d for m, d in zip(other.marker.tolist(), other.detection.tolist(), strict=True))
        if shared <= 0.6 * min(self.count, other.count):
            return False
        delta = (self.cam_from_model @ other.cam_from_model.inverse()).log()
        return bool(min(delta @ np.linalg.solve(s.estimate.cov[:6, :6], delta) for s in (self, other)) < 36.0)


def settle(task: Task, candidate: Candidate) -> Solution | None:
    """Refine a candidate to a fixed point of labelling; None where it falls apart or leaves the prior."""
    camera = task.camera
    if task.free_focal:
        camera = with_focal(camera, candidate.focal_px)
    pose, excess2 = candidate.cam_from_model, (task.tolerance_px / 8) ** 2
    marker = np.flatnonzero(candidate.match >= 0)
    detection = candidate.match[marker].astype(np.int64)
    density = local_density(task.xy, camera)
    for round_ in range(ROUNDS):
        estimate = _refine(task, camera, pose, detection, marker, excess2)
        if estimate is None:
            return None
        camera, pose = estimate.camera, estimate.cam_from_model
        before, excess2 = excess2, _excess(task, estimate, detection, marker, (task.tolerance_px / 16) ** 2)
        look = _predict(task, estimate)
        held = dict(zip(marker.tolist(), detection.tolist(), strict=True))
        labels = _assign(task, look, excess2, density, held)
        if round_ >= OPEN_ROUNDS:
            keep = [held.get(m) == d for d, m in zip(labels[0].tolist(), labels[1].tolist(), strict=True)]
            labels = labels[0][keep], labels[1][keep]
        same = np.array_equal(labels[0], detection) and np.array_equal(labels[1], marker)
        # The estimate's weights were made with the excess of the round before.
        steady = abs(np.sqrt(excess2) - np.sqrt(before)) < 0.02 * np.sqrt(excess2 + _known(task, detection).mean())
        if same and steady:
            break
        detection, marker = labels
    else:
        return None
    if not task.allows(pose, camera.focal_px):
        return None
    expected = look.expected | np.isin(np.arange(len(task.markers)), marker)
    cov = task.cov[detection] + look.table[marker] + excess2 * np.eye(2)
    evidence = weigh(task, detection, estimate.residuals_px, cov, int(expected.sum()))
    redundancy = max(2 * len(marker) - len(estimate.names), 1)
    misfit = float(np.sqrt((estimate.residuals_px**2).sum() / redundancy))
    return Solution(estimate, detection, marker, int(expected.sum()), float(np.sqrt(excess2)), misfit, evidence)


@dataclass(frozen=True)
class _Look:
    """What a pose predicts: projections (N, 2), their covariance by the pose and by the marker table, who is seen."""

    xy: Array
    by_pose: Array  # (N, 2, 2)
    table: Array  # (N, 2, 2)
    possible: Mask
    expected: Mask


def _refine(
    task: Task, camera: Camera, pose: Pose, detection: Ints, marker: Ints, excess2: float
) -> PoseEstimate | None:
    """Least-squares pose of a labelling, or None where the pairs do not determine it."""
    xyz = task.markers.xyz[marker]
    if len(marker) < MIN_MATCHES or not camera.project(pose.apply(xyz))[1].all():
        return None
    table = _table(task, camera, pose)[marker]
    cov = task.cov[detection] + table + excess2 * np.eye(2)
    try:
        if task.free_focal:
            estimate = _refine_focal(task, camera.focal_px, pose, xyz, detection, cov)
        else:
            estimate = refine_pose(camera, pose, xyz, task.xy[detection], cov)
    except DegenerateGeometry:
        return None
    return estimate if np.isfinite(estimate.rms_px) else None


def _refine_focal(task: Task, focal_px: float, pose: Pose, xyz: Array, detection: Ints, cov: Array) -> PoseEstimate:
    """Pose and focal length, with the lens distortion held *in the image*.

    With k1 held instead, the distortion of the image would change with the focal length, and a focal length that
    the view does not determine would be read from the lens. So the fit is made in the search plane. The range of
    focal lengths is a prior (2 sigma), centred on the given one: without it the focal length of a frontal view of
    a flat model runs away; with it, it stays and its sigma tells.
    """
    start_focal = task.camera.focal_px
    depth = pose.apply(xyz)[:, 2]
    nearer = float(depth.mean()) * (start_focal / focal_px - 1)
    if depth.min() + nearer <= 0.1 * depth.min():
        # So strong a perspective fixes the focal length; where the prior is centred hardly matters.
        start_focal, nearer = focal_px, 0.0
    pinhole = Camera(task.camera.size_px, start_focal, cx=0.0, cy=0.0)
    start = Pose(pose.rotation, pose.translation + np.array([0.0, 0.0, nearer]))
    estimate = refine_pose(
        pinhole, start, xyz, to_plane(task.camera, task.xy[detection]), cov,
        free=("focal_px",), prior_sigma={"focal_px": 0.5 * float(np.log(task.focal_factors[-1])) * start_focal},
    )  # fmt: skip
    camera = with_focal(task.camera, estimate.camera.focal_px)
    residuals = camera.project(estimate.cam_from_model.apply(xyz))[0] - task.xy[detection]
    return replace(
        estimate,
        camera=replace(camera, cov=estimate.camera.cov),
        residuals_px=residuals,
        rms_px=float(np.sqrt((residuals**2).sum(axis=1).mean())),
    )


def _known(task: Task, detection: Ints) -> Array:
    """(K,) variance per coordinate of the given covariance of spots."""
    return 0.5 * np.trace(task.cov[detection], axis1=1, axis2=2)


def accepted(task: Task, solution: Solution) -> Solution:
    """The solution as it is reported: its excess by the residuals alone.

    While labels may still be wrong, the gates are kept a little open. Once they are accepted that doubt has
    no place in the covariance.
    """
    estimate, excess2 = solution.estimate, solution.excess_px**2
    for _ in range(FINAL_ROUNDS):
        excess2 = _excess(task, estimate, solution.detection, solution.marker, 0.0)
        again = _refine(task, estimate.camera, estimate.cam_from_model, solution.detection, solution.marker, excess2)
        if again is None:
            return solution
        estimate = again
    return replace(solution, estimate=estimate, excess_px=float(np.sqrt(excess2)))


def _excess(task: Task, estimate: PoseEstimate, detection: Ints, marker: Ints, doubt2: float) -> float:
    """Variance per coordinate beyond the given covariances.

    From the smaller four fifths of the squared residuals, so that one false spot in a gate does not open the
    gate for itself; a weak prior, the given covariances and ``doubt2`` beyond them, steadies few pairs.
    """
    table = _table(task, estimate.camera, estimate.cam_from_model)[marker]
    known = _known(task, detection).mean() + 0.5 * np.trace(table, axis1=1, axis2=2).mean()
    redundancy = max(2 * len(marker) - len(estimate.names), 0)
    squares = np.sort((estimate.residuals_px**2).sum(axis=1))[: int(np.ceil(TRIM * len(marker)))]
    variance = squares.mean() / (2 * TRIMMED_MEAN) * 2 * len(marker) / max(redundancy, 1)
    expected = known + doubt2
    pooled = (PRIOR_WORTH * expected + redundancy * variance) / (PRIOR_WORTH + redundancy)
    return max(0.0, float(pooled - known))


def _table(task: Task, camera: Camera, pose: Pose) -> Array:
    """(N, 2, 2) covariance of the projections by the markers' sigma, zero where that is unknown."""
    sigma = np.where(np.isfinite(task.markers.sigma), task.markers.sigma, 0.0)
    if not sigma.any():
        return np.zeros((len(sigma), 2, 2))
    _, _, d_xyz, _ = camera.project_jacobian(pose.apply(task.markers.xyz))
    scaled = (d_xyz @ pose.rotation) * sigma[:, None, :]
    return np.nan_to_num(scaled @ np.swapaxes(scaled, 1, 2))


def _predict(task: Task, estimate: PoseEstimate) -> _Look:
    """Where every marker should be seen, how well that is known, and whether it must or may be seen."""
    camera, pose, markers = estimate.camera, estimate.cam_from_model, task.markers
    points = pose.apply(markers.xyz)
    xy, valid, d_xyz, d_camera = camera.project_jacobian(points)
    jacobian = np.concatenate([d_xyz @ -hat(points), d_xyz, d_camera[..., :1]], axis=-1)[..., : len(estimate.names)]
    by_pose = jacobian @ estimate.cov @ np.swapaxes(jacobian, 1, 2)
    to_eye = pose.center - markers.xyz
    cosine = np.einsum("ij,ij->i", markers.normal, to_eye) / np.linalg.norm(to_eye, axis=1)
    cosine = np.where(np.isnan(cosine), 1.0, cosine)
    possible = valid & (cosine > 0)
    size = np.array(camera.size_px)
    # A marker at the very border may be cut.
    inside = valid & (xy > 2.0).all(axis=1) & (xy < size - 3.0).all(axis=1)
    known = np.trace(np.nan_to_num(by_pose), axis1=1, axis2=2) * GATE < 4 * task.tolerance_px**2
    return _Look(
        xy, np.nan_to_num(by_pose), _table(task, camera, pose), possible, possible & inside & known & (cosine > GRAZING)
    )


def _assign(task: Task, look: _Look, excess2: float, density: Array, held: dict[int, int]) -> tuple[Ints, Ints]:
    """Pairs (detections, markers, in order of markers): closest first, one to one, each within its gate.

    A spot that holds the pose already (``held``: marker -> spot) has pulled it, so its residual is *smaller* than
    its noise by the pose's covariance; for any other spot it is larger. Both tests are the same leave-one-out test.
    """
    markers = np.flatnonzero(look.possible)
    spread = look.by_pose[markers] + look.table[markers] + excess2 * np.eye(2)
    reach = np.sqrt(GATE * (np.trace(spread, axis1=1, axis2=2) + 2 * task.sigma_px.max() ** 2))
    near = cKDTree(task.xy).query_ball_point(look.xy[markers], np.minimum(reach, 3 * task.tolerance_px))
    row = np.repeat(np.arange(len(markers)), [len(n) for n in near])
    spot = np.array([j for n in near for j in n], dtype=np.int64)
    noise = look.table[markers[row]] + excess2 * np.eye(2) + task.cov[spot]
    mine = np.array([held.get(int(m)) == j for m, j in zip(markers[row], spot, strict=True)], dtype=bool)
    gate = np.where(mine[:, None, None], _less(noise, look.by_pose[markers[row]]), noise + look.by_pose[markers[row]])
    offset = task.xy[spot] - look.xy[markers[row]]
    distance2 = np.einsum("ki,ki->k", offset, np.linalg.solve(gate, offset[..., None])[..., 0])
    foreign = np.pi * GATE * np.sqrt(np.linalg.det(gate)) * density[spot]
    good = np.flatnonzero((distance2 < GATE) & (foreign < MAX_FOREIGN))
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for k in good[np.argsort(distance2[good], kind="stable")]:
        m, d = int(markers[row[k]]), int(spot[k])
        if m not in pairs and d not in taken:
            pairs[m] = d
            taken.add(d)
    chosen = np.array(sorted(pairs), dtype=np.int64)
    return np.array([pairs[m] for m in chosen.tolist()], dtype=np.int64), chosen


def _less(noise: Array, by_pose: Array) -> Array:
    """Covariance of fitted residuals, kept positive where a pair alone determines part of the pose."""
    value, vector = np.linalg.eigh(noise - by_pose)
    floor = 0.05 * np.trace(noise, axis1=1, axis2=2)[:, None]
    return (vector * np.maximum(value, floor)[:, None, :]) @ np.swapaxes(vector, 1, 2)
