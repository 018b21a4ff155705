"""Where a state puts all markers in the images, as a numba kernel."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.registration.settle._kernels.project import see, sight_of
from windmark.registration.settle._kernels.state import Sights, State

Array = NDArray[np.float64]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def places_kernel(sights: Sights, state: State, c: int) -> Array:
    """(N, 2) pixels of all markers in camera c, NaN where they have no image."""
    n, size = state.match.shape[1], state.factor.shape[0]
    out, u, v, by_xyz, other = np.empty((n, 2)), np.empty(size), np.empty(size), np.empty((2, 3)), np.empty(12)
    xyz, modes, bend, rot, turn, rot_c, shift_c, cam, loose, offset = sight_of(sights, state, c)
    for m in range(n):
        x, y, valid = see(
            m, xyz, modes, bend, rot, turn, rot_c, shift_c, cam, loose, offset, c, u, v, by_xyz, other
        )  # fmt: skip
        out[m, 0], out[m, 1] = (x, y) if valid else (math.nan, math.nan)
    return out
