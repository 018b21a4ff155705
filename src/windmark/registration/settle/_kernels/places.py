"""Where a state puts the markers in the images, and which of them the pairs leave open, as numba kernels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.registration.settle._kernels.project import room_for, see
from windmark.registration.settle._kernels.state import Sights, State

Array = NDArray[np.float64]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def places_kernel(sights: Sights, state: State, c: int) -> Array:
    """(N, 2) pixels of all markers in camera c, NaN where they have no image."""
    xy, by = room_for(state)
    see(sights, state, c, np.ones(xy.shape[0], np.bool_), xy, by)
    return xy


@nb.njit(cache=True, nogil=True, error_model="numpy")
def open_kernel(state: State, placed: Array) -> None:
    """`State.open`: which places are most open, with ``placed`` (C, N, 3) the covariance of the projections.

    Without its pair the projection of a marker has the covariance N D^-1 N - N, D = N - S, for the noise N and the
    projection's covariance S (see `label.leave_one_out`).
    """
    for c in range(state.match.shape[0]):
        state.open[c, 0], state.open[c, 1], state.open[c, 2], state.open[c, 3] = _open_of(state, placed, c)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _open_of(state: State, placed: Array, c: int) -> tuple[int, float, int, float]:
    """Of one camera."""
    rest, rest_px, pair, pair_px = -1, 0.0, -1, 0.0
    for m in range(state.match.shape[1]):
        sxx, sxy, syy = placed[c, m, 0], placed[c, m, 1], placed[c, m, 2]
        if state.match[c, m] < 0:
            if state.faces[c, m]:
                wide = math.sqrt(widest(sxx, sxy, syy))
                if not wide <= rest_px or rest < 0:
                    rest, rest_px = m, wide if math.isfinite(wide) else math.inf
            continue
        xx, xy, yy = state.spread[c, m, 0], state.spread[c, m, 1], state.spread[c, m, 2]
        a, b, d = xx - sxx, xy - sxy, yy - syy
        # D^-1 by its eigenvectors: where it is singular, the pair alone holds the place.
        angle, floor = 0.5 * math.atan2(2.0 * b, a - d), 1e-9 * (xx + yy)
        cos, sin = math.cos(angle), math.sin(angle)
        half = math.hypot(0.5 * (a - d), b)
        high, low = max(0.5 * (a + d) + half, floor), max(0.5 * (a + d) - half, floor)
        ux, uy, vx, vy = xx * cos + xy * sin, xy * cos + yy * sin, xy * cos - xx * sin, yy * cos - xy * sin
        lxx, lxy = ux * ux / high + vx * vx / low - xx, ux * uy / high + vx * vy / low - xy
        wide = math.sqrt(max(0.0, widest(lxx, lxy, uy * uy / high + vy * vy / low - yy)))
        if not wide <= pair_px or pair < 0:
            pair, pair_px = m, wide
    return rest, rest_px, pair, pair_px


@nb.njit(cache=True, nogil=True, error_model="numpy")
def widest(xx: float, xy: float, yy: float) -> float:
    """The larger eigenvalue."""
    return 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)
