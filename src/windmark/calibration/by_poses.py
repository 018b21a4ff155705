"""A free network in the frame of given poses, with the covariances that its markers and pictures have there.

The frame is the similarity that takes the network's pictures to the given poses, by least squares with the covariance
of the pictures in the network. A datum is the same thing: a condition on parameters, here on those of the poses
(S-transformation, Baarda 1973; `adjust.network.datum`). What the pictures leave open of their own poses, the relative
one of two above all, is then in the coordinates: turned, shifted, and larger or smaller.

The given poses are more than a frame needs. What is left over says whether the pictures agree with them, and where
they do not, how far each is off: one variance, found so that the sum of squares is as it should be (Mandel and Paule
1970), of which the frame has its part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from windmark.adjust.network.datum import DatumCovariance
from windmark.calibration.agreement import chance
from windmark.calibration.datum import Free
from windmark.calibration.finish import pose_covs, tangent
from windmark.calibration.result import Calibration
from windmark.calibration.setup import Job, frames_of
from windmark.calibration.solve import Solved
from windmark.calibration.transform import in_datum, job_of, linearised
from windmark.geometry import Pose
from windmark.geometry.similarity import Similarity, align

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

STEPS = 4
"""The similarity is not linear; from poses that are degrees off this is enough."""


@dataclass(frozen=True)
class ByPoses:
    """A network in the frame of given poses.

    Parameters
    ----------
    calibration : the network there, with the covariances there
    fit : takes the network as it was there
    sigma : 1 sigma of each given pose beyond what the pictures leave open, as an angle and as part of the distance to
        the markers; 0 where they fit
    fits : whether the given poses are what the pictures allow, but for chance
    """

    calibration: Calibration
    fit: Similarity
    sigma: float
    fits: bool


def by_poses(result: Calibration, given: Mapping[str, Pose]) -> ByPoses:
    """Put a free network into the frame of given poses.

    Parameters
    ----------
    result : of a free network, near that frame (some degrees, and sizes alike)
    given : cam_from_model by the names of views, two at least
    """
    job = job_of(result, Free(), None)
    solved = linearised(result, job)
    views = np.array([v for v, view in enumerate(result.views) if view.name in given], dtype=np.int64)
    rows, motions = _rows(solved, frames_of(job)[1][views]), solved.covariance.motions
    g = motions[rows]
    unit = np.zeros((len(motions), len(rows)))
    unit[rows, np.arange(len(rows))] = 1.0
    cov = solved.covariance.product(unit)[rows] * solved.scale
    fit, sigma, own = Similarity(1.0, np.eye(3), np.zeros(3)), 0.0, _pose_errors(solved, views)
    for _ in range(STEPS):
        off = _off(result, solved, views, given, fit)
        sigma, total = _sigma(cov, own, g, off)
        weight = _weight(cov + sigma**2 * own @ own.T, g)
        step = motions @ np.linalg.solve(g.T @ weight @ g, g.T @ weight @ off)
        moved = result.markers.xyz + _of_points(solved, step[:, None])[..., 0]
        fit = fit @ align(result.markers.xyz, moved, scale=motions.shape[1] == 7)
    condition = np.zeros_like(motions)
    condition[rows] = weight @ g
    change, product = motions @ np.linalg.inv(condition.T @ motions), solved.covariance.product(condition)
    covariance = DatumCovariance(solved.covariance, change, product, condition.T @ product)
    # What errors of the given poses do to the frame.
    per_pose = sigma * change @ condition[rows].T @ own
    points = _of_points(solved, per_pose)
    marker_cov = fit.scale**2 * (covariance.points() * solved.scale + points @ points.transpose(0, 2, 1))
    marker_cov = fit.rotation @ marker_cov @ fit.rotation.T
    spread = np.sqrt(np.maximum(np.diagonal(marker_cov, axis1=1, axis2=2), 0.0))
    out = in_datum(result, Free(), replace(result.markers, xyz=fit.apply(result.markers.xyz)))
    out = replace(
        out, marker_cov=marker_cov, markers=replace(out.markers, sigma=spread),
        pose_cov=_of_poses(solved, covariance, per_pose, frames_of(job)[1], job, fit.scale),
    )  # fmt: skip
    return ByPoses(out, fit, sigma, chance(total, len(rows) - g.shape[1]))


def _rows(solved: Solved, frames: Ints) -> Ints:
    """(6 V,) numbers of the parameters of some frames."""
    lay = solved.problem.layout
    columns = lay.columns
    start = np.where(columns.frame[frames] >= 0, columns.frame[frames], lay.dense + 6 * columns.frame_block[frames])
    return np.asarray((start[:, None] + np.arange(6)).ravel())


def _of_points(solved: Solved, values: Array) -> Array:
    """(N, 3, k) what natural parameters (P, k) have of the points, in the length unit."""
    lay = solved.problem.layout
    columns = lay.columns
    start = np.where(columns.point >= 0, columns.point, lay.dense + 3 * columns.point_block)
    return np.asarray(values[start[:, None] + np.arange(3)] * lay.unit)


def _off(result: Calibration, solved: Solved, views: Ints, given: Mapping[str, Pose], fit: Similarity) -> Array:
    """(6 V,) natural steps from the network's poses to the given ones, taken to the network by the inverse of a fit."""
    units, back, out = solved.problem.units(solved.state), fit.inverse(), []
    for v in views.tolist():
        pose = result.views[v].cam_from_model
        assert pose is not None
        away = (back.moved(given[result.views[v].name]) @ pose.inverse()).log()
        out.append(np.linalg.solve(tangent(units.frame_pivot[v], units.frame_scale[v]), away))
    return np.concatenate(out)


