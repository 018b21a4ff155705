"""A law whose parameter fits a second time: a flap that one camera sees from above may be up as well as down.

The search ends at the minimum that is nearest to where it began. When one parameter changes and all else follows it as
the images ask for, to second order, the whitened residuals are r + a t + h t^2 / 2; where a and h are nearly parallel,
within 19 degrees, their sum of squares has a second minimum, near the larger root of 2 A + 3 B t + 4 C t^2 with
A = a.a + r.h, B = a.h and C = h.h / 4. The search starts once more from there, and what fits better by its price is
taken.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from windmark.deformation.attached import LIKELIER
from windmark.deformation.misfit import carried
from windmark.deformation.moved import price
from windmark.deformation.sighting import LAW, pose_block
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
SIDES = np.radians(10.0)
"""Views that are so far apart see all components of a motion; then only what is left asks for a second search."""
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
    for k, sides in enumerate(_from_sides(solved)):
        if sides and not _misfits(solved):
            continue
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


def _from_sides(solved: Solved) -> list[bool]:
    """Of each parameter, whether views show its markers from sides that are apart, which see all of what it does."""
    task, out = solved.task, list[bool]()
    (point, view), place = task.slots, task.tunnel_place(solved.values)
    centres = np.array([solved.values[pose_block(v.name)].inverse().translation for v in task.views])
    for part in task.volumes.parts:
        own = np.isin(task.placed.names, carried(task.volumes, part.name)) & ~task.wall
        seen = np.unique(view[own[point] & solved.used])
        rays = place[own].mean(axis=0) - centres[seen] if own.any() else np.zeros((0, 3))
        rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        apart = bool((rays @ rays.T < np.cos(SIDES)).any())
        out += [apart] * (0 if part.law is None else len(part.law.parameters))
    return out


def _misfits(solved: Solved) -> bool:
    """Whether something is left, or was left out, that a wrong minimum may be to blame for."""
    return bool(not solved.used.all() or chdtrc(solved.redundancy, solved.chi2) < WORTH)


def _seconds(solved: Solved, k: int, most: float) -> list[dict[str, Any]]:
    """Where a second minimum along a parameter may be, less than ``most`` away: nearest first."""
    at, jacobian = solved.problem.slices[LAW].start + k, solved.jacobian
    sigma = float(np.sqrt(solved.cov[at, at]))
    along = solved.cov[:, at] / sigma  # by one sigma, all else following
    on = solved.values[LAW].copy()
    on[k] += STEP * sigma
    raw = solved.sighting.evaluated({**solved.values, LAW: on})
    if raw is None:
        return []
    there = (solved.sighting.whitener @ raw[1])[..., at].ravel()
    residual = np.concatenate([part.ravel() for part in solved.parts])
    a, h = jacobian @ along, np.zeros(len(jacobian))
    h[: len(there)] = (there - jacobian[: len(there), at]) * sigma / STEP
    others = np.delete(jacobian, at, axis=1)
    follow = np.linalg.lstsq(others, h, rcond=None)[0]
    h -= others @ follow
    first, second, third = float(2 * (a @ a + residual @ h)), float(3 * (a @ h)), float(h @ h)
    root = second**2 - 4 * first * third
    misfit = _misfits(solved)
    if not third > 0 or not (root > 0 or misfit):
        return []
    far = (-second - math.copysign(math.sqrt(max(root, 0.0)), second)) / (2 * third)
    if not APART < abs(far) <= most / sigma:
        return []
    starts = [
        solved.problem.retract(solved.values, t * along - np.insert(follow, at, 0.0) * t**2 / 2)
        for t in (far * np.array(FARTHER) if misfit else (far,))
    ]
    return [start for start in starts if start is not None]


def _solved_from(solved: Solved, start: dict[str, Any], reject: bool) -> Solved | None:
    task = solved.task
    if solved.sighting.evaluated(start) is None:
        return None  # markers behind a camera, beyond its lens, or where a law has no place
    try:
        other = solve(task, start, task.eccentricity(start), reject, near=False)
    except (DegenerateGeometry, np.linalg.LinAlgError):  # also of a mark that was left out, and has no place there
        return None
    return other if isinstance(other, Solved) else None


def _doubt(k: int, better: Solved, worse: Solved) -> Doubt:
    parameter = better.task.volumes.parameters[k]
    unit = f" {parameter.unit}" if parameter.unit else ""
    first, second = (g3(float(s.values[LAW][k])) for s in (better, worse))
    words = (f"{{}} may be {second}{unit} as well as {first}{unit}: the spots tell these apart by no more than a "
             "factor of 100; a camera that sees it from another side does, or a start and a sigma")  # fmt: skip
    return Doubt((better.task.volumes.names[k],), words, "twofold")
