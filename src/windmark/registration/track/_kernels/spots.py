"""The spots of one frame as the settle wants them, as numba kernels; twin: tests/registration/test_track_kernels.py."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.registration.settle._kernels.state import NUMBERS, REPORT, Sights, State

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

NEIGHBOURS = 4
"""The density of spots is taken from so many neighbours, as in the search (`search.plane`); see `_with`."""
LEAST_TOLERANCE, TOLERANCE, SPACING = 0.5, 0.004, 0.2
"""Neighbourhood in pixels, as part of the image's diagonal and of the spots' spacing, as in `register`."""


class Columns(NamedTuple):
    """Where in the order by x spots are: a table is faster than a search by halves, by 20 ns for each question."""

    first: Ints  # (C + 1,) place of the first spot in every column or right of it
    left: float  # where the first column begins
    per_px: float  # columns per pixel


@nb.njit(cache=True, nogil=True, error_model="numpy")
def sights_of(
    xyz: Array, normal: Array, sigma: Array, camera: Array, loose: Array, size: Array, xy: Array, cov: Array,
    radius: Array, given_tolerance: float, rough: float, least_density: float,
) -> tuple[Sights, Columns]:  # fmt: skip
    """One camera's sight of rigid markers; its spots are (M, 2), with (M, 2, 2) covariance, of (M,) radius.

    A ``given_tolerance`` of 0 takes the usual one, for a table with so much `roughness`.
    """
    m = xy.shape[0]
    by_x, x, y, columns = _in_order(xy)
    density, nearest, fourth, packed = np.empty(m), np.empty(m), np.empty(m), np.empty((m, 3))
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
        s = by_x[place]
        nearest[s], fourth[s] = math.sqrt(d2[0]), math.sqrt(d2[k - 1])
        density[s] = max(average, k / (math.pi * max(d2[k - 1], 1e-6)))
        packed[s, 0], packed[s, 1], packed[s, 2] = cov[s, 0, 0], cov[s, 0, 1], cov[s, 1, 1]
    tolerance = given_tolerance
    if not tolerance > 0.0:
        wanted = TOLERANCE * math.hypot(size[0], size[1])
        if rough > 0.0:
            wanted = max(wanted, rough * np.median(fourth))
        tolerance = max(LEAST_TOLERANCE, min(wanted, SPACING * np.median(nearest)))
    known = radius[np.isfinite(radius)]
    sights = Sights(
        xyz, normal, sigma, np.zeros((0, xyz.shape[0], 3)), np.eye(3).reshape(1, 3, 3), np.zeros((1, 3)),
        np.array([0, m]), xy, packed, density, by_x, x, size.reshape(1, 2),
        np.array([np.median(known) if known.size else 0.0]), np.array([tolerance]), camera.reshape(1, 16), loose,
    )  # fmt: skip
    return sights, columns


@nb.njit(cache=True, nogil=True)
def room(sights: Sights, modes: int) -> State:
    """An empty state of one camera, with so many coefficients of a deformation."""
    n, open_ = sights.xyz.shape[0], sights.loose.shape[2]
    size = 6 + open_ + modes
    return State(
        np.eye(3), np.zeros(3), np.zeros((1, open_)), np.zeros(modes), sights.camera.copy(), np.zeros((1, 3, 3)),
        np.zeros((1, 3)), np.zeros((1, NUMBERS)), np.zeros(REPORT), np.full((1, n), -1, np.int32), np.zeros((1, n, 2)),
        np.zeros((1, n, 3)), np.zeros((1, n, 3)), np.zeros((1, n), np.bool_), np.zeros((1, n), np.bool_),
        np.zeros((1, n), np.bool_), np.zeros((1, n, 2)), np.full((1, n), -1, np.int32), np.zeros((size, size)),
    )  # fmt: skip


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
