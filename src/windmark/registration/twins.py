"""Labellings that differ by a near-symmetry of the layout, told apart by the errors of the table only.

A regular layout whose table is rough looks irregular, and one of its turned or shifted labellings fits these
irregularities better than the others: by chance, and by more nats the more markers there are. So it is asked what a
table without them would do. Where two labellings give a spot to two markers, the mean of what they predict is that of
the table made symmetric: errors of the table are halved in it (variance), while an irregularity that the picture shows
is lost.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.registration._kernels.settle import GATE
from windmark.registration.search.plane import Plane
from windmark.registration.solution import SAME_SHARE, Solution

Array = NDArray[np.float64]

BEYOND_CHANCE = 5.0
"""If the truth is symmetric, either labelling may be the better one at every spot. A lead is no chance beyond so many
sigma of that (Hoeffding's bound: one in 270,000)."""
BEYOND_GATE = 1.5
"""A free marker within so many times its gate could be the one of a spot; farther off it is another, or hidden."""


def told_by_table_errors(plane: Plane, best: Solution, other: Solution, margin: float) -> bool:
    """Whether only errors of the table need speak for the best of two labellings.

    Parameters
    ----------
    best, other : two solutions, the better one first
    margin : lead (nats) that counts as one

    Returns
    -------
    True if the lead comes from the residuals of spots that both explain, the table made symmetric explains these better
    than the table as it is, and the lead could be chance.
    """
    if best.shared(other) > SAME_SHARE:
        return False
    spots = np.union1d(best.detection, other.detection)
    a, b = (_residuals(plane, solution, spots) for solution in (best, other))
    both = np.isfinite(a[:, 0]) & np.isfinite(b[:, 0])
    a, b = a[both], b[both]
    sigma = _sigma(plane, best)
    ahead = (b**2 - a**2).sum(axis=1) / (2 * sigma**2)
    if best.evidence.score - other.evidence.score - ahead.sum() >= margin:
        return False
    symmetric_is_better = ((0.5 * (a + b)) ** 2).sum() < (a**2).sum()
    return bool(symmetric_is_better and ahead.sum() < BEYOND_CHANCE * np.sqrt((ahead**2).sum()))


def _sigma(plane: Plane, solution: Solution) -> float:
    """1 sigma per coordinate of its residuals, at least that of the spots."""
    return max(solution.misfit_px, plane.task.typical_sigma_px)


def _residuals(plane: Plane, solution: Solution, spots: NDArray[np.int64]) -> Array:
    """(S, 2) predicted - detected of the marker at each spot: the labelled one, or a free one just outside its gate.

    NaN where there is none. A rough table drops such a pair; that is no evidence.
    """
    off = np.full((len(plane.spots.p), 2), np.nan)
    seen = solution.places(plane)
    off[solution.detection] = seen[solution.marker] - plane.spots.p[solution.detection]
    bare = spots[np.isnan(off[spots, 0])]
    free = np.delete(seen, solution.marker, axis=0)
    if len(bare) and len(free):
        gap = free[None] - plane.spots.p[bare][:, None]
        distance = np.linalg.norm(gap, axis=2)
        nearest = distance.argmin(axis=1)
        reach = BEYOND_GATE * np.sqrt(GATE) * _sigma(plane, solution)
        near = distance.min(axis=1) < min(reach, plane.task.tolerance_px)
        off[bare[near]] = gap[near, nearest[near]]
    return off[spots]
