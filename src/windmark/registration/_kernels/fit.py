"""Weighted least squares of a camera pose in the search plane, as numba kernels.

Private to the registration room. The spots' covariances are brought to the search plane (see `_plane`) by the
lens' derivative; the fit there is that of the full camera model, since the lens is straight over the length of a
residual. What the covariances of spots and markers do not explain (table errors, lens, bending) is one more
isotropic variance, the *excess*. Readable twin: tests/registration/test_settle.py.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import cholesky, forward, inverse_factor, solve_factored
from windmark.geometry._jit import nb
from windmark.geometry._kernels import to_camera
from windmark.registration._kernels.growth import PRIOR_WORTH, _derivative, _move

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

MIN_MATCHES = 4
STEPS = 20
"""Most Gauss-Newton steps of a fit."""
TRIM = 0.8
"""The smallest squared lengths of residuals, which are exponential variables, that tell the misfit's variance."""
TRIM_COST = 1.2
"""Its sigma is so much larger for that."""
FOCAL, EXCESS, MISFIT, EXPECTED, ITERATIONS, COST_START, COST_END = range(7)
"""Places in `State.numbers`: focal length, excess and misfit variance, markers expected, steps, cost."""


class Markers(NamedTuple):
    """Markers, centred and scaled to unit size."""

    xyz: Array  # (N, 3)
    normal: Array  # (N, 3), zero where unknown
    sigma: Array  # (N, 3), zero where unknown


class Spots(NamedTuple):
    """Spots in the search plane, and the camera that took them."""

    p: Array  # (M, 2)
    cov: Array  # (M, 3) xx, xy, yy
    density: Array  # (M,) spots per px^2 round the spot
    by_x: NDArray[np.int64]  # (M,) spots in order of their first coordinate
    x: Array  # (M,) that coordinate, in this order
    camera: Array  # (12,) packed
    size: Array  # (2,) of the image
    radius: float  # px, of the spots, see `spot_radius`


@nb.njit(cache=True, nogil=True, error_model="numpy")
def spot_radius(radius: Array) -> float:
    """Median of the radii (M,) of the spots of one image; 0 where none is known."""
    known = radius[np.isfinite(radius)]
    return np.median(known) if known.size else 0.0


class Fit(NamedTuple):
    """What a fit needs to know besides."""

    tolerance: float
    focal_start: float  # centre of the focal length's prior
    focal_weight: float  # 1 / variance of its logarithm; 0: the focal length is known


class State(NamedTuple):
    """A solution, changed in place."""

    rotation: Array  # (3, 3)
    translation: Array  # (3,)
    numbers: Array  # (7,) see FOCAL and the names beside it
    match: Ints  # (N,) spot of every marker or -1
    residual: Array  # (N, 2) projected - seen, of matched markers
    spread: Array  # (N, 3) covariance of the residuals: spot, marker and excess
    factor: Array  # (7, 7) Cholesky factor of the normal equations [rotation, translation, log focal]


def state_of(rotation: Array, translation: Array, focal: float, match: Ints) -> State:
    """A state to start from; the pose of the unit model."""
    n, numbers = len(match), np.zeros(7)
    numbers[FOCAL] = focal
    return State(
        np.array(rotation), np.array(translation), numbers, np.array(match, dtype=np.int32),
        np.zeros((n, 2)), np.zeros((n, 3)), np.zeros((7, 7)),
    )  # fmt: skip


def copy_of(state: State) -> State:
    """A state of its own."""
    arrays: tuple[Any, ...] = tuple(part.copy() for part in state)
    return State(*arrays)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def refine(xyz: Array, spots: Spots, fit: Fit, state: State, table: Array) -> bool:
    """Weighted least squares of the matched markers by Gauss-Newton; False if it is singular or runs away."""
    r, t, a, numbers, match = state.rotation, state.translation, state.factor, state.numbers, state.match
    size = 7 if fit.focal_weight > 0.0 else 6
    g, step = np.empty(7), np.empty(7)
    count = 0
    for m in range(xyz.shape[0]):
        count += match[m] >= 0
    if count < MIN_MATCHES:
        return False
    for _ in range(STEPS):
        f, cost = numbers[FOCAL], 0.0
        g[:] = 0.0
        a[:] = 0.0
        if size == 7:
            off = math.log(fit.focal_start / f)
            a[6, 6], g[6], cost = fit.focal_weight, fit.focal_weight * off, 0.5 * fit.focal_weight * off * off
        cost += add_normal_equations(xyz, spots, state, table, size, a, g)
        if not cholesky(a, size, 1e-12):
            return False
        if numbers[ITERATIONS] == 0.0:
            numbers[COST_START] = cost
        numbers[ITERATIONS] += 1.0
        numbers[COST_END] = cost
        decrease = 0.0
        step[:] = g
        solve_factored(a, step, size)
        for i in range(size):
            decrease += g[i] * step[i]
        if step[0] ** 2 + step[1] ** 2 + step[2] ** 2 > 1.0:
            return False
        # In sigma: the minimum is this far away.
        if decrease < 1e-12:
            break
        _move(r, t, step)
        if size == 7:
            numbers[FOCAL] = f * math.exp(min(0.3, max(-0.3, step[6])))
    residuals(xyz, spots.p, state)
    return decrease < 1e-6


