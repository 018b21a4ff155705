"""Points in space from their images in several cameras of known pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.camera import Camera
from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.pose import Pose

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_STEPS = 50
_MIN_ANGLE = 1e-7  # radians between rays; less is rounding
RIDGE = 1e-14  # of the trace: what rounding leaves of a zero


@dataclass(frozen=True)
class Triangulation:
    """Result of `triangulate`, one row per point (a single point has no leading axis).

    Parameters
    ----------
    xyz : (N, 3) in the frame of the poses' source, NaN where there is no result
    cov : (N, 3, 3) covariance, length unit squared; cameras and poses count as known
    rms_px : (N,) root mean square length of the residuals over the views
    angle_deg : (N,) largest angle between two rays of the point
    views : (N,) number of observations used
    reason : (N,) why there is no result, "" where there is one
    """

    xyz: Array
    cov: Array
    rms_px: Array
    angle_deg: Array
    views: NDArray[np.int64]
    reason: NDArray[np.str_]

    @property
    def valid(self) -> Mask:
        """(N,) where there is a result."""
        return np.asarray(self.reason == "")


def triangulate(
    cameras: Camera | Sequence[Camera], poses: Pose | Sequence[Pose], xy: ArrayLike, cov: ArrayLike | None = None
) -> Triangulation:
    """Points that minimise the (weighted) squared reprojection error.

    A linear solution on the undistorted rays starts a Gauss-Newton iteration, damped where needed, with the
    full camera model; all points are worked on together.

    Parameters
    ----------
    cameras : one camera for all views, or one per view (V)
    poses : cam_from_model of every view: a sequence of V poses or one batch (V,)
    xy : (V, N, 2) pixels, NaN where a view did not see a point; or (V, 2) for a single point
    cov : (V, N, 2, 2) or (V, 2, 2) covariances in px^2, or one (2, 2) for all; None for 1 px^2, so that the
        resulting covariance is per px^2 of noise

    Returns
    -------
    Triangulation
        Where a point cannot be found the row is NaN and ``reason`` says why: fewer than two views, no baseline,
        parallel or diverging rays, behind a camera, or outside the lens model.

    Raises
    ------
    ValueError
        Shapes that do not fit together, fewer than two views, covariances that are not positive definite.
    DegenerateGeometry
        For a single point, instead of a ``reason``.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, 2nd ed., section 12.2 (linear start).
    """
    cams, pose, p, weight, single = _check(cameras, poses, xy, cov)
    rays, seen, reason = _rays(cams, pose, p)
    angle = _widest_angle(pose, rays, seen)
    _mark(reason, seen.sum(axis=0) < 2, "fewer than two views")
    _mark(reason, ~_has_baseline(pose, seen), "no baseline: all views of the point are from one place")
    _mark(reason, ~(angle > _MIN_ANGLE), "parallel rays")
    todo = reason == ""
    xyz, info, rms = np.full((p.shape[1], 3), np.nan), np.full((p.shape[1], 3, 3), np.nan), np.full(p.shape[1], np.nan)
    if todo.any():
        start = _linear(cams, pose, rays[:, todo], seen[:, todo])
        xyz[todo], info[todo], rms[todo], failed = _refine(
            cams, pose, p[:, todo], weight[:, todo], seen[:, todo], start
        )
        reason[todo] = failed
    bad = reason != ""
    xyz[bad], rms[bad], info[bad] = np.nan, np.nan, np.eye(3)
    covariance = np.where(bad[:, None, None], np.nan, np.linalg.inv(info))
    if not single:
        return Triangulation(xyz, covariance, rms, np.degrees(angle), seen.sum(axis=0), reason)
    if bad[0]:
        raise DegenerateGeometry(f"triangulate: {reason[0]}", ("depth",))
    return Triangulation(xyz[0], covariance[0], rms[0], np.degrees(angle)[0], seen.sum(axis=0)[0], reason[0])


# --- input ---------------------------------------------------------------------------------------
def _check(
    cameras: Camera | Sequence[Camera], poses: Pose | Sequence[Pose], xy: ArrayLike, cov: ArrayLike | None
) -> tuple[list[Camera], Pose, Array, Array, bool]:
    p = np.asarray(xy, dtype=float)
    if p.ndim not in (2, 3) or p.shape[-1] != 2:
        raise ValueError(f"triangulate: xy must be (V, N, 2), or (V, 2) for a single point, got {p.shape}")
    single = p.ndim == 2
    p = p[:, None] if single else p
    if len(p) < 2:
        raise ValueError(f"triangulate: at least two views are needed, xy has {len(p)}")
    if not isinstance(poses, Pose):
        poses = Pose(np.stack([q.rotation for q in poses]), np.stack([q.translation for q in poses]))
    if poses.rotation.shape != (len(p), 3, 3):
        raise ValueError(f"triangulate: expected {len(p)} poses, one per view of xy, got {poses.rotation.shape[:-2]}")
    cams = [cameras] * len(p) if isinstance(cameras, Camera) else list(cameras)
    if len(cams) != len(p):
        raise ValueError(f"triangulate: expected one camera or {len(p)}, one per view of xy, got {len(cams)}")
    return cams, poses, p, _weights(cov, p, single), single


def _weights(cov: ArrayLike | None, p: Array, single: bool) -> Array:
    """Inverse covariances (V, N, 2, 2)."""
    c = np.eye(2) if cov is None else np.asarray(cov, dtype=float)
    if single and c.shape == (len(p), 2, 2):
        c = c[:, None]
    if c.shape not in ((2, 2), (*p.shape[:2], 2, 2)):
        raise ValueError(f"triangulate: cov must be (2, 2) or {(*p.shape[:2], 2, 2)}, got {c.shape}")
    c = np.broadcast_to(c, (*p.shape[:2], 2, 2))
    seen = np.asarray(np.isfinite(p).all(axis=-1))
    c = np.where(seen[..., None, None], c, np.eye(2))
    determinant = c[..., 0, 0] * c[..., 1, 1] - c[..., 0, 1] * c[..., 1, 0]
    if not ((determinant > 0) & (c[..., 0, 0] > 0)).all():
        raise ValueError("triangulate: cov must be finite and positive definite wherever xy is given")
    return np.asarray(np.linalg.inv(c))


def _mark(reason: NDArray[np.str_], where: Mask, text: str) -> None:
    reason[where & np.asarray(reason == "")] = text


# --- geometry of the rays ------------------------------------------------------------------------
def _rays(cams: list[Camera], pose: Pose, p: Array) -> tuple[Array, Mask, NDArray[np.str_]]:
    """Rays (V, N, 3) with z = 1 in the camera frames, where they exist, and a first reason."""
    rays = np.stack([camera.unproject(q) for camera, q in zip(cams, p, strict=True)])
    seen, given = np.asarray(np.isfinite(rays).all(axis=-1)), np.asarray(np.isfinite(p).all(axis=-1))
    reason = np.full(p.shape[1], "", dtype="<U64")
    _mark(reason, (given & ~seen).any(axis=0) & (seen.sum(axis=0) < 2), "outside the lens model")
    return rays, seen, reason


def _widest_angle(pose: Pose, rays: Array, seen: Mask) -> Array:
    """Largest angle (N,) in radians between two rays of each point."""
    d = np.swapaxes(pose.rotation, -1, -2)[:, None] @ rays[..., None]
    d = d[..., 0] / np.linalg.norm(d[..., 0], axis=-1, keepdims=True)
    widest = np.zeros(rays.shape[1])
    for i in range(len(rays)):
        both = seen[i] & seen[i + 1 :]
        chord = np.linalg.norm(d[i + 1 :] - d[i], axis=-1)
        widest = np.maximum(widest, np.where(both, chord, 0.0).max(axis=0, initial=0.0))
    return 2 * np.arcsin(np.minimum(0.5 * widest, 1.0))


def _has_baseline(pose: Pose, seen: Mask) -> Mask:
    """Whether the stations that see a point differ by more than rounding."""
    c = pose.center[:, None, :]
    high = np.where(seen[..., None], c, -np.inf).max(axis=0)
    low = np.where(seen[..., None], c, np.inf).min(axis=0)
    size = np.abs(pose.center).max() + np.abs(pose.translation).max()
    with np.errstate(invalid="ignore"):
        return np.asarray((high - low).max(axis=-1) > 1e-12 * size)


# --- solution ------------------------------------------------------------------------------------
def _linear(cams: list[Camera], pose: Pose, rays: Array, seen: Mask) -> Array:
    """Homogeneous linear solution (N, 4) in a frame centred on the stations; unseen views weigh nothing."""
    center = pose.center.mean(axis=0)
    size = max(float(np.abs(pose.center - center).max()), 1e-300)
    matrix = np.concatenate([pose.rotation, ((pose.rotation @ center) + pose.translation)[..., None] / size], axis=-1)
    x = np.where(seen[..., None], rays, 0.0)
    focal = np.array([c.focal_px for c in cams])
    weight = (focal / focal.max())[:, None, None] * seen[..., None]
    rows = [weight * (x[..., k, None] * matrix[:, None, 2] - matrix[:, None, k]) for k in (0, 1)]
    a = np.concatenate(rows)  # (2 V, N, 4)
    h = np.linalg.svd(np.swapaxes(a, 0, 1), full_matrices=False)[2][:, -1]
    # A point at infinity is brought to a large finite distance: Gauss-Newton and the covariance judge it.
    w = np.where(np.abs(h[:, 3]) < 1e-9, 1e-9, h[:, 3])
    return np.asarray(center + size * h[:, :3] / w[:, None])


def _refine(
    cams: list[Camera], pose: Pose, p: Array, weight: Array, seen: Mask, xyz: Array
) -> tuple[Array, Array, Array, NDArray[np.str_]]:
    """Levenberg-Marquardt per point, all at once: xyz, information (N, 3, 3), rms (N,), reason (N,)."""
    reason = np.full(len(xyz), "", dtype="<U64")
    xyz = _in_front(pose, seen, xyz)
    cost, gradient, info, rms = _normal_equations(cams, pose, p, weight, seen, xyz)
    damping = np.full(len(xyz), 1e-9)
    active: Mask = np.array(np.isfinite(cost), dtype=np.bool_)
    for _ in range(_STEPS):
        if not active.any():
            break
        i = np.flatnonzero(active)
        diagonal = np.einsum("nii->ni", info[i])
        # Rays that are parallel to rounding make the information singular, a point in the infinite makes it zero: the
        # step is then whatever the ridge leaves of it, and the eigenvalues below say what such a point is worth.
        trace = diagonal.sum(axis=1)
        ridge = np.where(trace > 0, RIDGE * trace, 1.0)
        damped = info[i] + (damping[i, None] * diagonal + ridge[:, None])[..., None] * np.eye(3)
        step = np.linalg.solve(damped, gradient[i][..., None])[..., 0]
        trial = xyz[i] - step
        new = _normal_equations(cams, pose, p[:, i], weight[:, i], seen[:, i], trial)
        gain = np.sum(step * gradient[i], axis=-1)
        better = new[0] < cost[i]
        small = gain <= 1e-10 * cost[i] + 1e-20  # the step is far below the uncertainty
        for old, value in zip((xyz, cost, gradient, info, rms), (trial, *new), strict=True):
            old[i[better]] = value[better]
        damping[i] = np.where(better, 0.1 * damping[i], np.maximum(10 * damping[i], 1e-6))
        active[i] = ~small & (damping[i] < 1e8)
    _mark(reason, ~np.isfinite(cost), "behind a camera or outside the lens model")
    eigenvalues = np.linalg.eigvalsh(np.where(np.isfinite(cost)[:, None, None], info, np.eye(3)))
    _mark(reason, ~(eigenvalues[:, 0] > 1e-15 * eigenvalues[:, 2]), "rays diverge: the best depth is infinite")
    return xyz, info, rms, reason


def _in_front(pose: Pose, seen: Mask, xyz: Array) -> Array:
    """A start behind the cameras (rays that diverge by noise) is turned round to the far side of the stations."""
    depth = np.einsum("vj,nj->vn", pose.rotation[:, 2], xyz) + pose.translation[:, 2, None]
    behind = np.asarray((np.where(seen, depth, np.inf) <= 0).any(axis=0))
    center = pose.center.mean(axis=0)
    flipped = 2 * center - xyz
    return np.where(behind[:, None], flipped, xyz)


def _normal_equations(
    cams: list[Camera], pose: Pose, p: Array, weight: Array, seen: Mask, xyz: Array
) -> tuple[Array, Array, Array, Array]:
    """Weighted cost (N,), half gradient (N, 3), information (N, 3, 3) and rms in px (N,); cost inf where invalid."""
    n = len(xyz)
    cost, gradient, info, square = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros(n)
    for v, camera in enumerate(cams):
        i = np.flatnonzero(seen[v])
        r = pose.rotation[v]
        xy, valid, d_xyz, _ = camera.project_jacobian(xyz[i] @ r.T + pose.translation[v])
        residual, j, w = xy - p[v, i], d_xyz @ r, weight[v, i]
        wr = (w @ residual[..., None])[..., 0]
        jw = np.swapaxes(j, -1, -2) @ w
        cost[i] += np.where(valid, np.sum(residual * wr, axis=-1), np.inf)
        gradient[i] += (jw @ residual[..., None])[..., 0]
        info[i] += jw @ j
        square[i] += np.sum(residual * residual, axis=-1)
    return cost, gradient, info, np.sqrt(square / np.maximum(seen.sum(axis=0), 1))
