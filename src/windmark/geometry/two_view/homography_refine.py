"""Homographies with noise in both pictures: Sampson errors, refinement with covariance, rotations as a special case.

Source: Hartley and Zisserman, Multiple View Geometry (2nd ed.), sections 4.2.6 and 4.7; Chum, Pajdla and Sturm, The
geometric error for homographies, CVIU 2005.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.rotations import exp_so3, hat
from windmark.geometry.two_view.decompose import PlanePose
from windmark.geometry.two_view.homography import fit_homography
from windmark.geometry.two_view.pairs import Pairs, homogeneous_pairs
from windmark.geometry.two_view.refine import STEPS, inverse_normal, minimise, pose_covariance, tangent

Array = NDArray[np.float64]

HORIZON = 1e-2
"""Third coordinate below which a point counts as on the horizon."""


@dataclass(frozen=True)
class Homography:
    """Result of `refine_homography`.

    Parameters
    ----------
    matrix : (3, 3) of norm 1, the third coordinate of the mapped points is positive
    cov : (9, 9) covariance of the entries row by row, rank 8: nothing along the matrix itself
    cost : sum of the squared Sampson errors in units of their sigma; chi-square with 2 N - 8 degrees of freedom
    distance : (N,) Sampson errors (>= 0) in units of their sigma; NaN for pairs that were not used
    """

    matrix: Array
    cov: Array
    cost: float
    distance: Array


def homography_errors(matrix: Array, pairs: Pairs) -> Array:
    """Squared Sampson errors (..., N) in units of sigma, for matrices (..., 3, 3); infinite beyond the horizon."""
    q = matrix @ pairs.a.T  # (..., 3, N)
    h = matrix[..., None]
    c_a, c_b = np.moveaxis(pairs.cov_a, 0, -1), np.moveaxis(pairs.cov_b, 0, -1)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        inverse = 1 / q[..., 2, :]
        x, y = q[..., 0, :] * inverse, q[..., 1, :] * inverse
        # Rows of the derivative by the point of a, and the covariance of the difference in b.
        x0, x1 = (h[..., 0, 0, :] - x * h[..., 2, 0, :]) * inverse, (h[..., 0, 1, :] - x * h[..., 2, 1, :]) * inverse
        y0, y1 = (h[..., 1, 0, :] - y * h[..., 2, 0, :]) * inverse, (h[..., 1, 1, :] - y * h[..., 2, 1, :]) * inverse
        s_xx = x0 * x0 * c_a[0, 0] + 2 * x0 * x1 * c_a[0, 1] + x1 * x1 * c_a[1, 1] + c_b[0, 0]
        s_yy = y0 * y0 * c_a[0, 0] + 2 * y0 * y1 * c_a[0, 1] + y1 * y1 * c_a[1, 1] + c_b[1, 1]
        s_xy = x0 * y0 * c_a[0, 0] + (x0 * y1 + x1 * y0) * c_a[0, 1] + x1 * y1 * c_a[1, 1] + c_b[0, 1]
        x, y = x - pairs.b[:, 0], y - pairs.b[:, 1]
        square = (x * x * s_yy - 2 * x * y * s_xy + y * y * s_xx) / (s_xx * s_yy - s_xy * s_xy)
    return np.where((q[..., 2, :] > 0) & np.isfinite(square), square, np.inf)


def homography_rows(matrix: Array, slopes: Array, pairs: Pairs) -> tuple[Array, Array]:
    """Whitened residuals (2 N,) and derivatives (2 N, P) along ``slopes`` (P, 3, 3); their gradient is exact.

    With r = H(x_a) - x_b and its covariance S, the rows are L^-1 r (S = L L^T) and L^-1 (dr - dS S^-1 r / 2).
    """
    q = pairs.a @ matrix.T
    z = np.where(np.abs(q[:, 2]) > HORIZON, q[:, 2], HORIZON)  # a trial step may put a point there: far, not infinite
    at = q[:, :2] / z[:, None]
    slope = (matrix[:2, :2] - at[:, :, None] * matrix[2, :2]) / z[:, None, None]  # by x_a
    r = at - pairs.b[:, :2]
    s = slope @ pairs.cov_a @ np.swapaxes(slope, 1, 2) + pairs.cov_b
    dq = pairs.a @ np.swapaxes(slopes, 1, 2)  # (P, N, 3)
    dz = dq[..., 2]
    d_at = (dq[..., :2] - at * dz[..., None]) / z[:, None]
    d_slope = (
        slopes[:, None, :2, :2] - d_at[..., None] * matrix[2, :2] - at[:, :, None] * slopes[:, None, 2:, :2]
    ) / z[:, None, None] - slope * (dz / z)[..., None, None]
    half = d_slope @ pairs.cov_a @ np.swapaxes(slope, 1, 2)
    ds = half + np.swapaxes(half, -1, -2)
    weighted = np.linalg.solve(s, r[..., None])
    inner = d_at - 0.5 * (ds @ weighted)[..., 0]
    whiten = np.linalg.inv(np.linalg.cholesky(s))
    rows = np.einsum("nij,pnj->nip", whiten, inner)
    return (whiten @ r[..., None]).ravel(), rows.reshape(-1, len(slopes))


def refine_matrix(matrix: Array, pairs: Pairs, steps: int = STEPS) -> tuple[Array, Array, Array]:
    """Homography that minimises the Sampson errors: matrix of norm 1, residuals (2 N,), normal matrix (8, 8).

    The eight parameters are the directions of `across`.
    """

    def rows(h: Array) -> tuple[Array, Array]:
        return homography_rows(h, across(h), pairs)

    def move(h: Array, step: Array) -> Array:
        new = h + np.tensordot(step, across(h), 1)
        return np.asarray(new / np.linalg.norm(new))

    return minimise(matrix / np.linalg.norm(matrix), rows, move, steps)


def across(matrix: Array) -> Array:
    """Eight matrices (8, 3, 3), orthonormal and orthogonal to the given one."""
    return np.asarray(np.linalg.svd(matrix.reshape(1, 9))[2][1:].reshape(8, 3, 3))


def refine_homography(
    xy_a: ArrayLike,
    xy_b: ArrayLike,
    cov_a: ArrayLike | None = None,
    cov_b: ArrayLike | None = None,
    *,
    start: ArrayLike | None = None,
) -> Homography:
    """Homography that minimises the Sampson errors of N >= 4 pairs, with noise in both pictures.

    Parameters
    ----------
    xy_a, xy_b : (N, 2) ideal pixels or normalised coordinates, or (N, 3) rays; rows with NaN are left out
    cov_a, cov_b : (N, 2, 2) or (2, 2) in the same unit squared; None for 1
    start : (3, 3); None for the linear solution

    Raises
    ------
    ValueError
        Shapes that do not fit.
    DegenerateGeometry
        Fewer than four pairs, or all (but one) on a line.
    """
    pairs = homogeneous_pairs("refine_homography", xy_a, xy_b, cov_a, cov_b)
    use = pairs.finite
    good = pairs[use]
    h = fit_homography(good.a[:, :2], good.b[:, :2]) if start is None else np.asarray(start, dtype=float)
    if h is None or len(good) < 4:
        raise DegenerateGeometry("refine_homography: fewer than four pairs, or all but one on a line", ("homography",))
    h, residual, normal = refine_matrix(h, good)
    directions = across(h).reshape(8, 9)
    cov = directions.T @ inverse_normal("refine_homography", normal, ("homography",)) @ directions
    distance = np.full(len(pairs), np.nan)
    distance[use] = np.linalg.norm(residual.reshape(-1, 2), axis=1)
    return Homography(h, cov, float(residual @ residual), distance)


def refine_rotation(rotation: Array, pairs: Pairs) -> tuple[Array, Array, Array]:
    """Rotation that minimises the Sampson errors (no baseline); residuals (2 N,) and normal matrix (3, 3)."""
    turns = hat(np.eye(3))
    return minimise(
        rotation,
        lambda r: homography_rows(r, turns @ r, pairs),
        lambda r, step: np.asarray(exp_so3(step) @ r),
    )


def plane_pose_covariance(plane: PlanePose, homography: Array, cov: Array) -> Array:
    """(6, 6) covariance of ``delta`` of a plane's pose from that of its homography (9, 9), norm 1.

    H = s (R + t v^T) with v = n / d: the nine entries are changed by rotation, direction of the baseline, v and s.
    """
    pose, v = plane.b_from_a, plane.normal / plane.distance
    h = pose.rotation + np.outer(pose.translation, v)
    s = float(np.sum(h * homography) / np.sum(h * h))
    slopes = [
        *(hat(np.eye(3)) @ pose.rotation),
        *(np.outer(b, v) for b in tangent(pose.translation).T),
        *(np.outer(pose.translation, axis) for axis in np.eye(3)),
    ]
    columns = np.column_stack([*(s * m.ravel() for m in slopes), h.ravel()])
    scale = np.linalg.norm(columns, axis=0)
    back = np.linalg.pinv(columns / scale, rcond=1e-14)[:5] / scale[:5, None]
    return pose_covariance(pose, back @ cov @ back.T)
