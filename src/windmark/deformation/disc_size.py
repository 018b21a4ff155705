"""Discs that are imaged larger or smaller than the table says: what that changes, and which of both the spots are of.

The centre of a disc's image is off the image of its centre by what goes with the square of its radius. Radii that are
off move it for all markers alike, and most of that looks like another place of the model: residuals need not tell it.
How large the discs are imaged does (as in `windmark.registration.judge.discs`).

The state is that with the table's radii, unless the spots clearly fit better as the images of discs of the imaged
size. What the other ones change is in the covariance: whatever the reason is (a table that is wrong, a print that
bled, a camera's gamma), one of the two is right.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.discs import OtherDiscs
from windmark.deformation.equations import Equations
from windmark.deformation.solve import Solved, solve
from windmark.geometry import DegenerateGeometry
from windmark.scene.units import CommonRatio

Array = NDArray[np.float64]

CLEARLY = 8.3
"""Nats that the spots have to speak for another size of the discs than the table's: odds of one in 4000."""
NOTHING = 0.1
"""Sigmas that no unknown changes by, however the spots' changes add up: below, they are not worth the equations."""


def likelier_discs(solved: Solved, size: CommonRatio | None, reject: bool) -> Solved:
    """The instant with the discs that its spots show: the table's, unless they clearly are those of the imaged size.

    ``size`` : imaged radii over the table's; None where it is not known
    """
    if size is None or not size.is_off or (columns := _columns(solved, size.ratio)) is None:
        return solved
    if _followed(solved, columns)[1] <= CLEARLY:
        return solved
    return _solved_as(solved, size.ratio, reject) or solved


def other_discs(solved: Solved, size: CommonRatio | None) -> OtherDiscs | None:
    """What the discs that the instant was not adjusted with change; None where that is nothing, or nothing is known."""
    if size is None or size.ratio == 1.0:
        return None
    chosen = solved.task.disc_ratio != 1.0
    columns = _columns(solved, 1.0 / size.ratio if chosen else size.ratio)
    return None if columns is None else OtherDiscs(size, _followed(solved, columns)[0], chosen)


def _columns(solved: Solved, ratio: float) -> Array | None:
    """(P, 2 V, 1) how projections change with discs ``ratio`` times as large; None where that is next to nothing."""
    point, view = solved.task.slots
    used, shift = solved.used, solved.shift * (ratio**2 - 1.0)
    cov = solved.task.observations.cov
    weighted = (shift[used] ** 2).sum(axis=1) / np.linalg.eigvalsh(cov[used])[:, 0]
    if weighted.sum() < NOTHING**2:
        return None
    out = np.zeros((len(solved.task.markers), 2 * len(solved.task.views), 1))
    out[point[used, None], 2 * view[used, None] + np.arange(2), 0] = shift[used]
    return out


def _followed(solved: Solved, columns: Array) -> tuple[Array, float]:
    """How all that is free follows one unit of a column, and how many nats better the spots fit with it."""
    added = Equations(solved).added(columns)
    fall = -float(2.0 * added.score[0] + added.power[0, 0])
    scale = max(solved.chi2 / solved.redundancy, 1.0) if solved.redundancy > 0 else 1.0
    return added.follow[:, 0], fall / (2.0 * scale)


def _solved_as(solved: Solved, ratio: float, reject: bool) -> Solved | None:
    """The instant with discs of the imaged size; None where they fit no better than the table's."""
    task = replace(solved.task, disc_ratio=ratio)
    try:
        other = solve(task, dict(solved.values), task.eccentricity(solved.values), reject, near=True)
    except DegenerateGeometry:
        return None
    if not isinstance(other, Solved) or other.used.sum() < solved.used.sum():
        return None
    scale = max(min(s.chi2 / max(s.redundancy, 1) for s in (solved, other)), 1.0)
    return other if other.chi2 < solved.chi2 - 2.0 * CLEARLY * scale or other.used.sum() > solved.used.sum() else None
