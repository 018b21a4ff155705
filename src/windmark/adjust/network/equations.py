"""Normal equations of a network, solved by a Schur complement.

The blocks of one group (points, or frames) touch no other block of it, so they leave the system first:
S = H_dd - H_de H_ee^-1 H_ed (Brown 1958; Triggs et al. 2000, section 6.1). Fields of markers are seen from
almost everywhere, so S is dense: it is formed by one symmetric rank-k update and solved by Cholesky.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

from windmark.adjust.network.gauge import Gauge
from windmark.adjust.network.linear import factor_blocks, single_thread
from windmark.adjust.problem import Step

Array = NDArray[np.float64]


class NetworkEquations:
    """Quadratic model of the cost about one point, in natural units.

    Parameters
    ----------
    cost : half the sum of the losses
    h_dd : (D, D) upper triangle of the information of the dense parameters
    h_ed : (E b, D) between eliminated and dense
    h_ee : (E, b, b) of the eliminated blocks
    g_d, g_e : (D,), (E b,) gradient
    motions : gives the motions that nothing sees, when asked
    hold : (D, k) what holds them, see `gauge.stabiliser`; from any state of the same network
    """

    def __init__(
        self, cost: float, h: tuple[Array, Array, Array], g: tuple[Array, Array], motions: Callable[[], Gauge],
        hold: Array,
    ) -> None:  # fmt: skip
        self.cost = cost
        self.h_dd, self.h_ed, self.h_ee = h
        self.g_d, self.g_e = g
        self._motions, self._hold = motions, hold
        self._undamped: tuple[Array, Array, Array, Array] | None = None
        blocks, size = self.h_ee.shape[:2]
        # Marquardt's scaling, not below one natural unit: as in `NormalEquations`.
        self._floor_d = np.maximum(np.diagonal(self.h_dd), 1.0)
        diagonal = self.h_ee[:, np.arange(size), np.arange(size)]
        self._floor_e = np.ascontiguousarray(np.maximum(diagonal, 1.0).reshape(blocks, size))

    def solve(self, damping: float) -> Step | None:
        """Step that minimises the model plus Marquardt's term; None where the matrix is not positive definite."""
        with single_thread(len(self.g_d)):
            factored = self.factor(damping)
            if factored is None:
                return None
            if damping == 0.0:
                self._undamped = factored
            lower, w, y, s = factored
            d = lapack.dpotrs(s, -(self.g_d - w.T @ y), lower=1)[0] if len(self.g_d) else np.zeros(0)
            e = self._back(lower, y + w @ d)
        along = float(self.g_d @ d + self.g_e @ e)
        damped = float(d @ (self._floor_d * d)) + float(e @ (self._floor_e.ravel() * e))
        size = max(float(np.abs(d).max(initial=0.0)), float(np.abs(e).max(initial=0.0)))
        return Step(np.concatenate([d, e]), size, 0.5 * (damping * damped - along))

    def decrement(self, other: NetworkEquations) -> float:
        """See `levenberg_marquardt.System`: |L^-1 g_e| and |L_S^-1 (g_d - W^T L^-1 g_e)|, squared and added."""
        if self._undamped is None:
            return float("inf")
        lower, w, _, s = self._undamped
        with single_thread(len(self.g_d)):
            y = _forward(lower, other.g_e)
            g = other.g_d - w.T @ y
            if len(g):
                g = blas.dtrsv(s, g, lower=1)
        return float(np.sqrt(y @ y + g @ g))

    @cached_property
    def gauge(self) -> Gauge:
        """The motions that nothing sees."""
        return self._motions()

    def factor(self, damping: float) -> tuple[Array, Array, Array, Array] | None:
        """Factors L of the eliminated blocks, W = L^-1 H_ed, L^-1 g_e, and the factor of S (lower); or None."""
        lower, w, y = self.h_ee.copy(), self.h_ed.copy(), self.g_e.copy()
        if not factor_blocks(lower, self._floor_e, damping, w, y):
            return None
        # A row-major upper triangle is a column-major lower one.
        s = self.h_dd.copy().T
        np.einsum("ii->i", s)[:] += damping * self._floor_d
        if not s.size:
            return lower, w, y, s
        if len(w):
            s = blas.dsyrk(-1.0, w.T, beta=1.0, c=s, lower=1, overwrite_c=1)
        if self._hold.shape[1]:
            s = blas.dsyrk(1.0, self._hold, beta=1.0, c=s, lower=1, overwrite_c=1)
        s, info = lapack.dpotrf(s, lower=1, overwrite_a=1, clean=0)
        return None if info else (lower, w, y, s)

    def _back(self, lower: Array, y: Array) -> Array:
        """-L^-T y by blocks."""
        blocks, size = lower.shape[:2]
        out = -y.reshape(blocks, size)
        for i in range(size - 1, -1, -1):
            out[:, i] /= lower[:, i, i]
            out[:, :i] -= lower[:, i, :i] * out[:, i, None]
        return out.ravel()


def _forward(lower: Array, g: Array) -> Array:
    """L^-1 g by blocks."""
    blocks, size = lower.shape[:2]
    out = g.reshape(blocks, size).copy()
    for i in range(size):
        out[:, i] /= lower[:, i, i]
        out[:, i + 1 :] -= lower[:, i + 1 :, i] * out[:, i, None]
    return out.ravel()
