"""Weighted least squares of all unknowns for given labels, and what the residuals say of their own size."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import cholesky, inverse_factor, solve_factored
from windmark.geometry._jit import nb
from windmark.registration._kernels.growth import PRIOR_WORTH, _move
from windmark.registration.settle._kernels.project import place_cameras, room_for, see
from windmark.registration.settle._kernels.rigid import rigid_equations
from windmark.registration.settle._kernels.state import (
    COST_END,
    COST_START,
    DECREASE,
    EXCESS,
    MISFIT,
    STEPS,
    TAKEN,
    Sights,
    State,
)

Array = NDArray[np.float64]

MIN_MATCHES = 4
MOST_STEPS = 20
AT_REST = 1e-10
"""Expected decrease of twice the cost below which a step was the last: the next one would be its square."""
TRIM, TRIM_COST = 0.8, 1.2
"""The smallest squared residuals, which are exponential variables, that tell the misfit's variance; its sigma is so
much larger for that."""
EXCESS_STEPS, FAR_BEYOND = 4, 1e8
"""Times that the pairs are weighed for the excess, more change it by less than its sigma's hundredth; and an excess
(px^2) beside which all given variances are as good as equal."""
LARGEST_TURN = 1.0
"""A step that turns the model by more (radians) runs away."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def refine(sights: Sights, state: State, table: Array, most: int = MOST_STEPS) -> bool:
    """Gauss-Newton on the matched markers, ``most`` steps; False if it is singular, runs away or is not at rest then.

    ``table`` (C, N, 3) is brought up to date: the covariance of the projections by the markers' sigma.
    """
    a, size, open_ = state.factor, state.factor.shape[0], state.nuisance.shape[1]
    cameras, pairs = state.match.shape[0], 0
    for s in state.match.flat:
        pairs += 1 if s >= 0 else 0
    if pairs < MIN_MATCHES:
        return False
    is_rigid = size == 6
    g, decrease, xy, by = np.empty(size), math.inf, np.empty((0, 2)), np.empty((0, 2, 0))
    if not is_rigid:
        xy, by = room_for(state)
    state.report[STEPS] = 0.0
    for _ in range(most):
        place_cameras(sights, state)
        if is_rigid:
            cost = rigid_equations(sights, state, table, a, g)
        else:
            cost = _normal_equations(sights, state, table, xy, by, a, g)
        if not cholesky(a, size, 1e-12):
            return False
        if state.report[STEPS] == 0.0:
            state.report[COST_START] = cost
        state.report[STEPS] += 1.0
        state.report[COST_END] = cost
        if decrease < AT_REST:
            break
        decrease = state.report[DECREASE] = _step(state, a, g, cameras, open_)
        if not decrease < math.inf:
            return False
    return decrease < 1e-6


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _step(state: State, a: Array, g: Array, cameras: int, open_: int) -> float:
    """Apply the Gauss-Newton step; twice the expected decrease of the cost, infinite if it runs away."""
    step, decrease = g.copy(), 0.0
    solve_factored(a, step, a.shape[0])
    for i in range(a.shape[0]):
        decrease += g[i] * step[i]
    if not step[0] ** 2 + step[1] ** 2 + step[2] ** 2 < LARGEST_TURN:
        return math.inf
    _move(state.rotation, state.translation, step)
    for c in range(cameras):
        for p in range(open_):
            state.nuisance[c, p] += min(2.0, max(-2.0, step[6 + c * open_ + p]))
    for k in range(state.bent.shape[0]):
        state.bent[k] += step[6 + cameras * open_ + k]
    return decrease


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _normal_equations(sights: Sights, state: State, table: Array, xy: Array, by: Array, a: Array, g: Array) -> float:
    """J'WJ (lower half) and J'W(seen - projected) with the priors; the cost. Residuals and ``table`` on the way.

    ``xy`` and ``by`` are scratch (`room_for`).
    """
    size, (cameras, n), open_ = g.shape[0], state.match.shape, state.nuisance.shape[1]
    a[:] = 0.0
    g[:] = 0.0
    cost = 0.0
    for c in range(cameras):
        for p in range(open_):
            g[6 + c * open_ + p] = -state.nuisance[c, p]
            cost += 0.5 * state.nuisance[c, p] ** 2
    for k in range(state.bent.shape[0]):
        g[6 + cameras * open_ + k] = -state.bent[k]
        cost += 0.5 * state.bent[k] ** 2
    for i in range(6, size):
        a[i, i] = 1.0
    # Arrays are taken out of their tuples once: that counts references, which costs as much as seeing a marker does.
    spots, noise = sights.xy, sights.cov
    for c in range(cameras):
        excess, first = state.numbers[c, EXCESS], sights.first[c]
        match, residual, own = state.match[c], state.residual[c], table[c]
        see(sights, state, c, match >= 0, xy, by)
        _by_table(sights.sigma, xy, by, own)
        for m in range(n):
            if match[m] < 0:
                continue
            if math.isnan(xy[m, 0]):
                return math.nan
            s = first + match[m]
            du, dv = spots[s, 0] - xy[m, 0], spots[s, 1] - xy[m, 1]
            residual[m, 0], residual[m, 1] = -du, -dv
            xx, xy_, yy = noise[s, 0] + own[m, 0] + excess, noise[s, 1] + own[m, 1], noise[s, 2] + own[m, 2] + excess
            k2 = 1.0 / (xx * yy - xy_ * xy_)
            wuu, wuv, wvv = k2 * yy, -k2 * xy_, k2 * xx
            bu, bv = wuu * du + wuv * dv, wuv * du + wvv * dv
            cost += 0.5 * (bu * du + bv * dv)
            for i in range(size):
                u, v = by[m, 0, i], by[m, 1, i]
                if u == 0.0 and v == 0.0:
                    continue
                g[i] += u * bu + v * bv
                cu, cv = wuu * u + wuv * v, wuv * u + wvv * v
                for j in range(i + 1):
                    a[i, j] += cu * by[m, 0, j] + cv * by[m, 1, j]
    return cost


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _by_table(sigma: Array, xy: Array, by: Array, out: Array) -> None:
    """Covariance xx, xy, yy of the projections of markers that are seen, by their own sigma, into ``out`` (N, 3)."""
    place = by.shape[2] - 3
    for m in range(xy.shape[0]):
        if math.isnan(xy[m, 0]):
            continue
        uu, uv, vv = 0.0, 0.0, 0.0
        for k in range(3):
            u, v = sigma[m, k] * by[m, 0, place + k], sigma[m, k] * by[m, 1, place + k]
            uu += u * u
            uv += u * v
            vv += v * v
        out[m, 0], out[m, 1], out[m, 2] = uu, uv, vv


