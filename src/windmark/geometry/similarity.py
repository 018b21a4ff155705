"""Similarity (or rigid) alignment of two sets of corresponding points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.pose import Pose

Array = NDArray[np.float64]

_FLAT = 1e-9  # width over length of a point set below which it is a line


@dataclass(frozen=True)
class Similarity:
    """``x_target = scale * rotation @ x_source + translation``.

    Parameters
    ----------
    scale : > 0, target length units per source length unit
    rotation : (3, 3), determinant +1
    translation : (3,) in target units
    rms : weighted root mean square distance (3-D) of aligned to target points, target units; 0 if made by hand
    """

    scale: float
    rotation: Array
    translation: Array
    rms: float = 0.0

    __array_ufunc__ = None  # `similarity @ array` is a TypeError

    def __post_init__(self) -> None:
        if not (np.isfinite(self.scale) and self.scale > 0):
            raise ValueError(f"Similarity: scale must be finite and > 0, got {self.scale}")
        pose = Pose(self.rotation, self.translation)  # checks shapes, finiteness and that it is a rotation
        if pose.rotation.ndim != 2:
            raise ValueError(f"Similarity: expected one rotation (3, 3), got {pose.rotation.shape}")
        object.__setattr__(self, "scale", float(self.scale))
        object.__setattr__(self, "rotation", pose.rotation)
        object.__setattr__(self, "translation", pose.translation)

    def apply(self, xyz: ArrayLike) -> Array:
        """Transform points (..., 3)."""
        p = np.asarray(xyz, dtype=float)
        if p.shape[-1:] != (3,):
            raise ValueError(f"Similarity.apply: expected points (..., 3), got {p.shape}")
        return self.scale * (p @ self.rotation.T) + self.translation

    def moved(self, cam_from_source: Pose) -> Pose:
        """Poses (...,) of the same cameras in the target frame and its length unit: the same pictures."""
        rotation = cam_from_source.rotation @ self.rotation.T
        # Camera coordinates grow by the scale, too.
        return Pose(rotation, self.scale * cam_from_source.translation - rotation @ self.translation)

    def inverse(self) -> Similarity:
        """Source-from-target; its rms is in source units."""
        rt = self.rotation.T
        return Similarity(1 / self.scale, rt, -(rt @ self.translation) / self.scale, self.rms / self.scale)

    def __matmul__(self, other: Similarity) -> Similarity:
        """Composition ``a_from_b @ b_from_c``; it fits no points, so its rms is 0."""
        if not isinstance(other, Similarity):
            return NotImplemented
        return Similarity(self.scale * other.scale, self.rotation @ other.rotation, self.apply(other.translation), 0.0)

    @property
    def pose(self) -> Pose:
        """The same as a rigid `Pose`.

        Raises
        ------
        ValueError
            When the scale is not 1 (to 1e-9).
        """
        if abs(self.scale - 1) > 1e-9:
            raise ValueError(
                f"Similarity.pose: only a similarity of scale 1 is a pose, this one has scale {self.scale}"
            )
        return Pose(self.rotation, self.translation)


def align(source: ArrayLike, target: ArrayLike, *, weights: ArrayLike | None = None, scale: bool = True) -> Similarity:
    """Similarity that takes ``source`` onto ``target`` with the smallest weighted sum of squared distances.

    A mirrored set is never matched by a reflection: the best rotation is found instead and ``rms`` tells.

    Parameters
    ----------
    source, target : (N, 3) corresponding points, N >= 3, not collinear; rows that are NaN in either are left out
    weights : (N,) >= 0, for example 1 / sigma^2; None for equal weights
    scale : estimate the scale, or keep it at 1 (rigid)

    Raises
    ------
    ValueError
        Shapes that do not fit, negative weights.
    DegenerateGeometry
        Fewer than three points with weight, coincident or collinear points, or a target so close to a mirror image
        of the source that several rotations fit equally well.

    References
    ----------
    Umeyama, Least-squares estimation of transformation parameters between two point patterns, PAMI 1991.
    """
    x, y, w = _points(source, target, weights)
    cx, cy = w @ x, w @ y
    dx, dy = x - cx, y - cy
    _check_spread("source", dx, w, cx)
    _check_spread("target", dy, w, cy)
    u, s, vt = np.linalg.svd((w[:, None] * dy).T @ dx)
    sign = 1.0 if np.linalg.det(u @ vt) > 0 else -1.0
    if s[1] + sign * s[2] <= _FLAT * s[0]:
        raise DegenerateGeometry(
            "align: several rotations fit equally well (the sets are mirror images, or unrelated)", ("rotation",)
        )
    u[:, 2] *= sign
    r = u @ vt
    k = float((s[0] + s[1] + sign * s[2]) / np.sum(w[:, None] * dx * dx)) if scale else 1.0
    rms = float(np.sqrt(np.sum(w[:, None] * (k * dx @ r.T - dy) ** 2)))
    return Similarity(k, r, cy - k * r @ cx, rms)


def _points(source: ArrayLike, target: ArrayLike, weights: ArrayLike | None) -> tuple[Array, Array, Array]:
    x, y = np.asarray(source, dtype=float), np.asarray(target, dtype=float)
    if x.ndim != 2 or x.shape[1] != 3 or x.shape != y.shape:
        raise ValueError(f"align: source and target must both be (N, 3), got {x.shape} and {y.shape}")
    w = np.ones(len(x)) if weights is None else np.asarray(weights, dtype=float)
    if w.shape != (len(x),) or not (w >= 0).all() or np.isinf(w).any():
        raise ValueError(f"align: weights must be finite, >= 0 and ({len(x)},), got {w.shape}")
    good = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1) & (w > 0)
    if good.sum() < 3:
        raise DegenerateGeometry(
            f"align: at least three points are needed, got {int(good.sum())} with finite coordinates and weight > 0",
            ("rotation",),
        )
    return x[good], y[good], w[good] / w[good].sum()


def _check_spread(name: str, d: Array, w: Array, center: Array) -> None:
    s = np.linalg.svd(np.sqrt(w)[:, None] * d, compute_uv=False)
    if s[0] <= 1e-13 * np.abs(center).max():
        raise DegenerateGeometry(f"align: the points of {name} coincide", ("rotation", "scale"))
    if s[1] <= _FLAT * s[0]:
        raise DegenerateGeometry(f"align: the points of {name} are collinear", ("rotation about their line",))
