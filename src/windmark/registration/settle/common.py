"""The lead of one labelling over another from the spots that both explain, where what is beyond the table is none."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from windmark.registration import rules

if TYPE_CHECKING:
    from windmark.registration.settle.solution import Solution

Array = NDArray[np.float64]


def is_too_loose(solution: Solution, c: int) -> bool:
    """Whether a camera's misfit fills the neighbourhood of the search, so that other labels might fit, too."""
    return rules.MISFIT * float(solution.misfit_px[c]) > solution.views.planes[c].task.tolerance_px


def where_both(a: Solution, b: Solution, c: int) -> float | None:
    """The lead of one solution over another from the spots that both explain, where a regular layout goes on in the
    picture beyond its table; None where it does not.

    A board that is larger than its table shows as many spots under a labelling that is shifted by a row: those beyond
    the table, which the one explains and the other does not. They are no chance, so how many each of the two finds is
    no evidence. What a solution explains whose misfit is as wide as the neighbourhood of the search is chance.
    """
    if rules.AS_MANY * a.count >= b.count or a.shared(b) > rules.SAME_SHARE or is_too_loose(b, c):
        return None
    (spot_a, marker_a), (spot_b, marker_b) = a.pairs(c), b.pairs(c)
    both, at_a, at_b = np.intersect1d(spot_a, spot_b, assume_unique=True, return_indices=True)
    only_a, only_b = len(spot_a) - len(both), len(spot_b) - len(both)
    if 2 * only_b < only_a or only_b < 2:
        return None
    worth = (_worth_of(s, c, marker[at]).sum() for s, marker, at in ((a, marker_a, at_a), (b, marker_b, at_b)))
    return float(next(worth) - next(worth))


def _worth_of(solution: Solution, c: int, marker: NDArray[np.int64]) -> Array:
    """(K,) logarithm of the density of each residual."""
    r, (xx, xy, yy) = solution.state.residual[c, marker], solution.state.spread[c, marker].T
    det = xx * yy - xy * xy
    square = (yy * r[:, 0] ** 2 - 2 * xy * r[:, 0] * r[:, 1] + xx * r[:, 1] ** 2) / det
    return np.asarray(-np.log(2 * np.pi * np.sqrt(det)) - 0.5 * square)
