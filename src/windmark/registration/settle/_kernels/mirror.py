"""Which mirror images of a solution its residuals allow, as a numba kernel."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.registration.settle._kernels.fit import refine
from windmark.registration.settle._kernels.state import EXCESS, Sights, State

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

GLANCE, HOPELESS = 3, 6.0
"""After so many steps, residuals of so many times what is allowed do not come down to it."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def mirrors_kernel(
    sights: Sights, best: State, state: State, onto: Ints, turn: Array, shift: Array, reach: Array
) -> NDArray[np.bool_]:
    """Whether each of B mirror images leaves residuals (their median) within ``reach`` (C,), in every camera.

    ``sights`` has the mirrored table; with image b the spots of marker m are those of marker ``onto[b, m]`` (of none:
    -1), and the model is seen from where ``turn`` (B, 3, 3) and ``shift`` (B, 3) put it. ``state`` is scratch.
    """
    cameras, n = best.match.shape
    out, table, away = np.zeros(onto.shape[0], np.bool_), np.zeros((cameras, n, 3)), np.empty(n)
    for b in range(onto.shape[0]):
        start(best, state, onto[b], turn[b], shift[b])
        refine(sights, state, table, GLANCE)
        if _loosest(state, reach, away) < HOPELESS and refine(sights, state, table):
            out[b] = _loosest(state, reach, away) <= 1.0
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _loosest(state: State, reach: Array, away: Array) -> float:
    """Median residual of the worst camera, in units of its ``reach``; ``away`` (N,) is scratch."""
    worst = 0.0
    for c in range(state.match.shape[0]):
        count, match, residual = 0, state.match[c], state.residual[c]
        for m in range(match.shape[0]):
            if match[m] >= 0:
                away[count] = math.hypot(residual[m, 0], residual[m, 1])
                count += 1
        if count > 0:
            worst = max(worst, np.median(away[:count]) / reach[c])
    return worst


@nb.njit(cache=True, nogil=True, error_model="numpy")
def start(best: State, state: State, onto: Ints, turn: Array, shift: Array) -> None:
    """Begin ``state`` as a mirror image of a solution; markers that stand for what that does not see are hidden."""
    cameras, n = best.match.shape
    state.match[:], state.hidden[:] = -1, False
    state.nuisance[:], state.bent[:] = 0.0, 0.0
    for i in range(3):
        state.translation[i] = best.translation[i]
        for j in range(3):
            state.rotation[i, j] = 0.0
            for k in range(3):
                state.rotation[i, j] += best.rotation[i, k] * turn[j, k]
    for i in range(3):
        for j in range(3):
            state.translation[i] -= state.rotation[i, j] * shift[j]
    for c in range(cameras):
        state.numbers[c, EXCESS] = best.numbers[c, EXCESS]
        for m in range(n):
            if onto[m] >= 0:
                state.match[c, onto[m]] = best.match[c, m]
                state.hidden[c, onto[m]] = not (best.faces[c, m] or best.match[c, m] >= 0)
