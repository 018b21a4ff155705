"""Smoothing thin-plate spline as a Gaussian process: the least bending that the marks' noise allows.

``y = d0 + d1 u + d2 v + sum c_k phi(|u - u_k|) + noise`` with phi = r^2 ln r, for x and y alike. How much bending and
how much noise there is, is what makes the marks most probable (restricted maximum likelihood); the noise is never less
than that of the marks, so the spline does not interpolate it.

Source: Wahba, Spline models for observational data, SIAM 1990 (sections 1.3, 4.9); Wood, J. R. Stat. Soc. B 73, 2011.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import minimize_scalar

from windmark.geometry.planar import bases

Array = NDArray[np.float64]

_SPAN = (-12.0, 12.0)
"""Natural logarithm of noise over bending, about the middle one of the data, that is searched."""


@dataclass(frozen=True)
class SplineFit:
    """Parameters (2 (M + 3),), kriging matrix, misfit, residuals; see `PlanarFit`."""

    parameters: Array
    cov: Array
    misfit_px: float
    residual: Array
    held_out: Array
    freedom: float
    evidence: Array
    weighted: float


def fit_spline(u: Array, y: Array, variance: Array) -> SplineFit:
    """Smoothing spline of values (N, 2) at normalised places (N, 2), with the variance (N,) of each value, px^2."""
    count = len(u)
    linear = np.column_stack([np.ones(count), u])
    relative = np.maximum(variance, 1e-12) / np.mean(np.maximum(variance, 1e-12))
    # Contrasts that no plane explains: their part of the kernel is positive definite (the spline's bending energy).
    z = np.linalg.qr(linear, mode="complete")[0][:, 3:]
    kernel = bases.plate(u, u)
    lower = np.linalg.cholesky(z.T @ (relative[:, None] * z))
    half = solve_triangular(lower, z.T @ kernel @ z, lower=True)
    stiff, turned = np.linalg.eigh(solve_triangular(lower, half.T, lower=True))
    stiff = np.maximum(stiff, 0.0)
    v = z @ solve_triangular(lower, turned, lower=True, trans="T")
    seen = v.T @ y
    mean = float(np.mean(np.maximum(variance, 1e-12)))
    ratio, bending = _smoothing(stiff, seen, mean)
    inverse = 1.0 / (stiff + ratio)
    diagonal = (v**2) @ inverse
    weights = v @ (inverse[:, None] * seen)
    held = -weights / diagonal[:, None]
    residual = -ratio * relative[:, None] * weights
    # What is left after the weights' part is a plane.
    plane = np.linalg.lstsq(linear, y + residual - kernel @ weights, rcond=None)[0]
    system = np.zeros((count + 3, count + 3))
    system[:count, :count] = kernel + ratio * np.diag(relative)
    system[:count, count:], system[count:, :count] = linear, linear.T
    parameters = np.concatenate([plane, weights]).T.ravel()
    freedom = 6.0 + 2.0 * float((stiff * inverse).sum())
    evidence = (weights**2).sum(axis=1) / diagonal / bending
    misfit = np.sqrt(max(ratio * bending - mean, 0.0))
    cov = np.asarray(bending * np.linalg.inv(system), dtype=float)
    return SplineFit(parameters, cov, float(misfit), residual, held, freedom, evidence,
                     float((seen**2 * inverse[:, None]).sum() / bending))  # fmt: skip


def _smoothing(stiff: Array, seen: Array, variance: float) -> tuple[float, float]:
    """Noise over bending, and bending (variance of the process), by restricted maximum likelihood."""
    free = 2 * len(stiff)
    middle = float(np.log(max(np.median(stiff), 1e-300)))

    def bending(ratio: float) -> float:
        return max(float((seen**2 / (stiff + ratio)[:, None]).sum()) / free, 1e-30)

    def badness(log_ratio: float) -> float:
        ratio = np.exp(log_ratio)
        return float(2 * np.log(stiff + ratio).sum() + free * np.log(bending(ratio)))

    def with_known_noise(log_ratio: float) -> float:
        """The same with the marks' own noise: bending = variance / ratio."""
        ratio = np.exp(log_ratio)
        size = variance / ratio
        square = (seen**2 / (stiff + ratio)[:, None]).sum() / size
        return float(2 * np.log(stiff + ratio).sum() + free * np.log(size) + square)

    best = _least(badness, middle)
    if best * bending(best) < variance:
        best = _least(with_known_noise, middle)
        return best, variance / best
    return best, bending(best)


def _least(badness: Callable[[float], float], middle: float) -> float:
    """Where a function of the logarithm is least: a coarse look, then a fine one."""
    grid = middle + np.linspace(*_SPAN, 25)
    k = int(np.argmin([badness(g) for g in grid]))
    low, high = grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)]
    return float(np.exp(minimize_scalar(badness, bounds=(low, high), method="bounded", options={"xatol": 1e-3}).x))