@nb.njit(cache=True, nogil=True, error_model="numpy")
def pose_covariance_kernel(factor: Array, size: int, translation: Array, scale: float, focal: float) -> Array:
    """(size, size) covariance of ``exp(delta) @ pose`` of the model, with a free focal length (size 7) last.

    From the Cholesky factor of the normal equations of the unit model, which is ``scale`` times smaller and turned
    about its centre: that stays where it is.
    """
    half, x, y, z = np.empty((size, size)), translation[0], translation[1], translation[2]
    inverse = inverse_factor(factor, size)
    for k in range(size):
        a, b, c = inverse[k, 0], inverse[k, 1], inverse[k, 2]
        half[0, k], half[1, k], half[2, k] = a, b, c
        half[3, k] = scale * (inverse[k, 3] + y * c - z * b)
        half[4, k] = scale * (inverse[k, 4] + z * a - x * c)
        half[5, k] = scale * (inverse[k, 5] + x * b - y * a)
        if size == 7:
            half[6, k] = focal * inverse[k, 6]  # the unknown is its logarithm
    return half @ half.T


@nb.njit(cache=True, nogil=True, error_model="numpy")
def add_normal_equations(xyz: Array, spots: Spots, state: State, table: Array, size: int, a: Array, g: Array) -> float:
    """Add J'WJ (lower half) to ``a`` and J'W(seen - projected) to ``g``; the cost of the matched markers."""
    r, t, f, match, p, cov = (
        state.rotation, state.translation, state.numbers[FOCAL], state.match, spots.p, spots.cov,
    )  # fmt: skip
    excess, cost, row_u, row_v = state.numbers[EXCESS], 0.0, np.empty(7), np.empty(7)
    for m in range(xyz.shape[0]):
        s = match[m]
        if s < 0:
            continue
        _derivative(r, t, f, xyz[m, 0], xyz[m, 1], xyz[m, 2], row_u, row_v)
        du, dv = p[s, 0] - row_u[6], p[s, 1] - row_v[6]
        xx, xy, yy = cov[s, 0] + table[m, 0] + excess, cov[s, 1] + table[m, 1], cov[s, 2] + table[m, 2] + excess
        k = 1.0 / (xx * yy - xy * xy)
        wuu, wuv, wvv = k * yy, -k * xy, k * xx
        bu, bv = wuu * du + wuv * dv, wuv * du + wvv * dv
        cost += 0.5 * (bu * du + bv * dv)
        for i in range(size):
            g[i] += row_u[i] * bu + row_v[i] * bv
            cu, cv = wuu * row_u[i] + wuv * row_v[i], wuv * row_u[i] + wvv * row_v[i]
            for j in range(i + 1):
                a[i, j] += cu * row_u[j] + cv * row_v[j]
    return cost


