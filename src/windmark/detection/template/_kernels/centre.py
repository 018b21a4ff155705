"""What a finished template fit says of its centre: covariance, influence of the pixels, signal. Private."""

from __future__ import annotations

import math
from typing import Any

from windmark.detection.template._kernels.algebra import solve
from windmark.geometry._jit import nb


@nb.njit(cache=True, nogil=True, error_model="numpy")
def center_map(p: Any, multiplicative: float, shift: Any, cov: Any, rows: Any) -> None:
    """From the uncoupled centre c' to the disc's c = c' + (blur^2 + 1/12) slope / light(c').

    `shift` (2, 1) = c - c'; `cov` becomes that of c, ...; `rows` (2, 10) are the derivatives of c times the
    covariance before.
    """
    light = max(1.0 + multiplicative * (p[8] * p[0] + p[9] * p[1]), 0.05)
    reach = multiplicative * (p[5] * p[5] + 1.0 / 12.0) / light
    for i in range(2):
        shift[i, 0] = reach * p[8 + i]
        for k in range(10):
            rows[i, k] = cov[i, k] + multiplicative * 2.0 * p[5] / light * p[8 + i] * cov[5, k] + reach * cov[8 + i, k]
            for m in range(2):
                rows[i, k] -= shift[i, 0] / light * (p[8 + m] * cov[m, k] + p[m] * cov[8 + m, k])
    for i in range(2):
        for k in range(2, 10):
            cov[i, k] = rows[i, k]
            cov[k, i] = rows[i, k]
    for i in range(2):
        for k in range(2):
            total = rows[i, k] + multiplicative * 2.0 * p[5] / light * p[8 + k] * rows[i, 5] + reach * rows[i, 8 + k]
            for m in range(2):
                total -= shift[k, 0] / light * (p[8 + m] * rows[i, m] + p[m] * rows[i, 8 + m])
            cov[i, k] = total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def influences(
    patch: Any, p: Any, multiplicative: float, jac: Any, res: Any, rows: Any, noise2: float, out: Any
) -> None:
    """Influence of each pixel on x and y, residual and model image (4, S, S); `jac`, `res` carry the root of the
    weight.
    """
    half = patch.shape[0] // 2
    for j in range(patch.shape[0]):
        for i in range(patch.shape[0]):
            root = jac[7, j, i] / (1.0 + multiplicative * (p[8] * (i - half) + p[9] * (j - half)))
            for k in range(2):
                total = 0.0
                for m in range(10):
                    total += rows[k, m] * jac[m, j, i]
                out[k, j, i] = root * total / noise2
            out[2, j, i] = res[j, i] / root if root > 0.0 else 0.0
            out[3, j, i] = patch[j, i] - out[2, j, i] if root > 0.0 else 0.0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def signal(u: Any, matrix: Any, held: Any, work: Any, rhs: Any, step: Any) -> float:
    """Sum of squares that the disc explains and a plane does not."""
    for k in range(10):
        held[k] = k < 7
        rhs[k] = matrix[k, 6]
    if not solve(matrix, rhs, 0.0, held, work, step):
        return math.nan
    total = matrix[6, 6]
    for k in range(7, 10):
        total -= matrix[6, k] * step[k]
    return u[6] * u[6] * total
