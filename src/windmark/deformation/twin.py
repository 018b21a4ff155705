"""A law whose parameter fits a second time: a flap that one camera sees from above may be up as well as down.

The search ends at the minimum that is nearest to where it began. When one parameter changes and all else follows it as
the images ask for, to second order, the whitened residuals are r + a t + h t^2 / 2; where a and h are nearly parallel,
within 19 degrees, their sum of squares has a second minimum, near the larger root of 2 A + 3 B t + 4 C t^2 with
A = a.a + r.h, B = a.h and C = h.h / 4. The search starts once more from there, and what fits better by its price is
taken.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from windmark.deformation.attached import LIKELIER
from windmark.deformation.moved import price
from windmark.deformation.sighting import LAW
from windmark.deformation.solve import Solved, solve
from windmark.errors import g3
from windmark.geometry import DegenerateGeometry
from windmark.scene import Doubt

Array = NDArray[np.float64]

STEP = 3.0
"""Sigmas: how far residuals are taken for their first and second derivatives."""
WORTH = 0.1
"""Of residuals larger than those of so many right instants a second minimum is looked for where the first is not sure
to have one: what is left of a wrong one bends the sum of squares."""
FARTHER = (1.0, 2.0, 4.0)
"""... and so many times as far, which the bent sum of squares may hide."""
APART = 6.0
"""Sigmas: nearer than this two minima are one, and its sigma says so."""


def best_of_twins(solved: Solved, reject: bool) -> tuple[Solved, tuple[Doubt, ...]]:
    """The better one of the minima of an adjusted instant, and that another one may be right as well.

    ``reject``: see `solve`.
    """
    best, doubts = solved, list[Doubt]()
    rates = solved.task.placed.rates
    model = solved.task.placed.xyz[~solved.task.wall]
    extent = float(np.linalg.norm(np.ptp(model, axis=0))) if len(model) else 0.0
    for k in range(len(solved.task.volumes.names)):
        starts = _seconds(solved, k, extent / rates[k] if rates[k] > 0 else 0.0)
        found = (_solved_from(solved, start, reject) for start in starts)
        other = next((s for s in found if s is not None and _apart(s, solved, k)), None)
        if other is None:
            continue
        lead = (price(best) - price(other)) / max(min(s.chi2 / max(s.redundancy, 1) for s in (best, other)), 1.0)
        better, worse = (other, best) if lead > 0 else (best, other)
        doubts += [] if abs(lead) > LIKELIER else [_doubt(k, better, worse)]
        best = better
    return best, tuple(doubts)


def _apart(other: Solved, solved: Solved, k: int) -> bool:
    at = solved.problem.slices[LAW].start + k
    return bool(abs(other.values[LAW][k] - solved.values[LAW][k]) > APART * np.sqrt(solved.cov[at, at]))


def _misfits(solved: Solved) -> bool:
    """Whether something is left, or was left out, that a wrong minimum may be to blame for."""
    return bool(not solved.used.all() or chdtrc(solved.redundancy, solved.chi2) < WORTH)


def _seconds(solved: Solved, k: int, most: float) -> list[dict[str, Any]]:
    """Where a second minimum along a parameter may be, less than ``most`` away: nearest first."""
    at = solved.problem.slices[LAW].start + k
    along = solved.cov[:, at] / np.sqrt(solved.cov[at, at])  # by one sigma, all else following
    here = np.concatenate([part.ravel() for part in solved.parts])
    on, back = (_residual(solved, sign * STEP * along) for sign in (1.0, -1.0))
    if on is None or back is None:
        return []
    a, h = (on - back) / (2 * STEP), (on - 2 * here + back) / STEP**2
    others = np.delete(solved.jacobian, at, axis=1)
    follow = np.linalg.lstsq(others, h, rcond=None)[0]
    h = h - others @ follow
    terms = 2 * (a @ a + here @ h), 3 * (a @ h), h @ h
    root = terms[1] ** 2 - 4 * terms[0] * terms[2]
    misfit = _misfits(solved)
    if not terms[2] > 0 or not (root > 0 or misfit):
        return []
    far = (-terms[1] - np.copysign(np.sqrt(max(root, 0.0)), terms[1])) / (2 * terms[2])
    if not APART < abs(far) <= most / np.sqrt(solved.cov[at, at]):
        return []
    starts = [
        solved.problem.retract(solved.values, t * along - np.insert(follow, at, 0.0) * t**2 / 2)
        for t in (far * np.array(FARTHER) if misfit else (far,))
    ]
    return [start for start in starts if start is not None]


def _residual(solved: Solved, change: Array) -> Array | None:
    values = solved.problem.retract(solved.values, change)
    parts = [None if values is None else term.residual(values) for term in solved.problem.terms]
    return None if any(p is None for p in parts) else np.concatenate([p.ravel() for p in parts if p is not None])


def _solved_from(solved: Solved, start: dict[str, Any], reject: bool) -> Solved | None:
    task = solved.task
    try:
        other = solve(task, start, task.eccentricity(start), reject, near=False)
    except DegenerateGeometry:
        return None
    return other if isinstance(other, Solved) else None


def _doubt(k: int, better: Solved, worse: Solved) -> Doubt:
    parameter = better.task.volumes.parameters[k]
    unit = f" {parameter.unit}" if parameter.unit else ""
    first, second = (g3(float(s.values[LAW][k])) for s in (better, worse))
    words = (f"{{}} may be {second}{unit} as well as {first}{unit}: the spots tell these apart by no more than a "
             "factor of 100; a camera that sees it from another side does, or a start and a sigma")  # fmt: skip
    return Doubt((better.task.volumes.names[k],), words, "twofold")
