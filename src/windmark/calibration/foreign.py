"""A picture that contradicts all others: another camera took it, it was cropped, or its labels are of something else.

Its error goes into everything that it shares with the others, so that these look wrong, too. Which one it is, is told
by the marks of each picture together: without them the sum of squares would fall by T = r^T Q^- r, with the residuals
r of these marks and their cofactors Q = 1 - J C J^T; chi-square where nothing is wrong (Baarda 1968, for a block).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.calibration.changed_views import FREED, THINGS, amount, asked_most, changes
from windmark.calibration.hypotheses import CHECKED, gathered
from windmark.calibration.result import Calibration
from windmark.calibration.setup import Job
from windmark.calibration.solve import Solved
from windmark.scene import Doubt

Array = NDArray[np.float64]

TRIED = 12
"""Pictures, those with the largest residuals, that may be the one: the work is theirs times the unknowns squared."""
LEAST_VIEWS = 4
"""Of fewer pictures none is told to be the one that is wrong."""


def contradicting(result: Calibration, least: int = 2) -> bool:
    """Whether pictures, ``least`` or more, contradict each other in a way that one of them alone could cause.

    One alone that asks for a focal length or principal point of its own does not, before any was left out.
    """
    asking = any(d.cause in ("focal", "principal") and len(d.names) >= least for d in result.doubts)
    return len(result.views) >= LEAST_VIEWS and (asking or any(d.cause == "picture" for d in result.doubts))


def most_foreign(solved: Solved) -> int:
    """The view without whose marks the sum of squares would fall most beyond their number."""
    problem, used = solved.problem, solved.used[solved.problem.order]
    views, residual = problem.marks.views, solved.residual[problem.order]
    seen = np.unique(views[used])
    beyond = np.bincount(views, (residual**2).sum(axis=1) - 2 * solved.sigma0**2)[seen]
    found = {}
    for view in seen[np.argsort(-beyond, kind="stable")[:TRIED]].tolist():
        own = np.flatnonzero((views == view) & used)
        group = np.full(len(views), -1)
        group[own] = np.arange(len(own))
        one = np.zeros((len(views), 2, 2))
        one[own] = np.eye(2)
        a = np.concatenate(np.moveaxis(gathered(solved, one, group, len(own)), 2, 0), axis=1)
        value, axes = np.linalg.eigh(np.eye(2 * len(own)) - a.T @ solved.covariance.product(a))
        told = value > CHECKED
        along = axes[:, told].T @ residual[own].T.ravel()
        found[view] = float((along**2 / value[told]).sum()) - solved.sigma0**2 * int(told.sum())
    return max(found, key=lambda view: found[view])


def of_its_own(job: Job, solved: Solved, view: int) -> str:
    """By how much the focal length or principal point of a view is another one, if its marks ask for it, in words."""
    kind, asked = asked_most(changes(job, solved))
    found = [other for other in asked.own if other.view == job.views[view].name]
    free = f": {FREED[kind]}" if kind in FREED else ""
    return f" (by its {THINGS[kind]} {amount(found[0], kind)}{free})" if found else ""


def without(result: Calibration, views: Mapping[str, str]) -> Calibration:
    """The result of the other pictures, with what is to be said of those that took no part: view -> `of_its_own`."""
    doubts = tuple(
        Doubt(
            (view,), "{} contradicts all other pictures, which agree without it, and took no part: another camera or "
            f"another focus took it{focal}, it was cropped, or its labels are wrong", "picture",
        ) for view, focal in views.items()
    )  # fmt: skip
    dropped = dict.fromkeys(views, "it contradicts all other pictures, which agree without it")
    return replace(result, doubts=(*doubts, *result.doubts), dropped={**result.dropped, **dropped})
