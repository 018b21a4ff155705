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

from windmark.adjust.network import NetworkProblem, NetworkState
from windmark.adjust.network.covariance import NetworkCovariance

Array = NDArray[np.float64]

FALSE = 0.05
"""Probability that any mark at all is left out where none is wrong."""
CHUNK = 4_000
"""Marks worked on at a time, for memory."""


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
    where nothing is left to compare with.
    """
    if not squares > 0:
        return np.zeros(len(test))
    share = test / squares
    inside = -max(redundancy - 2, 0) * np.log1p(-np.minimum(share, 1 - 1e-12))
    return np.where(used, inside, max(redundancy, 0) * np.log1p(share))


def influence(problem: NetworkProblem, state: NetworkState, covariance: NetworkCovariance) -> Array:
    """(O, 2, 2) J C J^T of every mark in units of its variance, in the problem's order."""
    lay, o = problem.layout, len(problem.order)
    jd, je, cols, block = problem.jacobian(state)
    # Minus the covariance of the eliminated with the dense parameters.
    cross = (covariance.half @ covariance.dense).reshape(lay.blocks, lay.size, -1)
    out = np.zeros((o, 2, 2))
    for start in range(0, o, CHUNK):
        part = slice(start, start + CHUNK)
        u, w, c, b = jd[part], je[part], np.maximum(cols[part], 0), block[part]
        dense = covariance.dense[c[:, :, None], c[:, None, :]]
        out[part] = u @ dense @ u.transpose(0, 2, 1)
        own = np.maximum(b, 0)
        if lay.blocks:
            between = -cross[own[:, None, None], np.arange(lay.size)[:, None], c[:, None, :]]
            mixed = u @ between.transpose(0, 2, 1) @ w.transpose(0, 2, 1)
            both = w @ covariance.blocks[own] @ w.transpose(0, 2, 1) + mixed + mixed.transpose(0, 2, 1)
            out[part] += np.where((b >= 0)[:, None, None], both, 0.0)
    return out


def statistic(residual: Array, influence_: Array, used: NDArray[np.bool_]) -> Array:
    """(O,) T of every mark for sigma0 = 1: against what is left of its noise if it was used, else its prediction."""
    sign = np.where(used, -1.0, 1.0)[:, None, None]
    q = np.eye(2) + sign * influence_
    # A mark that alone determines something has no redundancy and cannot be tested: its residual is zero.
    value, vector = np.linalg.eigh(q)
    along = np.einsum("oij,oi->oj", vector, residual)
    return np.where(value > 1e-6, along**2 / np.maximum(value, 1e-6), 0.0).sum(axis=1)
