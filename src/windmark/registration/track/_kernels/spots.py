"""Spots of one frame as the tracking wants them, as numba kernels; twin: tests/registration/test_track_kernels.py."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point
from windmark.registration._kernels.fit import Spots
from windmark.registration._kernels.raster import plane_covariance_kernel

Array = NDArray[np.float64]

NEIGHBOURS = 4
"""The density of spots is taken from so many neighbours, as in the search (`search.plane`)."""
NEWTON = 20
"""Most steps to invert the lens."""
LEAST_TOLERANCE, TOLERANCE, SPACING = 0.5, 0.004, 0.2
"""Neighbourhood in pixels, as part of the image's diagonal and of the spots' spacing, as in `register`."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def to_plane_kernel(camera: Array, size: Array, xy: Array) -> Array:
    """(M, 2) points of the search plane of image points; NaN where the lens has no inverse (`Camera.unproject`).

    Newton's method from the undistorted place; the derivative of the packed camera is by differences, which costs no
    accuracy, only steps.
    """
    out, f, h = np.empty((xy.shape[0], 2)), camera[0], 1e-6
    close = 1e-10 * math.hypot(size[0], size[1])
    for j in range(xy.shape[0]):
        u, v = (xy[j, 0] - camera[2]) / f, (xy[j, 1] - camera[3]) / (f * camera[1])
        good = False
        for _ in range(NEWTON):
            x, y, valid = project_point(camera, u, v, 1.0)
            if not valid:
                break
            dx, dy = xy[j, 0] - x, xy[j, 1] - y
            if abs(dx) + abs(dy) < close:
                good = True
                break
            xu, yu, ok_u = project_point(camera, u + h, v, 1.0)
            xv, yv, ok_v = project_point(camera, u, v + h, 1.0)
            a, b, c, d = (xu - x) / h, (xv - x) / h, (yu - y) / h, (yv - y) / h
            det = a * d - b * c
            if not (ok_u and ok_v and det > 0.0):
                break
            u += (d * dx - b * dy) / det
            v += (a * dy - c * dx) / det
        out[j, 0], out[j, 1] = (f * u, f * v) if good else (math.nan, math.nan)
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def spots_of(camera: Array, size: Array, p: Array, cov: Array, least_density: float) -> tuple[Spots, float]:
    """The spots (M, 2) of the search plane with what the fit needs, and the usual tolerance among them."""
    m = p.shape[0]
    by_x = np.argsort(p[:, 0], kind="mergesort")
    x, density, nearest = np.empty(m), np.empty(m), np.empty(m)
    for place in range(m):
        x[place] = p[by_x[place], 0]
    average = max(m / (size[0] * size[1]), least_density)
    k = min(NEIGHBOURS, m - 1)
    d2 = np.empty(NEIGHBOURS)
    for place in range(m):
        s = by_x[place]
        d2[:] = np.inf
        for side in (-1, 1):
            other = place + side
            while 0 <= other < m and (x[other] - x[place]) ** 2 < d2[k - 1]:
                q = by_x[other]
                d = (p[q, 0] - p[s, 0]) ** 2 + (p[q, 1] - p[s, 1]) ** 2
                if d < d2[k - 1]:
                    slot = k - 1
                    while slot > 0 and d < d2[slot - 1]:
                        d2[slot] = d2[slot - 1]
                        slot -= 1
                    d2[slot] = d
                other += side
        nearest[s] = math.sqrt(d2[0])
        density[s] = max(average, k / (math.pi * max(d2[k - 1], 1e-6)))
    tolerance = max(LEAST_TOLERANCE, min(TOLERANCE * math.hypot(size[0], size[1]), SPACING * np.median(nearest)))
    return Spots(p, plane_covariance_kernel(camera, p, cov), density, by_x, x, camera, size), tolerance
