"""Relative poses of essential matrices and of plane homographies, and which of them have the points in front.

Sources: Hartley and Zisserman, Multiple View Geometry (2nd ed.), section 9.6.2; Ma, Soatto, Kosecka and Sastry, An
Invitation to 3-D Vision, algorithm 5.2; Malis and Vargas, Deeper understanding of the homography decomposition, 2007.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import DataError
from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.pose import Pose
from windmark.geometry.rotations import project_to_so3

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ROTATION = 1e-7  # spread of the singular values of H below which it is a rotation, to rounding


def decompose_essential(essential: ArrayLike) -> tuple[Pose, Pose, Pose, Pose]:
    """The four relative poses b_from_a of an essential matrix, with a baseline of length 1.

    Two rotations (they differ by half a turn about the baseline) and both signs of the baseline; `cheirality` says
    which has the points in front of both cameras.
    """
    e = np.asarray(essential, dtype=float)
    if e.shape != (3, 3) or not np.isfinite(e).all() or not e.any():
        raise ValueError(f"decompose_essential: expected a finite matrix (3, 3) that is not zero, got {e.shape}")
    u, _, vt = np.linalg.svd(e)
    u, vt = u * np.sign(np.linalg.det(u)), vt * np.sign(np.linalg.det(vt))
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turns, t = (u @ quarter @ vt, u @ quarter.T @ vt), u[:, 2]
    return Pose(turns[0], t), Pose(turns[0], -t), Pose(turns[1], t), Pose(turns[1], -t)


def ray_depths(b_from_a: Pose, rays_a: ArrayLike, rays_b: ArrayLike) -> tuple[Array, Array]:
    """Distances along both rays (N,) to where they come closest, in multiples of the given ray vectors.

    Of ``depth_a R rays_a + t = depth_b rays_b`` in the least-squares sense; infinite or NaN for parallel rays.
    """
    y, b = np.asarray(rays_a, dtype=float) @ b_from_a.rotation.T, np.asarray(rays_b, dtype=float)
    t = b_from_a.translation
    yy, bb, yb = np.sum(y * y, axis=-1), np.sum(b * b, axis=-1), np.sum(y * b, axis=-1)
    yt, bt = y @ t, b @ t
    with np.errstate(invalid="ignore", divide="ignore"):
        square = yy * bb - yb * yb
        return np.asarray((yb * bt - bb * yt) / square), np.asarray((yy * bt - yb * yt) / square)


def cheirality(b_from_a: Pose, rays_a: ArrayLike, rays_b: ArrayLike) -> Mask:
    """(N,) pairs whose rays (N, 3), z = 1, meet in front of both cameras."""
    depth_a, depth_b = ray_depths(b_from_a, rays_a, rays_b)
    with np.errstate(invalid="ignore"):
        return np.asarray((depth_a > 0) & (depth_b > 0))


def pose_from_essential(
    essential: ArrayLike, rays_a: ArrayLike, rays_b: ArrayLike, weights: ArrayLike | None = None
) -> tuple[Pose, Mask]:
    """The one of the four poses of E with the most (weighted) pairs in front of both cameras, and which those are.

    Parameters
    ----------
    rays_a, rays_b : (N, 3) with z = 1
    weights : (N,) how much the sign of each depth is worth, for example parallax over its sigma; None for equal
    """
    poses = decompose_essential(essential)
    front = np.stack([cheirality(p, rays_a, rays_b) for p in poses])
    votes = front.sum(axis=1) if weights is None else front @ np.asarray(weights, dtype=float)
    best = int(np.argmax(votes))
    return poses[best], front[best]


@dataclass(frozen=True)
class PlanePose:
    """One physical reading of a plane's homography, ``H ~ R + t n^T / d``.

    Parameters
    ----------
    b_from_a : pose with a baseline of length 1
    normal : (3,) unit normal n of the plane in frame a, ``n . X = d``: it points away from camera a
    distance : d > 0, distance of the plane from camera a in baselines
    """

    b_from_a: Pose
    normal: Array
    distance: float


def homography_from_plane(b_from_a: Pose, normal: ArrayLike, distance: float) -> Array:
    """Homography of rays (z = 1) of the plane ``normal . X = distance`` (frame a, unit of the baseline)."""
    if not distance > 0:
        raise ValueError(f"homography_from_plane: distance must be > 0, got {distance}")
    return b_from_a.rotation + np.outer(b_from_a.translation, np.asarray(normal, dtype=float)) / distance


def decompose_homography(homography: ArrayLike, rays_a: ArrayLike, rays_b: ArrayLike) -> tuple[PlanePose, ...]:
    """Relative poses that a homography of rays allows: one or two.

    Parameters
    ----------
    homography : (3, 3), ``rays_b ~ H rays_a``, any scale
    rays_a, rays_b : (N, 3) with z = 1, points of the plane; the plane must be in front of both cameras at (nearly)
        all of them, which rules out two of the four mathematical solutions and often a third

    Returns
    -------
    Two poses where the points do not decide, else one. They coincide where the baseline is along the normal.

    Raises
    ------
    ValueError
        A singular matrix or shapes that do not fit.
    DegenerateGeometry
        H is a rotation to rounding: no baseline, no plane.
    """
    h, a, b = (np.asarray(v, dtype=float) for v in (homography, rays_a, rays_b))
    if h.shape != (3, 3) or a.ndim != 2 or a.shape != b.shape or a.shape[1] != 3:
        raise ValueError(f"decompose_homography: expected (3, 3) and twice (N, 3), got {h.shape}, {a.shape}, {b.shape}")
    if np.median(np.sum(b * (a @ h.T), axis=1)) < 0:
        h = -h
    _, s, vt = np.linalg.svd(h)
    if not s[2] > 0 or np.linalg.det(h) < 0:
        raise DataError("decompose_homography: H is singular, or mirrors the plane")
    h, s = h / s[1], s / s[1]
    if s[0] - s[2] < _ROTATION:
        raise DegenerateGeometry("decompose_homography: H is a rotation, there is no baseline", ("baseline", "normal"))
    v1, v2, v3 = vt * np.sign(np.linalg.det(vt))
    low, high = np.sqrt(max(1 - s[2] ** 2, 0.0)), np.sqrt(max(s[0] ** 2 - 1, 0.0))
    across = np.sqrt(s[0] ** 2 - s[2] ** 2)
    found = [_plane_pose(h, v2, (low * v1 + sign * high * v3) / across, a) for sign in (1.0, -1.0)]
    most = max(share for _, share in found)
    return tuple(pose for pose, share in found if share >= most - 0.02)


def _plane_pose(h: Array, v: Array, u: Array, rays_a: Array) -> tuple[PlanePose, float]:
    """Pose from two directions v and u whose lengths H keeps, and the share of points that are in front of camera a."""
    frame_a = np.column_stack([v, u, np.cross(v, u)])
    frame_b = np.column_stack([h @ v, h @ u, np.cross(h @ v, h @ u)])
    rotation, normal = project_to_so3(frame_b @ frame_a.T), frame_a[:, 2]
    side = rays_a @ normal
    if np.median(side) < 0:
        normal, side = -normal, -side
    t = (h - rotation) @ normal
    length = float(np.linalg.norm(t))
    return PlanePose(Pose(rotation, t / length), normal, 1 / length), float(np.mean(side > 0))
