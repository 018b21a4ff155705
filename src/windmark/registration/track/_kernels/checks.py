"""Whether the residuals of a tracked solution speak for a bent model, as numba kernels; as `judge.doubts`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import cholesky, forward
from windmark.geometry._jit import nb
from windmark.registration.settle._kernels.doubt import doubt_kernel
from windmark.registration.settle._kernels.state import EXCESS, Sights, State, wider, with_more

Array = NDArray[np.float64]

PARTS = (1.0, 0.2, 0.04)
"""Sizes of a deformation, as parts of a large one, that are alike before."""
MOST_GAIN = 600.0
"""More nats than a float's exponential can hold are as good as these."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def bending_gain(sights: Sights, modes: Array, state: State) -> float:
    """Evidence (nats) for a smooth deformation against a random excess, to first order.

    ``modes`` (K, N, 3) are of 1 sigma each, of a large deformation; smaller ones are tried, too (`PARTS`). What they
    explain is no excess, so the residuals' variances are taken as they are and as without it. With the unknowns in
    question last, the factor of all normal equations has theirs, the others eliminated, as its last corner.
    """
    supple = with_more(sights, sights.loose, modes)
    wide = wider(supple, state)
    normal, side = doubt_kernel(supple, wide)
    square, least, count = _of_residuals(state)
    size, first = side.shape[0], side.shape[0] - modes.shape[0]
    bent, rigid = 0.0, 0.0
    for noise in (1.0, least):
        by_noise = -0.5 * (square * (1.0 / noise - 1.0) + (2 * count - 6) * math.log(noise))
        rigid += math.exp(by_noise)
        for part in PARTS:
            a, g = normal / noise, side / noise
            for i in range(6, size):
                a[i, i] += 1.0 if i < first else 1.0 / part**2
                g[i] -= wide.nuisance[0, i - 6] if i < first else 0.0
            if not cholesky(a, size, 1e-14):
                return 0.0
            forward(a, g, size)
            gain = by_noise
            for i in range(first, size):
                gain += 0.5 * g[i] ** 2 - math.log(part * a[i, i])
            bent += math.exp(min(gain, MOST_GAIN)) / len(PARTS)
    return math.log(bent / rigid)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _of_residuals(state: State) -> tuple[float, float, int]:
    """Sum of their squares by their covariance, their mean variance without the excess as part of that, and pairs."""
    square, least, count = 0.0, 0.0, 0
    for m in range(state.match.shape[1]):
        if state.match[0, m] >= 0:
            xx, xy, yy = state.spread[0, m, 0], state.spread[0, m, 1], state.spread[0, m, 2]
            u, v = state.residual[0, m, 0], state.residual[0, m, 1]
            square += (yy * u * u - 2.0 * xy * u * v + xx * v * v) / (xx * yy - xy * xy)
            least += 1.0 - 2.0 * state.numbers[0, EXCESS] / (xx + yy)
            count += 1
    return square, max(least / max(count, 1), 1e-6), count
