"""More than chance? What a further unknown explains beside the residuals it leaves, and how often something hits."""

from __future__ import annotations

import math

from scipy.special import betainc, fdtrc

LEAST_TAIL = 1e-290
"""Of a binomial tail: below it a double underflows, and its first terms are summed instead."""
EXACT = 1e-3
"""Residuals of so small a part of what the covariances say are those of numbers without noise."""


def beyond_rounding(squares: float, redundancy: int) -> float:
    """A weighted sum of squared residuals, or what rounding alone may leave of it, see `EXACT`."""
    return max(squares, redundancy * EXACT**2)


def chance(test: float, dof: int, squares: float, redundancy: int) -> float:
    """Probability that unknowns that are not there explain so much.

    Parameters
    ----------
    test : by which the sum of squares falls when ``dof`` unknowns are added
    dof : how many are added; fewer than one, or no redundancy beside them, tell nothing: 1
    squares, redundancy : weighted sum of squared residuals without them, and its degrees of freedom; residuals below
        `EXACT` are rounding, in which there is nothing to explain

    F of what is explained beside what is left (Teunissen, "Testing theory", 2000, ch. 4), so that residuals that
    are all larger than stated make no hypothesis likely.
    """
    free, rest = redundancy - dof, beyond_rounding(squares, redundancy) - test
    if free < 1 or dof < 1:
        return 1.0
    return 0.0 if rest <= 0 else float(fdtrc(dof, free, test / dof * free / rest))


def log_tail(at_least: int, trials: int, probability: float) -> float:
    """Logarithm of the probability that chance hits as often or more often: a binomial tail, however small.

    Certain where ``at_least`` is none (0), impossible where it is more than ``trials`` (-inf).
    """
    if at_least <= 0:
        return 0.0
    if at_least > trials or probability <= 0:
        return -math.inf
    tail = float(betainc(at_least, trials - at_least + 1, probability))
    if tail > LEAST_TAIL:
        return math.log(tail)
    # So far out the terms fall like a geometric series.
    ways = math.lgamma(trials + 1) - math.lgamma(at_least + 1) - math.lgamma(trials - at_least + 1)
    first = ways + at_least * math.log(probability) + (trials - at_least) * math.log1p(-probability)
    ratio = (trials - at_least) * probability / ((at_least + 1) * (1 - probability))
    return first - math.log1p(-ratio)
