"""What the pairs tell of all unknowns, each residual in its own sigmas, as a numba kernel."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.registration.settle._kernels.project import place_cameras, room_for, see
from windmark.registration.settle._kernels.state import Sights, State

Array = NDArray[np.float64]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def slopes_kernel(sights: Sights, state: State, modes: Array, size: float) -> tuple[Array, Array]:
    """Derivatives (R, P + K) of the projections of all pairs and (R,) seen - projected, whitened by `State.spread`.

    ``modes`` (N, 3, K) are deformations besides the state's own unknowns, in units of ``size``; of each marker those of
    one coordinate lie side by side, so they are gone through four or eight at once. Two rows for each pair, zero where
    the marker has no image. Their products are the normal equations of `doubt.doubt_kernel`, which BLAS forms in a
    fraction of the time.
    """
    own, (cameras, n), (xy, by) = state.factor.shape[0], state.match.shape, room_for(state)
    bends, pairs = modes.shape[2], 0
    for s in state.match.flat:
        pairs += 1 if s >= 0 else 0
    rows, off, k = np.zeros((2 * pairs, own + bends)), np.zeros(2 * pairs), 0
    place_cameras(sights, state)
    for c in range(cameras):
        match, spread, residual = state.match[c], state.spread[c], state.residual[c]
        see(sights, state, c, match >= 0, xy, by)
        for m in range(n):
            if match[m] < 0:
                continue
            if not math.isnan(xy[m, 0]):
                # The lower Cholesky factor of the residual's covariance, inverted: u / a and (v - b u / a) / d.
                a = math.sqrt(spread[m, 0])
                b = spread[m, 1] / a
                d = math.sqrt(spread[m, 2] - b * b)
                lean = b / (a * d)
                for i in range(own):
                    rows[k, i] = by[m, 0, i] / a
                    rows[k + 1, i] = by[m, 1, i] / d - lean * by[m, 0, i]
                off[k], off[k + 1] = -residual[m, 0] / a, lean * residual[m, 0] - residual[m, 1] / d
                for q in range(2):
                    ux, uy, uz = size * by[m, q, own], size * by[m, q, own + 1], size * by[m, q, own + 2]
                    if q == 0:
                        px, py, pz = ux / a, uy / a, uz / a
                        qx, qy, qz = lean * ux, lean * uy, lean * uz
                    else:
                        px, py, pz = ux / d - qx, uy / d - qy, uz / d - qz
                    row = rows[k + q, own:]
                    for j in range(bends):
                        row[j] = px * modes[m, 0, j] + py * modes[m, 1, j] + pz * modes[m, 2, j]
            k += 2
    return rows, off