def _pose_errors(solved: Solved, views: Ints) -> Array:
    """(6 V, 6 V) natural steps of errors of given poses: a camera turned where it stands, or elsewhere by such a part
    of its distance.

    Of cameras that are only turned the stations keep the scale.
    """
    units, out = solved.problem.units(solved.state), np.zeros((len(views), 6, len(views), 6))
    for k, v in enumerate(views.tolist()):
        far = float(np.linalg.norm(units.frame_pivot[v]))
        change = tangent(units.frame_pivot[v], units.frame_scale[v])
        out[k, :, k] = np.linalg.inv(change) @ np.diag([1.0, 1.0, 1.0, far, far, far])
    return out.reshape(6 * len(views), -1)


def _weight(cov: Array, g: Array) -> Array:
    """(6 V, 6 V) weights; the free motions, which are in no covariance, count as known to nothing."""
    # How much of them is added changes neither the fit nor what is left over.
    return np.asarray(np.linalg.inv(cov + np.trace(cov) / np.trace(g @ g.T) * (g @ g.T)))


def _sigma(cov: Array, own: Array, g: Array, off: Array) -> tuple[float, float]:
    """The given poses' own sigma, and the sum of squares without one."""

    def total(log_sigma: float) -> float:
        weight = _weight(cov + np.exp(2 * log_sigma) * own @ own.T, g)
        seen = g.T @ weight @ off
        return float(off @ weight @ off - seen @ np.linalg.solve(g.T @ weight @ g, seen))

    free, least, most = len(off) - g.shape[1], np.log(1e-9), np.log(10.0)
    without = total(least)
    if without <= free:
        return 0.0, without
    return float(np.exp(brentq(lambda x: total(x) - free, least, most, xtol=1e-3))), without


def _of_poses(
    solved: Solved, covariance: DatumCovariance, per_pose: Array, frames: Ints, job: Job, scale: float
) -> Array:
    """(V, 6, 6) covariances of all poses there."""
    cov = pose_covs(job, solved, covariance, np.arange(len(frames)), frames) * solved.scale
    units = solved.problem.units(solved.state)
    change = tangent(units.frame_pivot[frames], units.frame_scale[frames])
    more = change @ per_pose[_rows(solved, frames)].reshape(len(frames), 6, -1)
    length = np.diag([1.0, 1.0, 1.0, scale, scale, scale])
    return np.asarray(length @ (cov + more @ more.transpose(0, 2, 1)) @ length)
