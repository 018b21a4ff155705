"""What else than the pose the residuals speak for, to first order: other cameras, a bent model."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import cholesky, forward
from windmark.geometry._jit import nb
from windmark.registration.settle._kernels.project import place_cameras, room_for, see
from windmark.registration.settle._kernels.state import Sights, State

Array = NDArray[np.float64]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def doubt_kernel(sights: Sights, state: State) -> tuple[Array, Array]:
    """Normal equations of all unknowns at a state that is settled without some of them: J'WJ and J'W(seen - projected).

    Without the priors. The residuals' covariance is the state's own (`State.spread`).
    """
    size, (cameras, n) = state.factor.shape[0], state.match.shape
    a, g, (xy, by) = np.zeros((size, size)), np.zeros(size), room_for(state)
    place_cameras(sights, state)
    for c in range(cameras):
        match, spread, residual = state.match[c], state.spread[c], state.residual[c]
        see(sights, state, c, match >= 0, xy, by)
        for m in range(n):
            if math.isnan(xy[m, 0]):
                continue
            xx, xy_, yy = spread[m, 0], spread[m, 1], spread[m, 2]
            k2 = 1.0 / (xx * yy - xy_ * xy_)
            du, dv = -residual[m, 0], -residual[m, 1]
            for i in range(size):
                u, v = by[m, 0, i], by[m, 1, i]
                cu, cv = k2 * (yy * u - xy_ * v), k2 * (xx * v - xy_ * u)
                g[i] += cu * du + cv * dv
                for j in range(i + 1):
                    a[i, j] += cu * by[m, 0, j] + cv * by[m, 1, j]
    for i in range(size):
        for j in range(i):
            a[j, i] = a[i, j]
    return a, g


@nb.njit(cache=True, nogil=True, error_model="numpy")
def reduce_kernel(normal: Array, side: Array, asked: NDArray[np.int64]) -> tuple[Array, Array]:
    """Normal equations (M, M), (M,) of the unknowns that are ``asked`` about, all others eliminated; zero where these
    are singular. Others but the pose (the first six) have a unit normal prior.
    """  # fmt: skip
    size, count = side.shape[0], asked.shape[0]
    rest = np.empty(size - count, np.int64)
    is_asked, k = np.zeros(size, np.bool_), 0
    for i in asked:
        is_asked[i] = True
    for i in range(size):
        if not is_asked[i]:
            rest[k] = i
            k += 1
    own, out, pull = np.empty((k, k)), np.zeros((count, count)), np.zeros(count)
    for i in range(k):
        for j in range(i + 1):
            own[i, j] = normal[rest[i], rest[j]]
        if rest[i] >= 6:
            own[i, i] += 1.0
    if not cholesky(own, k, 1e-14):
        return out, pull
    across, towards = np.empty((count, k)), np.empty(k)
    for i in range(k):
        towards[i] = side[rest[i]]
        for j in range(count):
            across[j, i] = normal[rest[i], asked[j]]
    forward(own, towards, k)
    for j in range(count):
        forward(own, across[j], k)
    for i in range(count):
        pull[i] = side[asked[i]]
        for r in range(k):
            pull[i] -= across[i, r] * towards[r]
        for j in range(i + 1):
            out[i, j] = normal[asked[i], asked[j]]
            for r in range(k):
                out[i, j] -= across[i, r] * across[j, r]
            out[j, i] = out[i, j]
    return out, pull


@nb.njit(cache=True, nogil=True, error_model="numpy")
def gain_kernel(normal: Array, side: Array, first: int, last: int) -> float:
    """What unknowns ``first`` to ``last`` of `reduce_kernel`'s gain (nats) if they are free under their priors."""
    size = last - first
    own, pull, total = np.empty((size, size)), side[first:last].copy(), 0.0
    for i in range(size):
        for j in range(i + 1):
            own[i, j] = normal[first + i, first + j]
        own[i, i] = 1.0 + max(own[i, i], 0.0)
    if not cholesky(own, size, 1e-14):
        return -math.inf
    forward(own, pull, size)
    for i in range(size):
        total += 0.5 * pull[i] ** 2 - math.log(own[i, i])
    return total
