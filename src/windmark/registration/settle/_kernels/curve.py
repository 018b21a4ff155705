"""How far the fit is from linear within its own sigma, as a numba kernel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.registration._kernels.growth import _move
from windmark.registration.settle._kernels.project import place_cameras, room_for, see
from windmark.registration.settle._kernels.state import Sights, State

Array = NDArray[np.float64]

STEP = 0.1
"""Of the difference quotients, as part of each column."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def curve_kernel(sights: Sights, state: State, columns: Array) -> Array:
    """(Q, Q, P) J'WD_ij for the second derivatives D_ij of all projections along ``columns`` (P, Q) of the unknowns.

    W is the inverse of `State.spread`. ``state`` is scratch: its unknowns are moved, and back again.
    """
    size, count = columns.shape
    by, quotient = _slopes(sights, state), 1.0 / (2.0 * STEP)
    bends = np.zeros((by.shape[0], 2, count, count))
    for i in range(count):
        change = _moved_slopes(sights, state, STEP * columns[:, i])
        change -= _moved_slopes(sights, state, -STEP * columns[:, i])
        for k in range(by.shape[0]):
            for q in range(2):
                for j in range(count):
                    total = 0.0
                    for p in range(size):
                        total += change[k, q, p] * columns[p, j]
                    # A turn after another is not the same in the other order; their mean is the second derivative.
                    bends[k, q, i, j] += 0.5 * quotient * total
                    bends[k, q, j, i] += 0.5 * quotient * total
    out, k = np.zeros((count, count, size)), 0
    for c in range(state.match.shape[0]):
        for m in range(state.match.shape[1]):
            if state.match[c, m] < 0:
                continue
            xx, xy, yy = state.spread[c, m, 0], state.spread[c, m, 1], state.spread[c, m, 2]
            k2 = 1.0 / (xx * yy - xy * xy)
            for p in range(size):
                u, v = by[k, 0, p], by[k, 1, p]
                wu, wv = k2 * (yy * u - xy * v), k2 * (xx * v - xy * u)
                for i in range(count):
                    for j in range(count):
                        out[i, j, p] += wu * bends[k, 0, i, j] + wv * bends[k, 1, i, j]
            k += 1
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _moved_slopes(sights: Sights, state: State, step: Array) -> Array:
    """`_slopes` with the unknowns moved by a step (P,)."""
    rotation, translation = state.rotation.copy(), state.translation.copy()
    nuisance, bent = state.nuisance.copy(), state.bent.copy()
    _move(state.rotation, state.translation, step)
    at = 6
    for c in range(nuisance.shape[0]):
        for p in range(nuisance.shape[1]):
            state.nuisance[c, p] += step[at]
            at += 1
    for p in range(bent.shape[0]):
        state.bent[p] += step[at]
        at += 1
    place_cameras(sights, state)
    out = _slopes(sights, state)
    state.rotation[:], state.translation[:], state.nuisance[:], state.bent[:] = rotation, translation, nuisance, bent
    place_cameras(sights, state)
    return out


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
                    out[k] = by[m, :, :size]
                k += 1
    return out
