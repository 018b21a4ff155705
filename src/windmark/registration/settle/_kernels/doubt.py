"""What else than the pose the residuals speak for, to first order: other cameras, a bent model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.registration.settle._kernels.project import place_cameras, see, sight_of
from windmark.registration.settle._kernels.state import Sights, State

Array = NDArray[np.float64]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def doubt_kernel(sights: Sights, state: State) -> tuple[Array, Array]:
    """Normal equations of all unknowns at a state that is settled without some of them: J'WJ and J'W(seen - projected).

    Without the priors. The residuals' covariance is the state's own (`State.spread`).
    """
    size, (cameras, n) = state.factor.shape[0], state.match.shape
    a, g = np.zeros((size, size)), np.zeros(size)
    u, v, by_xyz, other = np.empty(size), np.empty(size), np.empty((2, 3)), np.empty(12)
    place_cameras(sights, state)
    for c in range(cameras):
        match, spread, residual = state.match[c], state.spread[c], state.residual[c]
        xyz, modes, bend, rot, turn, rot_c, shift_c, cam, loose, offset = sight_of(sights, state, c)
        for m in range(n):
            if match[m] < 0:
                continue
            if not see(
                m, xyz, modes, bend, rot, turn, rot_c, shift_c, cam, loose, offset, c, u, v, by_xyz, other
            )[2]:  # fmt: skip
                continue
            xx, xy, yy = spread[m, 0], spread[m, 1], spread[m, 2]
            k2 = 1.0 / (xx * yy - xy * xy)
            du, dv = -residual[m, 0], -residual[m, 1]
            for i in range(size):
                cu, cv = k2 * (yy * u[i] - xy * v[i]), k2 * (xx * v[i] - xy * u[i])
                g[i] += cu * du + cv * dv
                for j in range(i + 1):
                    a[i, j] += cu * u[j] + cv * v[j]
    for i in range(size):
        for j in range(i):
            a[j, i] = a[i, j]
    return a, g
