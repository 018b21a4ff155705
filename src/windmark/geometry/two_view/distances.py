"""Epipolar lines and how far pairs are from the epipolar geometry.

Sources: Hartley and Zisserman, Multiple View Geometry (2nd ed.), sections 9.2, 11.4.3 (Sampson) and 11.1.8 (symmetric
distance); Sampson, Fitting conic sections to "very scattered" data, CGIP 1982.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.camera import Camera
from windmark.geometry.pose import Pose
from windmark.geometry.two_view.matrices import essential_from_poses
from windmark.geometry.two_view.pairs import rays_with_cov

Array = NDArray[np.float64]


def epipolar_lines(fundamental: ArrayLike, xy_a: ArrayLike) -> Array:
    """Lines (..., 3) in picture b of points (..., 2) of picture a; ``epipolar_lines(F.T, xy_b)`` gives those in a.

    Normalised, so that ``line @ (x, y, 1)`` is the signed distance of a point to the line, in pixels (ideal ones if F
    is that of a camera with distortion). NaN for the epipole of a, which has no line.
    """
    line = _homogeneous(xy_a) @ np.asarray(fundamental, dtype=float).T
    with np.errstate(invalid="ignore", divide="ignore"):
        length = np.hypot(line[..., :1], line[..., 1:2])
        return np.asarray(line / np.where(length > 0, length, np.nan))


def sampson_distance(fundamental: ArrayLike, xy_a: ArrayLike, xy_b: ArrayLike) -> Array:
    """Signed Sampson distance (...), px: how far both points of a pair must move together, to first order.

    Its sigma is the sigma per coordinate of the points, where that is the same in both pictures. ``xy_a`` (..., 2) and
    ``xy_b`` (..., 2) broadcast: ``xy_a[:, None]`` and ``xy_b[None]`` give the table of all pairs.
    """
    e, g_a, g_b = _residual(fundamental, xy_a, xy_b)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(e / np.sqrt((g_a**2).sum(axis=-1) + (g_b**2).sum(axis=-1)))


def symmetric_epipolar_distance(fundamental: ArrayLike, xy_a: ArrayLike, xy_b: ArrayLike) -> Array:
    """Signed root (...) of the sum of both squared distances, point of a to line in a and of b to line in b, px.

    Shapes broadcast as in `sampson_distance`.
    """
    e, g_a, g_b = _residual(fundamental, xy_a, xy_b)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(e * np.sqrt(1 / (g_a**2).sum(axis=-1) + 1 / (g_b**2).sum(axis=-1)))


@dataclass(frozen=True)
class EpipolarDistance:
    """Result of `epipolar_distance`, shape (M, N) or (N,).

    Parameters
    ----------
    in_a_px, in_b_px : signed distances to the epipolar curve in each picture as taken, px
    sampson_px : signed distance of the pair, px; never larger than the other two
    sigmas : the distance in standard deviations: of the points' noise, and of the pose's if its covariance was given
    """

    in_a_px: Array
    in_b_px: Array
    sampson_px: Array
    sigmas: Array


def epipolar_distance(
    xy_a: ArrayLike,
    xy_b: ArrayLike,
    camera_a: Camera,
    camera_b: Camera,
    b_from_a: Pose,
    *,
    cov_a: ArrayLike | None = None,
    cov_b: ArrayLike | None = None,
    cov_pose: ArrayLike | None = None,
    every_pair: bool = False,
) -> EpipolarDistance:
    """How far pairs of spots are from the epipolar geometry of a relative pose, in pixels as taken (lens included).

    Distances are of first order: exact lengths for a straight epipolar line, very nearly so for the weakly curved
    ones of a lens, as long as they are short.

    Parameters
    ----------
    xy_a, xy_b : (M, 2) and (N, 2) pixels; row by row pairs (M = N) unless ``every_pair``
    b_from_a : camera b from camera a; the length of the baseline does not matter
    cov_a, cov_b : covariances of the spots, (2, 2) or one each, px^2; None for 1 px^2
    cov_pose : (6, 6) covariance of ``delta`` in ``exp(delta) @ b_from_a``, as `TwoView.cov`
    every_pair : give the table (M, N) of all pairs instead of (N,)

    Raises
    ------
    DegenerateGeometry
        No baseline.
    """
    rays_a, c_a = rays_with_cov(camera_a, xy_a, cov_a)
    rays_b, c_b = rays_with_cov(camera_b, xy_b, cov_b)
    scale_a, scale_b = (rays_with_cov(camera, xy)[1] for camera, xy in ((camera_a, xy_a), (camera_b, xy_b)))
    if every_pair:
        rays_a, c_a, scale_a = rays_a[:, None], c_a[:, None], scale_a[:, None]
    elif len(rays_a) != len(rays_b):
        raise ValueError(f"epipolar_distance: pairs need as many spots in a as in b, got {len(rays_a)}, {len(rays_b)}")
    essential = essential_from_poses(b_from_a)
    lines_b, lines_a = rays_a @ essential.T, rays_b @ essential
    e = np.sum(lines_b * rays_b, axis=-1)
    g_a, g_b = lines_a[..., :2], lines_b[..., :2]
    px_a, px_b = _quadratic(g_a, scale_a), _quadratic(g_b, scale_b)  # squared slope of e per pixel
    variance = _quadratic(g_a, c_a) + _quadratic(g_b, c_b)
    if cov_pose is not None:
        slope = _pose_slope(b_from_a, rays_a, rays_b)
        variance = variance + np.einsum("...i,ij,...j->...", slope, np.asarray(cov_pose, dtype=float), slope)
    with np.errstate(invalid="ignore", divide="ignore"):
        return EpipolarDistance(e / np.sqrt(px_a), e / np.sqrt(px_b), e / np.sqrt(px_a + px_b), e / np.sqrt(variance))


def _pose_slope(b_from_a: Pose, rays_a: Array, rays_b: Array) -> Array:
    """Derivative (..., 6) of ``rays_b^T [t / |t|]x R rays_a`` by delta in ``exp(delta) @ b_from_a``.

    With y = R rays_a the residual is t . (y x rays_b) / |t|: the rotation turns y and t, the translation moves t.
    """
    length = np.linalg.norm(b_from_a.translation)
    t = b_from_a.translation / length
    y = rays_a @ b_from_a.rotation.T
    normal = np.cross(y, rays_b)
    by_t = normal - np.sum(normal * t, axis=-1, keepdims=True) * t
    by_y = np.cross(rays_b, t)
    by_rotation = np.cross(y, by_y) + np.cross(t, by_t)
    return np.concatenate([by_rotation, by_t / length], axis=-1)


def _homogeneous(xy: ArrayLike) -> Array:
    p = np.asarray(xy, dtype=float)
    if p.shape[-1:] != (2,):
        raise ValueError(f"expected points (..., 2), got {p.shape}")
    return np.concatenate([p, np.ones((*p.shape[:-1], 1))], axis=-1)


def _residual(fundamental: ArrayLike, xy_a: ArrayLike, xy_b: ArrayLike) -> tuple[Array, Array, Array]:
    """``x_b^T F x_a`` and its derivatives (..., 2) by x_a and x_b."""
    f = np.asarray(fundamental, dtype=float)
    if f.shape != (3, 3):
        raise ValueError(f"fundamental must be (3, 3), got {f.shape}")
    a, b = _homogeneous(xy_a), _homogeneous(xy_b)
    line_b, line_a = a @ f.T, b @ f
    return np.sum(line_b * b, axis=-1), line_a[..., :2], line_b[..., :2]


def _quadratic(g: Array, c: Array) -> Array:
    """``g^T c g`` of (..., 2) and (..., 2, 2)."""
    x, y = g[..., 0], g[..., 1]
    return np.asarray(x * x * c[..., 0, 0] + 2 * x * y * c[..., 0, 1] + y * y * c[..., 1, 1])
