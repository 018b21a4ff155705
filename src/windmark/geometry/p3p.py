"""Perspective-three-point: all camera poses that see three known points along three known rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.errors import COLLINEAR, DegenerateGeometry
from windmark.geometry.pose import Pose

Array = NDArray[np.float64]


@dataclass(frozen=True)
class P3PSolutions:
    """Solutions of one problem or of a batch of shape (...).

    Parameters
    ----------
    rotation, translation : (..., 4, 3, 3) and (..., 4, 3), cam_from_model, NaN where there are fewer than four
    count : (...) number of solutions, 0 to 4; the solutions come first. A double solution may be listed twice.
    degenerate : (...) bool, the three points are collinear or coincide (or are not finite): no solution given
    """

    rotation: Array
    translation: Array
    count: NDArray[np.int64]
    degenerate: NDArray[np.bool_]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(..., 4) which of the four places hold a solution."""
        return np.arange(4) < self.count[..., None]

    def poses(self, index: int | tuple[int, ...] = ()) -> list[Pose]:
        """The poses of one problem: of the single one, or of the one at ``index`` of the batch."""
        count = self.count[index]
        if np.ndim(count) != 0:
            raise ValueError(
                f"P3PSolutions.poses: expected the index of one problem of {self.count.shape}, got {index}"
            )
        return [Pose(self.rotation[index][k], self.translation[index][k]) for k in range(int(count))]


def p3p(rays: ArrayLike, xyz: ArrayLike) -> P3PSolutions:
    """All poses with ``R xyz_i + t = depth_i ray_i`` and depth_i > 0, for i = 1, 2, 3.

    Every real solution is returned, up to four, polished to rounding. Of two solutions that meet (camera on
    the danger cylinder) the accuracy is the square root of the rounding, by nature of the problem.

    Parameters
    ----------
    rays : (..., 3, 3) rows are directions in the camera frame, of any length (`Camera.unproject` fits)
    xyz : (..., 3, 3) rows are the points in the model frame; the leading axes broadcast against those of rays

    Returns
    -------
    P3PSolutions
        Empty (``count`` 0) where no pose fits. In a batch, degenerate triangles are marked, not raised.

    Raises
    ------
    ValueError
        Wrong shape; for a single problem also values that are not finite or a ray of length zero.
    DegenerateGeometry
        For a single problem: the three points are collinear or coincide.

    References
    ----------
    Persson and Nordberg, Lambda Twist, ECCV 2018; Ding et al., Revisiting the P3P problem, CVPR 2023.
    """
    from windmark.geometry._p3p_kernels import p3p_batch_kernel

    y, x = np.asarray(rays, dtype=float), np.asarray(xyz, dtype=float)
    for name, values in (("rays", y), ("xyz", x)):
        if values.shape[-2:] != (3, 3):
            raise ValueError(f"p3p: {name} must be (..., 3, 3), rows are points, got {values.shape}")
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        y = y / np.linalg.norm(y, axis=-1, keepdims=True)
        degenerate = _degenerate(x)
    if y.ndim == x.ndim == 2:
        _check_single(y, x, bool(degenerate))
    shape = np.broadcast_shapes(y.shape[:-2], x.shape[:-2])
    # What is broadcast may not be written to: a type of its own, for which the kernel would be compiled anew.
    y, x = (np.require(np.broadcast_to(v, (*shape, 3, 3)), requirements=("C", "W")).reshape(-1, 3, 3) for v in (y, x))
    rotation, translation, count = np.empty((len(y), 4, 3, 3)), np.empty((len(y), 4, 3)), np.empty(len(y), np.int64)
    p3p_batch_kernel(y, x, rotation, translation, count)
    return P3PSolutions(
        rotation.reshape(*shape, 4, 3, 3),
        translation.reshape(*shape, 4, 3),
        count.reshape(shape),
        np.broadcast_to(degenerate, shape) | ~np.isfinite(y).all(axis=(-1, -2)).reshape(shape),
    )


def _degenerate(xyz: Array) -> NDArray[np.bool_]:
    a, b, c = xyz[..., 0, :], xyz[..., 1, :], xyz[..., 2, :]
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=-1)
    edges = np.stack([b - a, c - a, c - b])
    return np.asarray(~(area > COLLINEAR * np.sum(edges * edges, axis=-1).max(axis=0)))


def _check_single(rays: Array, xyz: Array, degenerate: bool) -> None:
    if not np.isfinite(rays).all():
        raise ValueError(f"p3p: rays must be finite and not zero, got directions {rays.tolist()}")
    if not np.isfinite(xyz).all():
        raise ValueError(f"p3p: xyz must be finite, got {xyz.tolist()}")
    if degenerate:
        raise DegenerateGeometry(
            "p3p: the three points are collinear or coincide", ("rotation about the line of the points",)
        )
