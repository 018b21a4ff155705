"""Poses from the points themselves: one adjustment of all poses and points, the cameras as they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.levenberg_marquardt import SolveOptions
from windmark.adjust.network import Network, NetworkProblem, NetworkState, graduated
from windmark.adjust.network.covariance import network_covariance
from windmark.adjust.network.datum import in_datum
from windmark.errors import WindmarkError
from windmark.geometry import Camera, Pose, align
from windmark.geometry.rotations import hat
from windmark.scene import Observations

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEAST = 6
"""Points that a view needs for a new pose."""
STEPS = SolveOptions(max_iterations=15, gradient_tol=1e-2, initial_damping=1e-4)
FITS, MOST = 4.0, 0.6
"""A view has a new pose where more than this share of its residuals is within so many sigmas."""
STAGES, SHRINK = 8, 0.7
"""The robust scale follows the residuals so many times, or until it shrinks by less than this."""


@dataclass(frozen=True)
class Refined:
    """Poses (V,) and their covariances (V, 6, 6) among themselves; ``scale`` is that of the residuals, in sigmas."""

    poses: Pose
    pose_cov: Array
    scale: float
    moved: Mask


def refine_poses(
    cameras: tuple[Camera, ...], poses: Pose, pose_cov: Array, xyz: Array, observations: Observations
) -> Refined | None:
    """Adjust poses and points to the observations; None where these do not determine them.

    The frame is that in which the points, on the whole, do not move: the poses' common error stays, what they
    disagree in goes. Views with fewer than six points, or whose observations contradict the others, keep pose and
    covariance.
    """
    views = len(cameras)
    view, point = observations.view, observations.point
    enough = np.bincount(view, minlength=views) >= LEAST
    used = enough[view]
    seen = np.bincount(point[used], minlength=len(xyz))
    used &= seen[point] >= 2
    if enough.sum() < 2 or used.sum() < 3 * LEAST:
        return None
    network = Network(
        view[used], point[used], observations.xy[used], observations.cov[used], np.arange(views), np.arange(views),
        np.full(views, -1), ((),) * views, enough, np.zeros((len(xyz), 3), bool), eliminate="points",
    )  # fmt: skip
    state = NetworkState(cameras, poses, xyz)
    try:
        problem, state, scale = graduated(network, state, STEPS, stages=STAGES, settled=SHRINK, least=1.0)
        system = problem.linearise(state)
        assert system is not None
        covariance = in_datum(network_covariance(system, problem.layout))
        kept = np.bincount(point[used], minlength=len(xyz)) > 0
        fit = align(state.points[kept], xyz[kept])
    except (np.linalg.LinAlgError, WindmarkError):
        return None
    # Residuals are smaller than the noise by what the unknowns have taken up.
    free = 2 * used.sum() - 3 * kept.sum() - 6 * enough.sum() + 7
    larger = max(scale * float(np.sqrt(2 * used.sum() / max(free, 1))), 1.0)
    enough &= _fitting(problem, state, views, scale)
    dense, units = covariance.dense(), problem.units(state)
    out = pose_cov.copy()
    for v in np.flatnonzero(enough):
        index = problem.layout.columns.frame[v] + np.arange(6)
        change = np.eye(6)
        change[3:, :3], change[3:, 3:] = hat(units.frame_pivot[v]), units.frame_scale[v] * np.eye(3)
        out[v] = change @ dense[np.ix_(index, index)] @ change.T * larger**2
        out[v, 3:] *= fit.scale
        out[v, :, 3:] *= fit.scale
    moved = fit.moved(state.frames)
    rotation, translation = (
        np.where(enough.reshape(-1, *([1] * (new.ndim - 1))), new, old)
        for new, old in ((moved.rotation, poses.rotation), (moved.translation, poses.translation))
    )
    return Refined(Pose(rotation, translation), out, scale, enough)


def _fitting(problem: NetworkProblem, state: NetworkState, views: int, scale: float) -> Mask:
    """(V,) views most of whose observations agree with the others."""
    residual = problem.residual(state)
    assert residual is not None
    view = problem.network.view[problem.order]
    good = np.linalg.norm(residual, axis=1) < FITS * max(scale, 1.0)
    return np.asarray(np.bincount(view[good], minlength=views) > MOST * np.bincount(view, minlength=views))
