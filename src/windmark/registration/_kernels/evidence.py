"""The false-alarm number of a labelling, as numba kernels; its likelihood is in `settle._kernels.worth`.

Both compare "the spots are images of the markers" with "the spots are where they are by chance", with the *local*
density of spots, because dust and rivets come in clusters.

The false-alarm number is that of a-contrario methods (Desolneux, Moisan and Morel; Moisan, Moulon and Monasse 2012).
A pose is fixed by s pairs (three; four with unknown focal length). Of all the ways to choose them, count those that
would by chance have k - s more spots within the k-th smallest probability; the scale is not given but taken where
this is smallest, for the price of having looked at every k.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]

MIN_RADIUS_PX = 0.1
"""Residuals below this are luck, not evidence."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def log10_nfa(
    residual: Array, density: Array, expected: int, markers: int, spots: int, fixed: int, log_share: float
) -> float:
    """A-contrario false-alarm number, base 10; ``fixed`` pairs determine the pose, ``log_share`` is the prior's.

    residual (K, 2) and density (K,) of the matched ones among so many spots.
    """
    count = residual.shape[0]
    if count <= fixed or spots < fixed:
        return math.inf
    chance = np.empty(count)
    for k in range(count):
        distance = max(math.hypot(residual[k, 0], residual[k, 1]), MIN_RADIUS_PX)
        chance[k] = math.log(min(1.0, math.pi * distance * distance * density[k]))
    chance = np.sort(chance)
    tests = math.log(4.0) + _log_choose(markers, fixed) + log_share + math.log(expected)
    tests += math.lgamma(spots + 1.0) - math.lgamma(spots - fixed + 1.0)
    best = math.inf
    for k in range(fixed + 1, count + 1):
        best = min(best, tests + _log_choose(expected - fixed, k - fixed) + (k - fixed) * chance[k - 1])
    return best / math.log(10.0)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _log_choose(n: int, k: int) -> float:
    return math.lgamma(n + 1.0) - math.lgamma(k + 1.0) - math.lgamma(n - k + 1.0)
