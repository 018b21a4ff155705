"""The eliminated blocks of the normal equations as a numba kernel. Private to the adjust room."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network._projection_kernels import FAST
from windmark.geometry._jit import nb

Array = NDArray[np.float64]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def factor_blocks(h_ee: Array, floor: Array, damping: float, w: Array, y: Array) -> bool:
    """Cholesky of the damped blocks (E, b, b) in place; L^-1 on the rows of w (E b, D) and on y.

    False where one is not positive definite.
    """
    size = h_ee.shape[1]
    for e in range(h_ee.shape[0]):
        a = h_ee[e]
        for k in range(size):
            a[k, k] += damping * floor[e, k]
        for j in range(size):
            for i in range(j, size):
                t = a[i, j]
                for k in range(j):
                    t -= a[i, k] * a[j, k]
                if i > j:
                    a[i, j] = t / a[j, j]
                elif t > 0.0:
                    a[j, j] = math.sqrt(t)
                else:
                    return False
        for i in range(size):
            row = e * size + i
            for k in range(i):
                q, low = e * size + k, a[i, k]
                y[row] -= low * y[q]
                for d in range(w.shape[1]):
                    w[row, d] -= low * w[q, d]
            back = 1.0 / a[i, i]
            y[row] *= back
            for d in range(w.shape[1]):
                w[row, d] *= back
    return True
