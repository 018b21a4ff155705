"""Camera pose and unknown focal length from four known points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.errors import COLLINEAR, DegenerateGeometry
from windmark.geometry.pose import Pose

Array = NDArray[np.float64]

_ORDERS = np.array([[0, 1, 2, 3], [0, 1, 3, 2], [0, 2, 3, 1], [1, 2, 3, 0]])
_GRID_RATIO = 1.12
_MAX_LOG_SIGMA = 1e6  # at 1e-6 px of noise the focal length would be unknown to a factor e: it is not determined


class FocalPose(NamedTuple):
    """One solution of `p4pf`.

    Parameters
    ----------
    focal_px : focal length, pixels
    pose : cam_from_model
    rms_px : root mean square length of the four residuals (eight numbers, seven unknowns: one is left to judge by)
    focal_sigma_px : standard deviation of the focal length per pixel of noise (1 sigma per coordinate), to first order
    """

    focal_px: float
    pose: Pose
    rms_px: float
    focal_sigma_px: float


def p4pf(
    xy_centered: ArrayLike,
    xyz: ArrayLike,
    *,
    max_rms_px: float = 2.0,
    focal_range_px: tuple[float, float] | None = None,
) -> list[FocalPose]:
    """Focal length and pose from four points, best first.

    For each focal length of a fine logarithmic grid the poses of the best-shaped triangle are found with P3P;
    where the fourth point comes nearest along a branch of solutions, pose and focal length are refined by least
    squares on all four. Nothing is assumed about the points: in a plane or in space.

    Parameters
    ----------
    xy_centered : (4, 2) image points in pixels from the principal point, free of distortion, square pixels
        (divide y by the camera's aspect)
    xyz : (4, 3) points in the model frame
    max_rms_px : solutions that fit worse are dropped
    focal_range_px : focal lengths to look at; by default 0.2 to 300 times the largest distance of a point
        from the principal point (fields of view, measured over the points, of 157 to 0.4 degrees)

    Returns
    -------
    list of FocalPose
        Empty when no camera in the range sees the points within ``max_rms_px``.

    Raises
    ------
    ValueError
        Wrong shape or values.
    DegenerateGeometry
        The points are collinear or coincide, or they fit but do not determine the focal length: seen
        face-on a plane looks the same with a longer lens from farther away, and so does, within its noise,
        everything beyond some focal length.

    Notes
    -----
    The focal length shows only in perspective. It is weakly determined by nearly flat markers (with 0.2 px of
    noise a third of random views are off by more than 5 %): look at ``focal_sigma_px`` before trusting it. About one
    flat problem in 10,000 is lost: two minima closer than the grid, of which the other fits to a few hundredths of a
    pixel.
    """
    xy, points = _check(xy_centered, xyz, max_rms_px)
    order = _best_triangle_first(points)
    found, fits = _search(xy[order], points[order], _grid(xy, focal_range_px), max_rms_px)
    if fits and not any(s.focal_sigma_px < _MAX_LOG_SIGMA * s.focal_px for s in found):
        raise DegenerateGeometry(
            "p4pf: the four points show no perspective (a plane seen face-on, a lens too long for the noise, or two"
            " points coincide)",
            ("focal length", "distance"),
        )
    return sorted(found, key=lambda s: s.rms_px)


def _search(xy: Array, xyz: Array, grid: Array, max_rms_px: float) -> tuple[list[FocalPose], bool]:
    """Minima that fit, and whether any camera of the grid does."""
    from windmark.geometry import _p4pf_kernels as kernels

    center = xyz.mean(axis=0)
    xyz = xyz - center
    rotation, translation = np.empty((len(grid), 4, 3, 3)), np.empty((len(grid), 4, 3))
    error, chosen = np.empty((len(grid), 4)), np.zeros((len(grid), 4), dtype=np.bool_)
    kernels.scan(xy, xyz, grid, rotation, translation, error)
    kernels.choose_starts(rotation, error, max_rms_px, chosen)
    found = np.empty((4 * len(grid), 15))
    n = kernels.refine_all(xy, xyz, grid, rotation, translation, chosen, found)
    solutions = []
    for focal, rms, log_sigma, *pose in found[:n].tolist():
        if rms <= max_rms_px and grid[0] / _GRID_RATIO <= focal <= grid[-1] * _GRID_RATIO:
            matrix = np.array(pose).reshape(3, 4)
            cam_from_model = Pose(matrix[:, :3], matrix[:, 3] - matrix[:, :3] @ center)
            solutions.append(FocalPose(focal, cam_from_model, rms, focal * log_sigma))
    return solutions, bool(solutions) or bool((error <= max_rms_px).any())


def _check(xy_centered: ArrayLike, xyz: ArrayLike, max_rms_px: float) -> tuple[Array, Array]:
    xy, points = np.asarray(xy_centered, dtype=float), np.asarray(xyz, dtype=float)
    for name, values, shape in (("xy_centered", xy, (4, 2)), ("xyz", points, (4, 3))):
        if values.shape != shape or not np.isfinite(values).all():
            raise ValueError(f"p4pf: {name} must be finite and {shape}, got {values.shape}: {values.tolist()}")
    if not max_rms_px > 0:
        raise ValueError(f"p4pf: max_rms_px must be > 0, got {max_rms_px}")
    return xy, points


def _best_triangle_first(xyz: Array) -> NDArray[np.intp]:
    """Order of the points in which the first three make the best-shaped triangle."""
    a, b, c = xyz[_ORDERS[:, 0]], xyz[_ORDERS[:, 1]], xyz[_ORDERS[:, 2]]
    normal = np.cross(b - a, c - a)
    longest2 = np.maximum(np.maximum(_dot(b - a, b - a), _dot(c - a, c - a)), _dot(c - b, c - b))
    height2 = _dot(normal, normal) / np.maximum(longest2**2, np.finfo(float).tiny)
    best = int(np.argmax(height2))
    if not height2[best] > (2 * COLLINEAR) ** 2:
        raise DegenerateGeometry(
            "p4pf: the four points are collinear or coincide", ("rotation about the line of the points", "focal length")
        )
    return _ORDERS[best]


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=-1))


def _grid(xy: Array, focal_range_px: tuple[float, float] | None) -> Array:
    size = float(np.hypot(xy[:, 0], xy[:, 1]).max())
    if size == 0.0:
        raise DegenerateGeometry("p4pf: the four image points coincide", ("focal length", "pose"))
    low, high = focal_range_px if focal_range_px is not None else (0.2 * size, 300.0 * size)
    if not 0 < low < high < np.inf:
        raise ValueError(f"p4pf: focal_range_px must be (low, high) with 0 < low < high, got {focal_range_px}")
    return np.geomspace(low, high, int(np.ceil(np.log(high / low) / np.log(_GRID_RATIO))) + 1)
