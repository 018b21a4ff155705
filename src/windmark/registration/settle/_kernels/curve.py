"""How far the fit is from linear within its own sigma, as a numba kernel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import cholesky, inverse_factor
from windmark.geometry._jit import nb
from windmark.registration._kernels.growth import _move
from windmark.registration.settle._kernels.project import place_cameras, room_for, see
from windmark.registration.settle._kernels.state import Sights, State

Array = NDArray[np.float64]

STEP = 0.1
"""Of the difference quotients, as part of each column."""
POSE = 6
"""Unknowns of the pose, along which the second order is looked at."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def curve_kernel(sights: Sights, state: State, cov: Array) -> Array:
    """(P, P) half the sum of K_ij K_ij' for K_ij = -C J'W D_ij, from the covariance C of the unknowns; see
    `judge.answer.curvature`.

    D_ij are the second derivatives of all projections along the columns of a root of the covariance that the pose has
    with all other unknowns as they are, W is the inverse of `State.spread`. The unknowns of ``state`` are moved, and
    back again.
    """  # fmt: skip
    size, columns = cov.shape[0], _columns(state.factor)
    pulls, out = _pulls(sights, state, columns), np.zeros((size, size))
    moved = np.empty(size)
    for i in range(POSE):
        for j in range(i + 1):
            for p in range(size):
                moved[p] = 0.0
                for q in range(size):
                    moved[p] -= pulls[i, j, q] * cov[q, p]
            # Of ``exp(delta) @ pose`` the shift is that of the unknowns less half of turn x shift, besides the first
            # order; of either order of the two.
            for axis in range(3):
                one, two = (axis + 1) % 3, (axis + 2) % 3
                for a, b in ((i, j), (j, i)):
                    turned = columns[one, a] * columns[3 + two, b] - columns[two, a] * columns[3 + one, b]
                    moved[3 + axis] -= 0.5 * turned
            # Those with i and j exchanged are the same.
            weight = 0.5 if i == j else 1.0
            for p in range(size):
                for q in range(size):
                    out[p, q] += weight * moved[p] * moved[q]
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _columns(factor: Array) -> Array:
    """(P, POSE) lower root of the covariance of the pose with the other unknowns as they are, zero for these."""
    inverse, columns = inverse_factor(factor, POSE), np.zeros((factor.shape[0], POSE))
    for i in range(POSE):
        for j in range(i + 1):
            for k in range(i, POSE):
                columns[i, j] += inverse[k, i] * inverse[k, j]
    if not cholesky(columns, POSE, 0.0):
        columns[:] = np.nan
    return columns


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _pulls(sights: Sights, state: State, columns: Array) -> Array:
    """(Q, Q, P) J'WD_ij for the second derivatives D_ij of all projections along ``columns`` (P, Q); its lower half."""
    size, count = columns.shape
    by, bends = _slopes(sights, state), _bends(sights, state, columns)
    out, k = np.zeros((count, count, size)), 0
    for c in range(state.match.shape[0]):
        for m in range(state.match.shape[1]):
            if state.match[c, m] < 0:
                continue
            xx, xy, yy = state.spread[c, m, 0], state.spread[c, m, 1], state.spread[c, m, 2]
            k2 = 1.0 / (xx * yy - xy * xy)
            for i in range(count):
                for j in range(i + 1):
                    u, v = bends[k, 0, i, j], bends[k, 1, i, j]
                    wu, wv = k2 * (yy * u - xy * v), k2 * (xx * v - xy * u)
                    for p in range(size):
                        out[i, j, p] += wu * by[k, 0, p] + wv * by[k, 1, p]
            k += 1
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _bends(sights: Sights, state: State, columns: Array) -> Array:
    """(K, 2, Q, Q) second derivatives of the projections of all pairs along ``columns`` (P, Q); the lower half."""
    (cameras, n), count, (xy, by) = state.match.shape, columns.shape[1], room_for(state)
    rotation, translation = state.rotation.copy(), state.translation.copy()
    bends = np.zeros(((state.match >= 0).sum(), 2, count, count))
    for i in range(count):
        for way in (1.0, -1.0):
            _move(state.rotation, state.translation, way * STEP * columns[:, i])
            place_cameras(sights, state)
            # A turn after another is not the same in the other order; their mean is the second derivative.
            k, own, other = 0, way / (2.0 * STEP), way / (4.0 * STEP)
            for c in range(cameras):
                match = state.match[c]
                see(sights, state, c, match >= 0, xy, by)
                for m in range(n):
                    if match[m] < 0:
                        continue
                    for q in range(2):
                        if np.isnan(xy[m, 0]):
                            continue
                        for j in range(count):
                            total = 0.0
                            for p in range(j, POSE):  # a root that is lower, and of the pose alone
                                total += by[m, q, p] * columns[p, j]
                            bends[k, q, max(i, j), min(i, j)] += (own if i == j else other) * total
                    k += 1
            state.rotation[:], state.translation[:] = rotation, translation
    place_cameras(sights, state)
    return bends


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _slopes(sights: Sights, state: State) -> Array:
    """(K, 2, P) derivatives of the projections of all pairs; zero where a marker has no image."""
    size, (cameras, n), (xy, by) = state.factor.shape[0], state.match.shape, room_for(state)
    out, k = np.zeros(((state.match >= 0).sum(), 2, size)), 0
    for c in range(cameras):
        see(sights, state, c, state.match[c] >= 0, xy, by)
        for m in range(n):
            if state.match[c, m] >= 0:
                if not np.isnan(xy[m, 0]):
                    for q in range(2):
                        for p in range(size):
                            out[k, q, p] = by[m, q, p]
                k += 1
    return out
