"""Essential and fundamental matrices of known poses, their epipoles, and the pixels that they act on.

Convention: ``x_b^T M x_a = 0`` for the images of one point in pictures a and b, M = E on rays (z = 1, camera frames),
M = F on *ideal* pixels. Swapping the pictures transposes both. Source: Hartley and Zisserman, Multiple View Geometry
(2nd ed.), chapter 9.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.camera import Camera
from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.pose import Pose
from windmark.geometry.rotations import hat

Array = NDArray[np.float64]


def essential_from_poses(b_from_a: Pose) -> Array:
    """Essential matrix ``E = [t]x R`` of a relative pose (or of a batch of them), with a baseline of length 1.

    Returns
    -------
    (..., 3, 3) : ``rays_b^T E rays_a = 0``; singular values 1, 1, 0; the sign is that of the baseline

    Raises
    ------
    DegenerateGeometry
        The two cameras are at one place: every direction would do as baseline.
    """
    length = np.linalg.norm(b_from_a.translation, axis=-1)
    if not (length > 0).all():
        raise DegenerateGeometry("essential_from_poses: no baseline, the cameras are at one place", ("baseline",))
    return hat(b_from_a.translation / length[..., None]) @ b_from_a.rotation


def fundamental_from_poses(camera_a: Camera, a_from_model: Pose, camera_b: Camera, b_from_model: Pose) -> Array:
    """Fundamental matrix (3, 3) of two cameras with known poses, for *ideal* pixels (`ideal_pixels`); norm 1.

    A lens with distortion (or a tilted sensor) has no fundamental matrix in the picture as taken: its epipolar lines
    are curves (`epipolar_curve`). `epipolar_distance` works on pixels as taken.

    Raises
    ------
    DegenerateGeometry
        The two cameras are at one place.
    """
    return fundamental_from_essential(essential_from_poses(b_from_model @ a_from_model.inverse()), camera_a, camera_b)


def fundamental_from_essential(essential: ArrayLike, camera_a: Camera, camera_b: Camera) -> Array:
    """``F = K_b^-T E K_a^-1``, for ideal pixels; scaled to norm 1. (..., 3, 3) -> (..., 3, 3)."""
    f = np.linalg.inv(camera_b.matrix).T @ np.asarray(essential, dtype=float) @ np.linalg.inv(camera_a.matrix)
    return np.asarray(f / np.linalg.norm(f, axis=(-2, -1), keepdims=True))


def essential_from_fundamental(fundamental: ArrayLike, camera_a: Camera, camera_b: Camera) -> Array:
    """The essential matrix nearest to ``K_b^T F K_a`` (equal singular values); norm as `essential_from_poses`.

    From an estimated F it is a start, no estimate: refine it (`relative_pose_refine`).
    """
    u, _, vt = np.linalg.svd(camera_b.matrix.T @ np.asarray(fundamental, dtype=float) @ camera_a.matrix)
    return np.asarray(u[..., :2] @ vt[..., :2, :])


def epipoles(matrix: ArrayLike) -> tuple[Array, Array]:
    """Epipoles of E or F: images of the other camera's station, as homogeneous unit vectors (..., 3).

    Returns
    -------
    in_a, in_b : ``M in_a = 0`` and ``M^T in_b = 0``; of unknown sign; a third coordinate near zero is an epipole far
        away (cameras side by side), so divide by it only where that is wanted
    """
    u, _, vt = np.linalg.svd(np.asarray(matrix, dtype=float))
    return np.asarray(vt[..., 2, :]), np.asarray(u[..., :, 2])


def ideal_pixels(camera: Camera, xy: ArrayLike) -> Array:
    """Pixels as taken -> ideal pixels (..., 2): the same focal length and principal point, without lens and tilt.

    NaN where the lens model has no inverse.
    """
    rays = camera.unproject(xy)
    return rays[..., :2] * np.array([camera.focal_px, camera.focal_px * camera.aspect]) + [camera.cx, camera.cy]
