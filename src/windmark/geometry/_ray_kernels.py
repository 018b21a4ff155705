"""Numba kernel of `geometry.rays`: the rays of a camera's pixels. Its readable twin is `Camera.unproject`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import _lens

Array = NDArray[np.float64]


@nb.njit(cache=True, nogil=True)
def pixel_rays(from_pixels: Array, camera: Array, max_s: float, plain: bool, first_row: int, rays: Array) -> None:
    """Ideal coordinates of the pixel centres of consecutive rows, (rows, width, 2).

    Newton's method from the parabola through the three pixels above, so that one step is mostly
    enough (above and not to the left: neighbours in a row can then be computed together); NaN where
    it does not reach a point at which the lens is one to one (the caller asks `Camera.unproject`
    there). ``from_pixels`` is the homography from pixels to distorted coordinates, ``camera`` is packed (without a
    lens where ``plain``), ``max_s`` the squared ideal radius up to which it is one to one.
    """
    h = from_pixels
    for i in range(rays.shape[0]):
        y = first_row + i
        row = rays[i]
        for j in range(rays.shape[1]):
            w = 1.0 / (h[2, 0] * j + h[2, 1] * y + h[2, 2])
            q = (h[0, 0] * j + h[0, 1] * y + h[0, 2]) * w
            r = (h[1, 0] * j + h[1, 1] * y + h[1, 2]) * w
            if plain:
                row[j, 0], row[j, 1] = q, r
                continue
            u, v = q, r
            if i > 2 and not math.isnan(rays[i - 3, j, 0] + rays[i - 2, j, 0] + rays[i - 1, j, 0]):
                u = 3.0 * (rays[i - 1, j, 0] - rays[i - 2, j, 0]) + rays[i - 3, j, 0]
                v = 3.0 * (rays[i - 1, j, 1] - rays[i - 2, j, 1]) + rays[i - 3, j, 1]
            row[j, 0], row[j, 1] = _undistort(camera, max_s, q, r, u, v)


@nb.njit(cache=True, nogil=True)
def undistort_points(camera: Array, distorted: Array, ideal: Array) -> None:
    """Ideal points (N, 2) of distorted ones (N, 2), NaN where Newton's method finds none from there."""
    for n in range(len(distorted)):
        q, r = distorted[n, 0], distorted[n, 1]
        ideal[n, 0], ideal[n, 1] = _undistort(camera, camera[11], q, r, q, r)


@nb.njit(cache=True, nogil=True)
def _undistort(camera: Array, max_s: float, q: float, r: float, u: float, v: float) -> tuple[float, float]:
    """The ideal point of the distorted point (q, r), started at (u, v); NaN where not found."""
    for _ in range(20):
        s = u * u + v * v
        ud, vd, jxx, jxy, jyy = _lens(camera, u, v, s)
        det = jxx * jyy - jxy * jxy
        if not (s < max_s and det > 0.0):
            return math.nan, math.nan
        eu, ev = ud - q, vd - r
        inverse = 1.0 / det
        du = (jyy * eu - jxy * ev) * inverse
        dv = (jxx * ev - jxy * eu) * inverse
        u -= du
        v -= dv
        # The step after one of 1e-9 would be about its square: below rounding.
        if abs(du) + abs(dv) < 1e-9:
            if u * u + v * v < max_s:
                return u, v
            return math.nan, math.nan
    return math.nan, math.nan
