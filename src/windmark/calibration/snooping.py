"""Gross errors: found by their own test, named, left out, and taken back when they fit after all.

Each mark is a point with two coordinates. Its residual r has the covariance Q = 1 - J C J^T in units of its own sigma
(the adjustment follows a mark a little), so T = r^T Q^-1 r / sigma0^2 has the chi-square distribution of two degrees
of freedom (Baarda 1968, data snooping). A mark that was left out is tested against its prediction, 1 + J C J^T.

The sigma0 of that is not known, it comes from the same residuals: with few of them a mark that goes makes sigma0
smaller and the next one go. `externally` compares each mark with the residuals of the others (Pope 1976; Heck 1981),
which is right for any redundancy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.chance import beyond_rounding
from windmark.adjust.network import NetworkProblem, NetworkState, linear
from windmark.adjust.network.covariance import NetworkCovariance

Array = NDArray[np.float64]

FALSE = 0.05
"""Probability that any mark at all is left out where none is wrong."""


def critical(count: int) -> float:
    """Test value that any of ``count`` right marks exceeds with the probability `FALSE` (chi-square, two degrees)."""
    return float(-2 * np.log(FALSE / max(count, 1)))


def externally(test: Array, used: NDArray[np.bool_], squares: float, redundancy: int) -> Array:
    """(O,) test values whose distribution is that of chi-square with two degrees of freedom for any redundancy.

    Parameters
    ----------
    test : (O,) T of every mark for sigma0 = 1, see `statistic`
    used : (O,) marks that took part in the adjustment
    squares, redundancy : of that adjustment: weighted sum of squared residuals, and its degrees of freedom

    With Omega the sum of squares, T of a used mark is a part of it: T / 2 beside (Omega - T) / (r - 2) is F with (2,
    r - 2) degrees, and -2 ln P(F) = -(r - 2) ln(1 - T / Omega). Of one that was left out, r ln(1 + T / Omega). Zero
    where nothing is left to compare with. Rounding (`beyond_rounding`) has outliers of its own.
    """
    if not squares > 0:
        return np.zeros(len(test))
    share = test / beyond_rounding(squares, redundancy)
    inside = -max(redundancy - 2, 0) * np.log1p(-np.minimum(share, 1 - 1e-12))
    return np.where(used, inside, max(redundancy, 0) * np.log1p(share))


def influence(problem: NetworkProblem, state: NetworkState, covariance: NetworkCovariance, cross: Array) -> Array:
    """(O, 2, 2) J C J^T of every mark in units of its variance, in the problem's order.

    ``cross`` is the covariance of the eliminated parameters with the dense ones, see `covariance_and_cross`.
    """
    out = np.empty((len(problem.order), 2, 2))
    jd, je, columns, block = problem.jacobian(state)
    # The dense covariance comes column by column; it is symmetric.
    dense = np.ascontiguousarray(covariance.dense.T)
    linear.influences(jd, je, columns, block, dense, cross, covariance.blocks, out)
    return out


def statistic(residual: Array, influence_: Array, used: NDArray[np.bool_]) -> Array:
    """(O,) T of every mark for sigma0 = 1: against what is left of its noise if it was used, else its prediction."""
    sign = np.where(used, -1.0, 1.0)
    xx, xy, yy = 1 + sign * influence_[:, 0, 0], sign * influence_[:, 0, 1], 1 + sign * influence_[:, 1, 1]
    x, y = residual.T
    middle, half = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    # The part of the squared residual along each principal axis: r^T (Q - other) r / (own - other).
    whole = x * x + y * y
    along = xx * x * x + 2 * xy * x * y + yy * y * y - (middle - half) * whole
    large = np.clip(np.divide(along, 2 * half, out=whole / 2, where=half > 0), 0.0, whole)
    # A mark that alone determines something has no redundancy and cannot be tested: its residual is zero.
    return np.asarray(_over(large, middle + half) + _over(whole - large, middle - half))


def _over(square: Array, value: Array) -> Array:
    """Squares in units of their variance; zero where there is none."""
    return np.divide(square, value, out=np.zeros_like(square), where=value > 1e-6)
