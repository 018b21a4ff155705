"""What misfit that is smooth over the image does to the unknowns, as a numba kernel."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.registration.settle._kernels.project import see, sight_of
from windmark.registration.settle._kernels.state import EXCESS, Sights, State
from windmark.registration.settle._kernels.worth import smooth_part

Array = NDArray[np.float64]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def smooth_cov_kernel(sights: Sights, state: State, cov: Array) -> Array:
    """Covariance (P', P') of the unknowns, from the one that takes all misfit for random.

    The likeliest split of each camera's excess into a random part and a smooth one (`worth.smooth_part`) has the
    covariance S of the residuals; the estimate with the weights W has C J'W S W J C.
    """
    size, cameras = cov.shape[0], state.match.shape[0]
    u, v, by_xyz, other = np.empty(size), np.empty(size), np.empty((2, 3)), np.empty(12)
    middle, any_ = np.zeros((size, size)), False
    for c in range(cameras):
        at, basis, part = smooth_part(sights, state, c)
        if part <= 0.0:
            continue
        any_ = True
        excess = state.numbers[c, EXCESS]
        pulls = np.zeros((2 * basis.shape[1], size))
        xyz, modes, bend, rot, turn, rot_c, shift_c, cam, loose, offset = sight_of(sights, state, c)
        for k in range(at.shape[0]):
            m = at[k]
            see(
                m, xyz, modes, bend, rot, turn, rot_c, shift_c, cam, loose, offset, c, u, v, by_xyz, other
            )  # fmt: skip
            xx, xy, yy = state.spread[c, m, 0], state.spread[c, m, 1], state.spread[c, m, 2]
            k2 = 1.0 / (xx * yy - xy * xy)
            for i in range(size):
                wu, wv = k2 * (yy * u[i] - xy * v[i]), k2 * (xx * v[i] - xy * u[i])
                for j in range(i + 1):
                    # The random part of the excess is smaller by what is smooth.
                    cu, cv = k2 * (yy * u[j] - xy * v[j]), k2 * (xx * v[j] - xy * u[j])
                    middle[i, j] -= part * excess * (wu * cu + wv * cv)
                for b in range(basis.shape[1]):
                    pulls[2 * b, i] += basis[k, b] * wu
                    pulls[2 * b + 1, i] += basis[k, b] * wv
        for i in range(size):
            for j in range(i + 1):
                total = 0.0
                for b in range(pulls.shape[0]):
                    total += pulls[b, i] * pulls[b, j]
                middle[i, j] += part * excess * total
    out = cov.copy()
    if not any_:
        return out
    for i in range(size):
        for j in range(i):
            middle[j, i] = middle[i, j]
    change = cov @ middle @ cov
    # Never less than with random misfit: the split is itself an estimate.
    for i in range(size):
        if change[i, i] < 0.0:
            change[i, :] = 0.0
            change[:, i] = 0.0
    if math.isfinite(change.sum()):
        out += change
    return out
