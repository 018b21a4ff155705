"""Robust losses on the length of a whitened residual.

A loss replaces the squared length ``s = |r|^2`` (in units of the observation's own sigma) by
``rho(s)``; the adjustment then weights each observation by ``w(s) = d rho / d s`` and solves again
(iteratively reweighted least squares, Holland and Welsch 1977). An observation is a *point*: both
of its coordinates share one weight, so the result does not depend on the axes of the image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError

Array = NDArray[np.float64]

DEFAULT_SCALE = {"none": float("inf"), "huber": 1.5011411, "cauchy": 2.5486376, "tukey": 5.1229861}
"""Scale in sigma at which each loss keeps 95 % efficiency on Gaussian image points.

The textbook constants (1.345, 2.385, 4.685) are for scalar residuals; a point has two coordinates
and its residual's length follows Rayleigh's distribution.
"""


@dataclass(frozen=True)
class Loss:
    """A loss and its scale.

    Parameters
    ----------
    name : "none", "huber", "cauchy" or "tukey"
    scale : length of the whitened residual, in sigma, beyond which an observation counts as doubtful
    """

    name: str = "none"
    scale: float = float("inf")

    def __post_init__(self) -> None:
        if self.name not in DEFAULT_SCALE:
            raise UsageError(f"loss must be one of {', '.join(DEFAULT_SCALE)}, got {self.name!r}")
        if self.name != "none" and not (np.isfinite(self.scale) and self.scale > 0):
            raise UsageError(f"loss_scale must be finite and > 0 (in sigma), got {self.scale}")

    @staticmethod
    def make(name: str, scale: float | None = None) -> Loss:
        """The named loss; without a scale the one of 95 % efficiency."""
        if scale is None:
            return Loss(name, DEFAULT_SCALE.get(name, float("inf")))
        if name == "none":
            raise UsageError(f"loss_scale has no meaning with loss='none', got {scale}")
        return Loss(name, float(scale))

    @property
    def redescending(self) -> bool:
        """Whether far observations lose all influence; such a loss needs a start near the minimum."""
        return self.name in ("cauchy", "tukey")

    def evaluate(self, squared: Array) -> tuple[Array, Array]:
        """``rho(s)`` and the weights ``w(s)`` of squared lengths, any shape."""
        c2 = self.scale * self.scale
        if self.name == "none":
            return squared, np.ones_like(squared)
        if self.name == "huber":
            length = np.sqrt(np.maximum(squared, c2))
            return np.where(squared <= c2, squared, 2 * self.scale * length - c2), self.scale / length
        if self.name == "cauchy":
            return c2 * np.log1p(squared / c2), 1 / (1 + squared / c2)
        inside = np.maximum(1 - squared / c2, 0.0)
        return c2 / 3 * (1 - inside**3), inside**2

    def gaussian_moments(self) -> tuple[float, float, float]:
        """``E[w]``, ``E[w |r|^2]`` and the efficiency for points with Gaussian noise of unit sigma.

        With Stein's identity the asymptotic variance of a location estimate (Huber 1981, eq. 6.3.1)
        needs no derivative of the weights: efficiency = E[w r^2]^2 / (2 E[w^2 r^2]), r ~ Rayleigh.
        They turn a weighted normal matrix into a covariance and a weighted sum of squares into sigma0.
        """
        if self.name == "none":
            return 1.0, 2.0, 1.0
        node, weight = np.polynomial.legendre.leggauss(48)
        # The weight function has a kink at the scale; beyond r = 12 Rayleigh's tail is below 1e-31.
        middle = min(self.scale, 12.0)
        edges = ((0.0, middle), (middle, 12.0))
        r = np.concatenate([(b - a) / 2 * node + (b + a) / 2 for a, b in edges])
        density = np.concatenate([(b - a) / 2 * weight for a, b in edges]) * r * np.exp(-r * r / 2)
        w = self.evaluate(r * r)[1]
        mean_w, mean_wr2, mean_w2r2 = (float(density @ m) for m in (w, w * r * r, w * w * r * r))
        return mean_w, mean_wr2, mean_wr2**2 / (2 * mean_w2r2)