@nb.njit(cache=True, nogil=True, error_model="numpy")
def spread_places(sights: Sights, state: State) -> None:
    """Covariance of every projection by that of the unknowns (`State.place`), infinite where there is none."""
    cameras, n = state.match.shape
    xy, by = room_for(state)
    inverse, every = inverse_factor(state.factor, state.factor.shape[0]), np.ones(n, np.bool_)
    for c in range(cameras):
        state.place[c, :, 0], state.place[c, :, 2] = math.inf, math.inf
        see(sights, state, c, every, xy, by)
        by_unknowns(inverse, xy, by, state.place[c])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def by_unknowns(inverse: Array, xy: Array, by: Array, out: Array) -> None:
    """Covariance xx, xy, yy of the projections of markers that are seen, by that of the unknowns, into ``out`` (N, 3).

    From the inverse of their Cholesky factor and what `see` says.
    """
    for m in range(xy.shape[0]):
        if math.isnan(xy[m, 0]):
            continue
        uu, uv, vv = 0.0, 0.0, 0.0
        for i in range(inverse.shape[0]):
            u, v = 0.0, 0.0
            for k in range(i + 1):
                u += inverse[i, k] * by[m, 0, k]
                v += inverse[i, k] * by[m, 1, k]
            uu += u * u
            uv += u * v
            vv += v * v
        out[m, 0], out[m, 1], out[m, 2] = uu, uv, vv


