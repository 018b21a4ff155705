"""Spots of one frame as the tracking wants them, as numba kernels; twin: tests/registration/test_track_kernels.py."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point
from windmark.registration._kernels.fit import Spots, spot_radius

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

NEIGHBOURS = 4
"""The density of spots is taken from so many neighbours, as in the search (`search.plane`); see `_with`."""
NEWTON = 20
"""Most steps to invert the lens."""
LEAST_TOLERANCE, TOLERANCE, SPACING = 0.5, 0.004, 0.2
"""Neighbourhood in pixels, as part of the image's diagonal and of the spots' spacing, as in `register`."""


class Columns(NamedTuple):
    """Where in the order by x spots are: a table is faster than a search by halves, by 20 ns for each question."""

    first: Ints  # (C + 1,) place of the first spot in every column or right of it
    left: float  # where the first column begins
    per_px: float  # columns per pixel


@nb.njit(cache=True, nogil=True, error_model="numpy")
def to_plane_kernel(camera: Array, size: Array, xy: Array, spot_cov: Array) -> tuple[Array, Array]:
    """Image points (M, 2) in the search plane, NaN where the lens has no inverse (`Camera.unproject`).

    And their covariances (M, 2, 2) there, as (M, 3) xx, xy, yy. Newton's method from the undistorted place; the
    derivative of the packed camera is by differences, which costs no accuracy of the points, only steps. That of the
    last step, less than 0.01 px away, brings the covariance over.
    """
    out, cov, f, h = np.empty((xy.shape[0], 2)), np.empty((xy.shape[0], 3)), camera[0], 1e-6
    close = 1e-10 * math.hypot(size[0], size[1])
    for j in range(xy.shape[0]):
        u, v = (xy[j, 0] - camera[2]) / f, (xy[j, 1] - camera[3]) / (f * camera[1])
        good, det = False, 0.0
        a, b, c, d = 1.0, 0.0, 0.0, 1.0
        for _ in range(NEWTON):
            x, y, valid = project_point(camera, u, v, 1.0)
            if not valid:
                break
            dx, dy = xy[j, 0] - x, xy[j, 1] - y
            good = abs(dx) + abs(dy) < close
            if good and det > 0.0:
                break
            xu, yu, ok_u = project_point(camera, u + h, v, 1.0)
            xv, yv, ok_v = project_point(camera, u, v + h, 1.0)
            a, b, c, d = (xu - x) / h, (xv - x) / h, (yu - y) / h, (yv - y) / h
            det = a * d - b * c
            if good or not (ok_u and ok_v and det > 0.0):
                break
            u += (d * dx - b * dy) / det
            v += (a * dy - c * dx) / det
        out[j, 0], out[j, 1] = (f * u, f * v) if good else (math.nan, math.nan)
        # At the last point that the lens can invert the difference may fail; spots are not blown up there.
        a, b, c, d = (f * d / det, -f * b / det, -f * c / det, f * a / det) if det > 0.0 else (1.0, 0.0, 0.0, 1.0)
        xx, xy_, yy = spot_cov[j, 0, 0], spot_cov[j, 0, 1], spot_cov[j, 1, 1]
        cov[j, 0] = a * a * xx + 2.0 * a * b * xy_ + b * b * yy
        cov[j, 1] = a * c * xx + (a * d + b * c) * xy_ + b * d * yy
        cov[j, 2] = c * c * xx + 2.0 * c * d * xy_ + d * d * yy
    return out, cov


@nb.njit(cache=True, nogil=True, error_model="numpy")
def spots_of(
    camera: Array, size: Array, p: Array, cov: Array, radius: Array, least_density: float, rough: float
) -> tuple[Spots, Columns, float]:
    """The spots (M, 2) of the search plane, covariance (M, 3), with what the fit needs, and the usual tolerance.

    ``radius`` are those of all spots of the image, ``rough`` is the table's `roughness`.
    """
    m = p.shape[0]
    by_x, x, y, columns = _in_order(p)
    density, nearest, fourth = np.empty(m), np.empty(m), np.empty(m)
    average = max(m / (size[0] * size[1]), least_density)
    k = min(NEIGHBOURS, m - 1)
    for place in range(m):
        d2 = (math.inf, math.inf, math.inf, math.inf)
        for other in range(place + 1, m):
            if not (x[other] - x[place]) ** 2 < d2[3]:
                break
            d2 = _with((x[other] - x[place]) ** 2 + (y[other] - y[place]) ** 2, d2)
        for other in range(place - 1, -1, -1):
            if not (x[other] - x[place]) ** 2 < d2[3]:
                break
            d2 = _with((x[other] - x[place]) ** 2 + (y[other] - y[place]) ** 2, d2)
        nearest[by_x[place]], fourth[by_x[place]] = math.sqrt(d2[0]), math.sqrt(d2[k - 1])
        density[by_x[place]] = max(average, k / (math.pi * max(d2[k - 1], 1e-6)))
    wanted = TOLERANCE * math.hypot(size[0], size[1])
    if rough > 0.0:
        wanted = max(wanted, rough * np.median(fourth))
    tolerance = max(LEAST_TOLERANCE, min(wanted, SPACING * np.median(nearest)))
    return Spots(p, cov, density, by_x, x, camera, size, spot_radius(radius)), columns, tolerance


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _with(new: float, d2: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """The four smallest of five, in order, without a branch: which of them goes cannot be foreseen."""
    a, b, c, d = d2
    a, new = min(a, new), max(a, new)
    b, new = min(b, new), max(b, new)
    c, new = min(c, new), max(c, new)
    return a, b, c, min(d, new)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _in_order(p: Array) -> tuple[NDArray[np.int64], Array, Array, Columns]:
    """Points (M, 2) in order of x (stable), and columns, twice as many: sorted by column first, then within it."""
    m = p.shape[0]
    by_x, x, y, first = np.empty(m, np.int64), np.empty(m), np.empty(m), np.zeros(2 * m + 1, np.int32)
    left, right = p[0, 0], p[0, 0]
    for s in range(m):
        left, right = min(left, p[s, 0]), max(right, p[s, 0])
    per_px = 2 * m / max(right - left, 1e-9) * (1.0 - 1e-12)  # the last point is within the last column
    for s in range(m):
        first[int((p[s, 0] - left) * per_px) + 1] += 1
    for column in range(2 * m):
        first[column + 1] += first[column]
    for s in range(m):  # every entry moves on to where the next column begins ...
        column = int((p[s, 0] - left) * per_px)
        by_x[first[column]] = s
        first[column] += 1
    for column in range(2 * m, 0, -1):  # ... and is moved back
        first[column] = first[column - 1]
    first[0] = 0
    for place in range(m):
        s, k = by_x[place], place
        while k > 0 and x[k - 1] > p[s, 0]:
            x[k], y[k], by_x[k] = x[k - 1], y[k - 1], by_x[k - 1]
            k -= 1
        x[k], y[k], by_x[k] = p[s, 0], p[s, 1], s
    return by_x, x, y, Columns(first, left, per_px)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def place_of(columns: Columns, x: float) -> int:
    """A place in the order by x that no spot at ``x`` or right of it comes before, and few spots left of it after."""
    column, count = (x - columns.left) * columns.per_px, columns.first.shape[0] - 1
    if not column > 0.0:
        return 0
    return columns.first[int(column)] if column < count else columns.first[count]
