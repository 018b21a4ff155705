"""Is what a further unknown explains more than chance? The test of a hypothesis beside the residuals it leaves."""

from __future__ import annotations

from scipy.special import fdtrc


def chance(test: float, dof: int, squares: float, redundancy: int) -> float:
    """Probability that unknowns that are not there explain so much.

    Parameters
    ----------
    test : by which the sum of squares falls when ``dof`` unknowns are added
    dof : how many are added; fewer than one, or no redundancy beside them, tell nothing: 1
    squares, redundancy : weighted sum of squared residuals without them, and its degrees of freedom

    F of what is explained beside what is left (Teunissen, "Testing theory", 2000, ch. 4), so that residuals that
    are all larger than stated make no hypothesis likely.
    """
    free, rest = redundancy - dof, squares - test
    if free < 1 or dof < 1:
        return 1.0
    return 0.0 if rest <= 0 else float(fdtrc(dof, free, test / dof * free / rest))