@nb.njit(cache=True, nogil=True, error_model="numpy")
def taken_of(sights: Sights, state: State, table: Array, c: int) -> float:
    """Coordinates that the fit has taken of a camera's pairs: the sum of their leverages, from `State.place`."""
    taken, first, noise, match, place = 0.0, sights.first[c], sights.cov, state.match[c], state.place[c]
    own, excess = table[c], state.numbers[c, EXCESS]
    for m in range(match.shape[0]):
        if match[m] >= 0:
            s = first + match[m]
            xx, xy, yy = noise[s, 0] + own[m, 0] + excess, noise[s, 1] + own[m, 1], noise[s, 2] + own[m, 2] + excess
            taken += (yy * place[m, 0] - 2.0 * xy * place[m, 1] + xx * place[m, 2]) / (xx * yy - xy * xy)
    return taken


@nb.njit(cache=True, nogil=True, error_model="numpy")
def excess_of(sights: Sights, state: State, table: Array, c: int, doubt2: float, luck: float) -> tuple[float, float]:
    """Variance per coordinate beyond the given covariances of a camera's pairs, and the (weighted) mean of its spots'.

    From the smaller four fifths of the squared residuals, each by its own variance, so that one false spot in a gate
    does not open the gate for itself; a weak prior, the given covariances and ``doubt2`` beyond them, steadies few
    pairs. So many sigma of the estimate as ``luck`` says are no excess: without it the mean of ``max(0, ...)`` would be
    one of its own. Without pairs it is only doubted.
    """
    n, first, taken = table.shape[1], sights.first[c], state.numbers[c, TAKEN]
    match, residual, own, cov = state.match[c], state.residual[c], table[c], sights.cov
    squares, given, noises, ratios, count = np.empty(n), np.empty(n), np.empty(n), np.empty(n), 0
    for m in range(n):
        if match[m] >= 0:
            s = first + match[m]
            squares[count] = 0.5 * (residual[m, 0] ** 2 + residual[m, 1] ** 2)
            noises[count] = 0.5 * (cov[s, 0] + cov[s, 2])
            given[count] = noises[count] + 0.5 * (own[m, 0] + own[m, 2])
            count += 1
    if count == 0:
        return doubt2, 0.0
    squares, given = squares[:count], given[:count]
    kept = math.ceil(TRIM * count)
    # The j-th smallest of n unit exponentials has the mean 1 / n + 1 / (n - 1) + ... + 1 / (n - j + 1).
    expected = 0.0
    for j in range(kept):
        expected += (kept - j) / (count - j)
    redundancy = max(2 * count - taken, 0.0)
    unit = expected * max(redundancy, 1.0) / (2 * count)
    # By the residuals in their own sigmas: in a plain mean of the given variances that of one vague spot hides the
    # excess of all others. At first all pairs count alike; where their variances are equal that is the last step.
    excess, known, noise = FAR_BEYOND, 0.0, 0.0
    for _ in range(EXCESS_STEPS):
        total, known, noise, least = 0.0, 0.0, 0.0, max(excess, 0.0) + 1e-300
        for k in range(count):
            weight = 1.0 / (given[k] + least)
            ratios[k] = weight * squares[k]
            total += weight
            known += weight * given[k]
            noise += weight * noises[k]
        known /= total
        noise /= total
        excess = np.sort(ratios[:count])[:kept].sum() / unit * (known + least) - known
    pooled = (PRIOR_WORTH * doubt2 + redundancy * excess) / (PRIOR_WORTH + redundancy)
    chance = luck * TRIM_COST * math.sqrt(2.0 * redundancy) / (PRIOR_WORTH + redundancy)
    return max(0.0, pooled - known * chance), noise


@nb.njit(cache=True, nogil=True, error_model="numpy")
def weigh_residuals(sights: Sights, state: State, table: Array) -> None:
    """Covariance of the residuals, and their variance by the redundancy: coordinates less those the fit has taken."""
    for c in range(table.shape[0]):
        squares, count, excess, first = 0.0, 0, state.numbers[c, EXCESS], sights.first[c]
        match, residual, spread, own, cov = state.match[c], state.residual[c], state.spread[c], table[c], sights.cov
        for m in range(match.shape[0]):
            if match[m] < 0:
                continue
            s = first + match[m]
            count += 1
            squares += residual[m, 0] ** 2 + residual[m, 1] ** 2
            spread[m, 0] = cov[s, 0] + own[m, 0] + excess
            spread[m, 1] = cov[s, 1] + own[m, 1]
            spread[m, 2] = cov[s, 2] + own[m, 2] + excess
        state.numbers[c, MISFIT] = squares / max(2 * count - state.numbers[c, TAKEN], 1.0)
