"""Refinement of two-view geometry: the smallest sum of squared Sampson errors in units of their sigma.

The Sampson error of a pair is ``e / sqrt(g^T C g)`` with e = x_b^T M x_a, g its derivative by the four coordinates and
C their covariance: to first order the reprojection error with the point eliminated, so that the estimate reaches the
Cramer-Rao bound and the inverse normal matrix is its covariance. Source: Hartley and Zisserman, Multiple View Geometry
(2nd ed.), section 11.4.3; Ma, Kosecka and Sastry, Optimization criteria and geometric algorithms for motion and
structure estimation, IJCV 2001 (five parameters: rotation and direction of the baseline).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.camera import Camera
from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.pose import Pose
from windmark.geometry.rotations import exp_so3, hat
from windmark.geometry.two_view.pairs import Pairs, homogeneous_pairs, pairs_of_pixels

Array = NDArray[np.float64]
State = TypeVar("State")

STEPS = 30
_SMALL_GAIN = 1e-8  # of the cost in sigma^2: the step is far below the uncertainty
_SINGULAR = 1e-13  # ratio of eigenvalues of the (scaled) normal matrix


@dataclass(frozen=True)
class RelativePose:
    """Result of `refine_essential` and `relative_pose_refine`.

    Parameters
    ----------
    b_from_a : pose with a baseline of length 1
    cov : (6, 6) covariance of ``delta`` in ``exp(delta) @ b_from_a``, rank 5: nothing along the baseline
    cost : sum of the squared Sampson errors in units of their sigma; chi-square with N - 5 degrees of freedom if the
        covariances are right
    distance : (N,) signed Sampson errors in units of their sigma; NaN for pairs that were not used
    """

    b_from_a: Pose
    cov: Array
    cost: float
    distance: Array


def sampson_errors(matrix: Array, pairs: Pairs) -> Array:
    """Signed Sampson errors (..., N) in units of their sigma, for matrices (..., 3, 3)."""
    line_b, line_a = matrix @ pairs.a.T, np.swapaxes(matrix, -1, -2) @ pairs.b.T  # (..., 3, N)
    e = line_b[..., 0, :] * pairs.b[:, 0] + line_b[..., 1, :] * pairs.b[:, 1] + line_b[..., 2, :] * pairs.b[:, 2]
    variance = _variance(line_a, pairs.cov_a) + _variance(line_b, pairs.cov_b)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(e / np.sqrt(variance))


def _variance(line: Array, cov: Array) -> Array:
    x, y = line[..., 0, :], line[..., 1, :]
    return np.asarray(x * x * cov[:, 0, 0] + y * y * cov[:, 1, 1] + x * y * (2 * cov[:, 0, 1]))


def sampson_rows(matrix: Array, slopes: Array, pairs: Pairs) -> tuple[Array, Array]:
    """Sampson errors (N,) in units of their sigma and their derivatives (N, P) along ``slopes`` (P, 3, 3)."""
    every = np.concatenate([matrix[None], slopes])
    line_b, line_a = pairs.a @ np.swapaxes(every, 1, 2), pairs.b @ every
    e = np.einsum("pni,ni->pn", line_b, pairs.b)
    g_a, g_b = line_a[..., :2], line_b[..., :2]
    c_a, c_b = (np.einsum("nij,nj->ni", c, g[0]) for c, g in ((pairs.cov_a, g_a), (pairs.cov_b, g_b)))
    half = np.sum(g_a * c_a, axis=-1) + np.sum(g_b * c_b, axis=-1)  # (1 + P, N); the first is the variance itself
    sigma = np.sqrt(half[0])
    residual = e[0] / sigma
    return residual, ((e[1:] - e[0] * half[1:] / half[0]) / sigma).T


def minimise(
    state: State,
    rows: Callable[[State], tuple[Array, Array]],
    move: Callable[[State, Array], State],
    steps: int = STEPS,
) -> tuple[State, Array, Array]:
    """Levenberg-Marquardt on a small dense problem: the state, its residuals and its normal matrix."""
    residual, jacobian = rows(state)
    cost, damping = float(residual @ residual), 1e-6
    for _ in range(steps):
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ residual
        damped = normal + damping * np.diag(np.diag(normal)) + 1e-300 * np.eye(len(normal))
        try:
            step = -np.asarray(np.linalg.solve(damped, gradient), dtype=float)
        except np.linalg.LinAlgError:
            break
        trial = move(state, step)
        try:
            new_residual, new_jacobian = rows(trial)
            new = float(new_residual @ new_residual)
        except np.linalg.LinAlgError:
            new = np.inf  # a point near the horizon, whose covariance is beyond rounding
        if new <= cost:
            gain = cost - new
            state, residual, jacobian, cost, damping = trial, new_residual, new_jacobian, new, 0.1 * damping
            if gain <= _SMALL_GAIN * (1 + cost):
                break
        else:
            damping = max(10 * damping, 1e-5)
            if damping > 1e9:
                break
    return state, residual, jacobian.T @ jacobian


def inverse_normal(name: str, normal: Array, weak: tuple[str, ...]) -> Array:
    """Inverse of a normal matrix; DegenerateGeometry where it is singular whatever the units."""
    scale = np.sqrt(np.diag(normal))
    if (scale > 0).all():
        scaled = normal / np.outer(scale, scale)
        values, vectors = np.linalg.eigh(scaled)
        if values[0] > _SINGULAR * values[-1]:
            return np.asarray((vectors / values) @ vectors.T / np.outer(scale, scale))
    raise DegenerateGeometry(f"{name}: the pairs do not determine all parameters", weak)


def tangent(t: Array) -> Array:
    """Two unit vectors (3, 2) across a unit vector."""
    return np.asarray(np.linalg.svd(t[None])[2][1:].T)


def refine_pose(b_from_a: Pose, pairs: Pairs, steps: int = STEPS) -> tuple[Pose, Array, Array]:
    """Pose with unit baseline that minimises the Sampson errors of ray pairs; errors (N,), normal matrix (5, 5).

    The five parameters are the rotation (``exp(w) R``) and the baseline along `tangent`.
    """
    turns = hat(np.eye(3))

    def rows(pose: Pose) -> tuple[Array, Array]:
        across = hat(pose.translation)
        slopes = np.concatenate([across @ turns @ pose.rotation, hat(tangent(pose.translation).T) @ pose.rotation])
        return sampson_rows(across @ pose.rotation, slopes, pairs)

    def move(pose: Pose, step: Array) -> Pose:
        t = pose.translation + tangent(pose.translation) @ step[3:]
        return Pose(exp_so3(step[:3]) @ pose.rotation, t / np.linalg.norm(t))

    start = Pose(b_from_a.rotation, b_from_a.translation / np.linalg.norm(b_from_a.translation))
    return minimise(start, rows, move, steps)


def pose_covariance(pose: Pose, cov5: Array) -> Array:
    """(6, 6) covariance of ``delta`` from that of the five parameters of `refine_pose`: v = t x w + across beta."""
    to_delta = np.zeros((6, 5))
    to_delta[:3, :3] = np.eye(3)
    to_delta[3:, :3] = hat(pose.translation)
    to_delta[3:, 3:] = tangent(pose.translation)
    return to_delta @ cov5 @ to_delta.T


def refine_essential(
    b_from_a: Pose,
    rays_a: ArrayLike,
    rays_b: ArrayLike,
    cov_a: ArrayLike | None = None,
    cov_b: ArrayLike | None = None,
) -> RelativePose:
    """Relative pose that minimises the Sampson errors of N >= 5 pairs of rays.

    Parameters
    ----------
    b_from_a : start; the essential matrix of the result is ``essential_from_poses(result.b_from_a)``
    rays_a, rays_b : (N, 3) rays or (N, 2) normalised coordinates; rows with NaN are left out
    cov_a, cov_b : (N, 2, 2) or (2, 2), of the first two coordinates at z = 1 (`rays_with_cov`); None for 1

    Raises
    ------
    ValueError
        Shapes that do not fit.
    DegenerateGeometry
        Fewer than five pairs, no baseline at the start, or pairs that do not determine the five parameters.
    """
    return _refined("refine_essential", b_from_a, homogeneous_pairs("refine_essential", rays_a, rays_b, cov_a, cov_b))


def relative_pose_refine(
    b_from_a: Pose,
    xy_a: ArrayLike,
    xy_b: ArrayLike,
    camera_a: Camera,
    camera_b: Camera,
    *,
    cov_a: ArrayLike | None = None,
    cov_b: ArrayLike | None = None,
) -> RelativePose:
    """`refine_essential` for pixels as taken: ``xy_a``, ``xy_b`` (N, 2), covariances in px^2 (None for 1 px^2)."""
    return _refined("relative_pose_refine", b_from_a, pairs_of_pixels(xy_a, xy_b, camera_a, camera_b, cov_a, cov_b))


def _refined(name: str, b_from_a: Pose, pairs: Pairs) -> RelativePose:
    use = pairs.finite
    if use.sum() < 5:
        raise DegenerateGeometry(f"{name}: at least five pairs are needed, got {int(use.sum())}", ("relative pose",))
    if not np.linalg.norm(b_from_a.translation) > 0:
        raise DegenerateGeometry(f"{name}: the start has no baseline", ("baseline",))
    pose, residual, normal = refine_pose(b_from_a, pairs[use])
    cov = pose_covariance(pose, inverse_normal(name, normal, ("relative pose",)))
    distance = np.full(len(pairs), np.nan)
    distance[use] = residual
    return RelativePose(pose, cov, float(residual @ residual), distance)
