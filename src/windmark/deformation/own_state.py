"""A view that shows the model in another state than the others: a picture of another moment."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from windmark.deformation.moved import price
from windmark.deformation.result import NotIdentified
from windmark.deformation.setup import Task
from windmark.deformation.sighting import LAW, camera_block, pose_block
from windmark.deformation.solve import Solved, solve
from windmark.errors import g3
from windmark.geometry import DegenerateGeometry
from windmark.scene import Observations

FALSE = 1e-3
"""Probability that residuals of a state that is right are called too large, or two states that are one different."""
MOMENTS = ": pictures of different moments"
FITS = 0.9
"""Part of the marks that a state of its own explains."""


@dataclass(frozen=True)
class OwnState:
    """A view's own state beside that of the others.

    Parameters
    ----------
    view : its number
    words : which parameter of the laws is what by it alone, and what by the others
    price : what both together leave and cost, see `moved.price`
    """

    view: int
    words: str
    price: float


def two_moments(solved: Solved, best: float) -> OwnState | None:
    """The view with a state of its own that explains the residuals better than what costs ``best``; None without one.

    Of two views the first: either may be the one of another moment.
    """
    views = range(1 if len(solved.task.views) == 2 else len(solved.task.views))
    found = [state for view in views if (state := own_state(solved, view)) is not None]
    likely = min(found, key=lambda state: state.price, default=None)
    return likely if likely is not None and likely.price - 2 * np.log(FALSE) < best else None


def own_state(solved: Solved, view: int) -> OwnState | None:
    """A view's own state; None where it or that of the others does not fit, or both are one.

    A camera that moved sees the same laws' state from elsewhere: the rigid motion takes that up.
    """
    task = solved.task
    if not task.volumes.names or len(task.views) < 2:
        return None
    mine = task.observations.view == view
    alone = _alone(solved, mine)
    rest = None if alone is None else _alone(solved, ~mine)
    if alone is None or rest is None:
        return None
    (here, cov_here), (there, cov_there) = _laws(alone), _laws(rest)
    off, cov = here - there, cov_here + cov_there
    if chdtrc(len(off), float(off @ np.linalg.lstsq(cov, off, rcond=None)[0])) > FALSE:
        return None
    k = int(np.argmax(np.abs(off) / np.sqrt(np.maximum(np.diag(cov), 1e-300))))
    unit = task.volumes.parameters[k].unit
    here_k, there_k = (f"{g3(q[k])} {unit}".rstrip() for q in (here, there))
    others = "the other" if len(task.views) == 2 else "the others"
    words = f"{task.volumes.names[k]} is {here_k} by it alone and {there_k} by {others}{MOMENTS}"
    return OwnState(view, words.replace("{", "{{").replace("}", "}}"), price(alone) + price(rest))


def _alone(solved: Solved, own: NDArray[np.bool_]) -> Solved | None:
    """The state by some observations, those left out, too; None where they do not tell it, or it does not fit."""
    task, seen = solved.task, solved.task.observations
    views = np.unique(seen.view[own])
    names = [task.views[v].name for v in views]
    part: Task = replace(
        task,
        observations=Observations(np.searchsorted(views, seen.view[own]), seen.point[own], seen.xy[own], seen.cov[own]),
        views=tuple(task.views[v] for v in views),
        free_poses=tuple(n for n in task.free_poses if n in names),
        free_focal=tuple(c for c in task.free_focal if c in {task.views[v].camera for v in views}),
    )
    others = {pose_block(v.name) for v in task.views if v.name not in names}
    others |= {camera_block(c) for c in task.free_focal if c not in part.free_focal}
    values = {name: value for name, value in solved.values.items() if name not in others}
    try:
        found = solve(part, values, solved.shift[own], True, near=False)
    except DegenerateGeometry:
        return None
    if isinstance(found, NotIdentified) or found.redundancy < 1 or found.used.mean() < FITS:
        return None
    return found if chdtrc(found.redundancy, found.chi2) > FALSE else None


def _laws(found: Solved) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Parameters of the laws and their covariance."""
    own = found.problem.slices[LAW]
    return np.asarray(found.values[LAW]), found.cov[own, own]