@nb.njit(cache=True, nogil=True, error_model="numpy")
def focal_score_kernel(xyz: Array, markers: Markers, spots: Spots, state: State) -> float:
    """Score of the focal length with the pose as nuisance, in sigma; 0 where the view does not determine it.

    With ``L L' = J'WJ`` and the focal length last, the last entry of ``L^-1 J'W(seen - projected)`` is normal with
    sigma 1 where the focal length is right. ``xyz`` (N, 3) are the markers as the solution has them.
    """
    a, g, table = np.zeros((7, 7)), np.zeros(7), np.empty((xyz.shape[0], 3))
    table_spread(markers, state, table)
    add_normal_equations(xyz, spots, state, table, 7, a, g)
    if not cholesky(a, 7, 1e-12):
        return 0.0
    forward(a, g, 7)
    return g[6]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def weigh_residuals(spots: Spots, state: State, table: Array, taken: float) -> None:
    """Covariance of the residuals, and their variance by the redundancy: coordinates less those the fit has taken."""
    squares, count, excess = 0.0, 0, state.numbers[EXCESS]
    for m in range(table.shape[0]):
        s = state.match[m]
        if s < 0:
            continue
        count += 1
        squares += state.residual[m, 0] ** 2 + state.residual[m, 1] ** 2
        state.spread[m, 0] = spots.cov[s, 0] + table[m, 0] + excess
        state.spread[m, 1] = spots.cov[s, 1] + table[m, 1]
        state.spread[m, 2] = spots.cov[s, 2] + table[m, 2] + excess
    state.numbers[MISFIT] = squares / max(2 * count - taken, 1.0)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def excess_of(
    spots: Spots, state: State, table: Array, doubt2: float, luck: float, taken: float
) -> tuple[float, float]:
    """Variance per coordinate beyond the given covariances, and the mean of those of the spots.

    From the smaller four fifths of the squared residuals, so that one false spot in a gate does not open the
    gate for itself; a weak prior, the given covariances and ``doubt2`` beyond them, steadies few pairs. So many sigma
    of the estimate as ``luck`` says are no excess: without it the mean of ``max(0, ...)`` would be one of its own. The
    fit has ``taken`` so many coordinates.
    """
    squares, count, known, noise = np.empty(table.shape[0]), 0, 0.0, 0.0
    for m in range(table.shape[0]):
        s = state.match[m]
        if s >= 0:
            squares[count] = state.residual[m, 0] ** 2 + state.residual[m, 1] ** 2
            noise += 0.5 * (spots.cov[s, 0] + spots.cov[s, 2])
            known += 0.5 * (table[m, 0] + table[m, 2])
            count += 1
    noise /= count
    known = known / count + noise
    kept = math.ceil(TRIM * count)
    squares = np.sort(squares[:count])
    # The j-th smallest of n unit exponentials has the mean 1 / n + 1 / (n - 1) + ... + 1 / (n - j + 1).
    expected = 0.0
    for j in range(kept):
        expected += (kept - j) / (count - j)
    redundancy = max(2 * count - taken, 0.0)
    variance = 0.5 * squares[:kept].sum() / expected * 2 * count / max(redundancy, 1.0)
    pooled = (PRIOR_WORTH * (known + doubt2) + redundancy * variance) / (PRIOR_WORTH + redundancy)
    chance = luck * TRIM_COST * math.sqrt(2.0 * redundancy) / (PRIOR_WORTH + redundancy)
    return max(0.0, pooled - known * (1.0 + chance)), noise


@nb.njit(cache=True, nogil=True, error_model="numpy")
def table_spread(markers: Markers, state: State, out: Array) -> None:
    """Covariance of the projections by the markers' sigma."""
    r, t, f, u, v = state.rotation, state.translation, state.numbers[FOCAL], np.empty(7), np.empty(7)
    for m in range(out.shape[0]):
        sx, sy, sz = markers.sigma[m, 0], markers.sigma[m, 1], markers.sigma[m, 2]
        out[m] = 0.0
        if sx == 0.0 and sy == 0.0 and sz == 0.0:
            continue
        _derivative(r, t, f, markers.xyz[m, 0], markers.xyz[m, 1], markers.xyz[m, 2], u, v)
        for k in range(3):
            s = markers.sigma[m, k]
            du = s * (u[3] * r[0, k] + u[5] * r[2, k])
            dv = s * (v[4] * r[1, k] + v[5] * r[2, k])
            out[m, 0] += du * du
            out[m, 1] += du * dv
            out[m, 2] += dv * dv


@nb.njit(cache=True, nogil=True, error_model="numpy")
def residuals(xyz: Array, p: Array, state: State) -> None:
    """Projected - seen of the matched markers."""
    r, t, f = state.rotation, state.translation, state.numbers[FOCAL]
    for m in range(xyz.shape[0]):
        s = state.match[m]
        if s >= 0:
            x, y, z = to_camera(r, t, xyz[m, 0], xyz[m, 1], xyz[m, 2])
            state.residual[m, 0], state.residual[m, 1] = f * x / z - p[s, 0], f * y / z - p[s, 1]
