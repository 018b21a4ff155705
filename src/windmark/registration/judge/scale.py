"""How large residuals may be: what of a solution's evidence is left where their size is open, but not without bounds.

`Solution.evidence` takes the residuals' sigma as the gates have it, which are kept a little open while labels may be
wrong. Of many pairs that is what the residuals say; of few it blunts what fits, and flatters what does not.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.order import median
from windmark.registration import rules
from windmark.registration.settle._kernels.state import TAKEN
from windmark.registration.settle.solution import Solution
from windmark.registration.task import Limits

Array = NDArray[np.float64]

STATED, SIGMAS = math.hypot(1.0, rules.DOUBLED), 21
"""The residuals' sigma is as stated, or up to so many times it, as likely as not; of either it has so many values."""


def allowed_excess(best: Solution, c: int, limits: Limits) -> float:
    """What the residuals of a camera may have beyond the given covariances (px, 1 sigma per coordinate): the errors
    that the table may have, and spots that are twice as bad as they say.
    """  # fmt: skip
    task, marker = best.views.planes[c].task, best.pairs(c)[1]
    depth = best.cam_from_model(c).apply(task.markers.xyz[marker])[:, 2]
    spacing = median(best.views.layout.spacing[marker] * float(best.state.camera[c, 0]) / depth)
    return math.hypot(limits.table_error * spacing, rules.DOUBLED * task.typical_sigma_px)


def lead(best: Solution, other: Solution, limits: Limits) -> float:
    """How much (nats) more a solution explains than another one, in the reading that is worst for it, whatever sigma
    the residuals of either have (`of_scale`).

    Of a bent solution a rigid rival may be off for want of the bending, so nothing of that is held against it.
    """
    if best.is_bent:
        return best.lead_over(other)
    return best.lead_over(other) + of_scale(best, limits) - of_scale(other, limits)


def of_scale(solution: Solution, limits: Limits) -> float:
    """What an unknown sigma of the residuals adds to the evidence of a solution (nats).

    It is as stated or up to twice that, as spots may be; or else anything, by its logarithm, from there to what errors
    of the table may make of it: by more than `Limits.table_error` no marker is off, so what would need more is worth
    what it is with that. The unknowns of the fit are as sure as the residuals are small.
    """
    total = 0.0
    for c in np.flatnonzero(solution.counts).tolist():
        marker = solution.pairs(c)[1]
        redundancy = 2 * len(marker) - float(solution.state.numbers[c, TAKEN])
        if redundancy <= 0.0:
            continue
        r, (xx, xy, yy) = solution.state.residual[c, marker], solution.state.spread[c, marker].T
        det = xx * yy - xy * xy
        square = float(((yy * r[:, 0] ** 2 - 2 * xy * r[:, 0] * r[:, 1] + xx * r[:, 1] ** 2) / det).sum())
        now = math.sqrt(0.5 * float((xx + yy).mean()))
        stated = math.sqrt(max(now**2 - float(solution.excess_px[c]) ** 2, 0.0))
        most = math.hypot(stated, allowed_excess(solution, c, limits))
        sigma = np.stack([np.geomspace(stated, end, SIGMAS) for end in (STATED * stated, most)]) / now
        worth = -redundancy * np.log(sigma) - 0.5 * square * (1 / sigma**2 - 1)
        total += float(np.logaddexp.reduce(worth, axis=None)) - math.log(worth.size)
    return total
