"""Corresponding image points of two pictures as rays with covariances: what all estimates of two views work on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.camera import Camera

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Pairs:
    """N pairs; homogeneous points with a last coordinate of 1 and the covariance of the first two.

    Parameters
    ----------
    a, b : (N, 3) rays with z = 1 (or pixels and a 1, for fundamental matrices)
    cov_a, cov_b : (N, 2, 2) in the same unit, squared
    """

    a: Array
    b: Array
    cov_a: Array
    cov_b: Array

    def __len__(self) -> int:
        return len(self.a)

    def __getitem__(self, index: Mask | NDArray[np.int64]) -> Pairs:
        return Pairs(self.a[index], self.b[index], self.cov_a[index], self.cov_b[index])

    def scaled(self, sigma: float) -> Pairs:
        """The same pairs with all standard deviations multiplied."""
        return Pairs(self.a, self.b, self.cov_a * sigma**2, self.cov_b * sigma**2)

    @property
    def finite(self) -> Mask:
        """(N,) pairs whose both points are known."""
        return np.asarray(np.isfinite(self.a).all(axis=1) & np.isfinite(self.b).all(axis=1))


def rays_with_cov(camera: Camera, xy: ArrayLike, cov: ArrayLike | None = None) -> tuple[Array, Array]:
    """Rays of pixels and the covariance of their first two coordinates.

    Parameters
    ----------
    xy : (N, 2) pixels as taken
    cov : (N, 2, 2) or (2, 2) in px^2; None for 1 px^2

    Returns
    -------
    rays : (N, 3) with z = 1, NaN where the lens model has no inverse
    cov : (N, 2, 2) of their x and y, first order, lens included
    """
    p = np.asarray(xy, dtype=float)
    if p.ndim != 2 or p.shape[1] != 2:
        raise ValueError(f"rays_with_cov: xy must be (N, 2), got {p.shape}")
    c = check_cov("rays_with_cov: cov", cov, len(p))
    rays = camera.unproject(p)
    known = np.asarray(np.isfinite(rays).all(axis=1))
    d_xyz = camera.project_jacobian(np.where(known[:, None], rays, [0.0, 0.0, 1.0]))[2]
    to_ray = np.linalg.inv(d_xyz[:, :, :2])
    return rays, to_ray @ c @ np.swapaxes(to_ray, -1, -2)


def pairs_of_pixels(
    xy_a: ArrayLike,
    xy_b: ArrayLike,
    camera_a: Camera,
    camera_b: Camera,
    cov_a: ArrayLike | None,
    cov_b: ArrayLike | None,
) -> Pairs:
    """Pairs (rays) of pixels as taken; checks that both sides have the same number."""
    if np.shape(xy_a) != np.shape(xy_b):
        raise ValueError(
            f"xy_a and xy_b must both be (N, 2), row by row one point, got {np.shape(xy_a)}, {np.shape(xy_b)}"
        )
    a, c_a = rays_with_cov(camera_a, xy_a, cov_a)
    b, c_b = rays_with_cov(camera_b, xy_b, cov_b)
    return Pairs(a, b, c_a, c_b)


def homogeneous_pairs(name: str, a: ArrayLike, b: ArrayLike, cov_a: ArrayLike | None, cov_b: ArrayLike | None) -> Pairs:
    """Pairs of points (N, 2), or rays (N, 3) that are brought to z = 1; without a covariance it is 1 (unit squared)."""
    points = []
    for side, values in (("a", a), ("b", b)):
        p = np.asarray(values, dtype=float)
        if p.ndim != 2 or p.shape[1] not in (2, 3):
            raise ValueError(f"{name}: points of {side} must be (N, 2), or rays (N, 3), got {p.shape}")
        points.append(np.column_stack([p, np.ones(len(p))]) if p.shape[1] == 2 else p / p[:, 2:])
    if len(points[0]) != len(points[1]):
        raise ValueError(f"{name}: as many points are needed in a as in b, got {len(points[0])} and {len(points[1])}")
    c = [check_cov(f"{name}: cov_{side}", v, len(points[0])) for side, v in (("a", cov_a), ("b", cov_b))]
    return Pairs(points[0], points[1], c[0], c[1])


def check_cov(name: str, cov: ArrayLike | None, n: int) -> Array:
    """Covariances (n, 2, 2) from None, one for all or one each."""
    c = np.eye(2) if cov is None else np.asarray(cov, dtype=float)
    if c.shape not in ((2, 2), (n, 2, 2)):
        raise ValueError(f"{name} must be (2, 2) or ({n}, 2, 2), got {c.shape}")
    c = np.broadcast_to(c, (n, 2, 2))
    with np.errstate(invalid="ignore"):
        good = (c[:, 0, 0] > 0) & (c[:, 0, 0] * c[:, 1, 1] - c[:, 0, 1] * c[:, 1, 0] > 0)
    if not good.all():
        raise ValueError(f"{name} must be finite and positive definite")
    return c
