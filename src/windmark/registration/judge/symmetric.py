"""Labellings that differ by a near-symmetry of the layout, told apart by the errors of the table or by bending only.

A regular layout whose table is rough looks irregular, and one of its turned or shifted labellings fits these
irregularities better than the others: by chance, and by more nats the more markers there are. So it is asked what a
table without them would do. Where two labellings give a spot to two markers, the mean of what they predict is that of
the table made symmetric: errors of the table are halved in it (variance), while an irregularity that the picture shows
is lost.

A deformation gains by any misfit that is smooth: a lens, a board that is not flat. It is smooth with every labelling of
a lattice, and which of them gains most by it is a matter of what the misfit looks like, no evidence of a shift.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.registration import rules
from windmark.registration.settle._kernels.label import GATE
from windmark.registration.settle._kernels.places import places_kernel
from windmark.registration.settle.solution import Solution

Array = NDArray[np.float64]

BEYOND_GATE = 1.5
"""A free marker within so many times its gate could be the one of a spot; farther off it is another, or hidden."""


def told_by_table_errors(best: Solution, other: Solution, margin: float) -> bool:
    """Whether only errors of the table need speak for the best of two labellings.

    Parameters
    ----------
    best, other : two solutions, the better one first
    margin : lead (nats) that counts as one

    Returns
    -------
    True if the lead comes from the residuals of spots that both explain, the table made symmetric explains these better
    than the table as it is, and the lead could be chance (Hoeffding's bound).
    """
    if best.shared(other) > rules.SAME_SHARE:
        return False
    one, two, ahead = [], [], []
    for c in range(len(best.counts)):
        spots = np.union1d(best.pairs(c)[0], other.pairs(c)[0])
        a, b = (_residuals(solution, c, spots) for solution in (best, other))
        both = np.isfinite(a[:, 0]) & np.isfinite(b[:, 0])
        one.append(a[both])
        two.append(b[both])
        ahead.append(((b[both] ** 2 - a[both] ** 2) / (2 * _sigma(best, c) ** 2)).sum(axis=1))
    a, b, lead = np.concatenate(one), np.concatenate(two), np.concatenate(ahead)
    if best.evidence - other.evidence - lead.sum() >= margin:
        return False
    symmetric_is_better = ((0.5 * (a + b)) ** 2).sum() < (a**2).sum()
    return bool(symmetric_is_better and lead.sum() < rules.SYMMETRIC * np.sqrt((lead**2).sum()))


def told_by_bending(bent: Solution, rigid: Sequence[Solution], margin: float) -> Solution | None:
    """The rigid solution with another labelling that a bent one leads by nothing but the bending; None without one.

    Parameters
    ----------
    bent : the best solution of a model that may be bent
    rigid : solutions of the rigid model
    margin : lead (nats) that counts as one

    Notes
    -----
    Where the rigid model explains no fewer spots with another labelling, bending brings the labels nothing. Then the
    labelling of the bent solution must be the better one of the rigid model, too.
    """
    own = max((s for s in rigid if s.shared(bent) > rules.SAME_SHARE), key=lambda s: s.evidence, default=None)
    for other in rigid if own is not None else ():
        another = other.count >= bent.count and other.shared(bent) <= rules.SAME_SHARE
        if another and own is not None and own.lead_over(other) < margin:
            return other
    return None


def _sigma(solution: Solution, c: int) -> float:
    """1 sigma per coordinate of its residuals, at least that of the spots."""
    return max(float(solution.misfit_px[c]), solution.views.planes[c].task.typical_sigma_px)


def _residuals(solution: Solution, c: int, spots: NDArray[np.int64]) -> Array:
    """(S, 2) predicted - detected of the marker at each spot: the labelled one, or a free one just outside its gate.

    NaN where there is none. A rough table drops such a pair; that is no evidence.
    """
    task = solution.views.planes[c].task
    off, seen = np.full((len(task.xy), 2), np.nan), places_kernel(solution.views.sights, solution.state, c)
    spot, marker = solution.pairs(c)
    off[spot] = seen[marker] - task.xy[spot]
    bare = spots[np.isnan(off[spots, 0])]
    free = np.delete(seen, marker, axis=0)
    free = free[np.isfinite(free[:, 0])]
    if len(bare) and len(free):
        gap = free[None] - task.xy[bare][:, None]
        distance = np.linalg.norm(gap, axis=2)
        nearest = distance.argmin(axis=1)
        reach = BEYOND_GATE * np.sqrt(GATE) * _sigma(solution, c)
        near = distance.min(axis=1) < min(reach, task.tolerance_px)
        off[bare[near]] = gap[near, nearest[near]]
    return off[spots]
