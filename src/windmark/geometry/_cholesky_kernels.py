"""Small symmetric systems for the kernels of several rooms: private to windmark."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def cholesky(a: Array, size: int, least: float) -> bool:
    """Lower Cholesky factor in place; False if a column adds less than ``least`` of itself to those before."""
    for i in range(size):
        floor = least * a[i, i]
        for j in range(i + 1):
            s = a[i, j]
            for k in range(j):
                s -= a[i, k] * a[j, k]
            if i == j:
                if not s > floor:
                    return False
                a[i, i] = math.sqrt(s)
            else:
                a[i, j] = s / a[j, j]
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def forward(a: Array, g: Array, size: int) -> None:
    """Replace g by the solution of ``a x = g`` with a lower triangle."""
    for i in range(size):
        for k in range(i):
            g[i] -= a[i, k] * g[k]
        g[i] /= a[i, i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def solve_factored(a: Array, g: Array, size: int) -> None:
    """Replace g by the solution of ``a a' x = g``."""
    forward(a, g, size)
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            g[i] -= a[k, i] * g[k]
        g[i] /= a[i, i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def solved(a: Array, g: Array, size: int, least: float) -> bool:
    """`cholesky` of ``a`` and the solution in ``g``, both in place; False if a column adds less than ``least``."""
    if not cholesky(a, size, least):
        return False
    solve_factored(a, g, size)
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def inverse_factor(a: Array, size: int) -> Array:
    """Inverse of a lower triangle."""
    out = np.zeros((size, size))
    for i in range(size):
        out[i, i] = 1.0 / a[i, i]
        for j in range(i):
            total = 0.0
            for k in range(j, i):
                total += a[i, k] * out[k, j]
            out[i, j] = -total * out[i, i]
    return out
