"""A view that shows the model in another state than the others: a picture of another moment."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from windmark.adjust import chance
from windmark.deformation.equations import Equations
from windmark.deformation.misfit import length_unit
from windmark.deformation.moved import price
from windmark.deformation.result import NotIdentified
from windmark.deformation.setup import Task
from windmark.deformation.sighting import LAW, camera_block, pose_block
from windmark.deformation.solve import Solved, solve
from windmark.errors import g1, g2, g3
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
    words : which parameter of the laws is what by it alone, and what by the others; or which marker is elsewhere
    price : what both together leave and cost, see `moved.price`
    """

    view: int
    words: str
    price: float


def asked_for(equations: Equations) -> OwnState | None:
    """The view whose residuals ask most for a state of the laws of its own, the rigid motion being that of all."""
    solved, best = equations.solved, None
    laws, views = np.arange(len(solved.task.volumes.names)), _each(solved.task)
    for v in views if len(laws) else ():
        test, rank, change, cov = equations.laws_of(v).fitted(laws)
        if chance(test, rank, solved.chi2, solved.redundancy) < FALSE / len(views):
            cost = price(solved) - test + np.log(2 * len(solved.used)) * rank
            if best is None or cost < best.price:
                best = OwnState(v, _apart(solved, change, cov), cost)
    return best


def _apart(solved: Solved, change: NDArray[np.float64], cov: NDArray[np.float64]) -> str:
    """Which marker is most surely elsewhere where the laws' parameters differ by ``change`` (n,), in words."""
    task = solved.task
    by_laws = task.placed.linearise(solved.values[LAW])[1]
    move, spread = by_laws @ change, by_laws @ cov @ by_laws.transpose(0, 2, 1)
    size = np.linalg.norm(move, axis=1)
    along = move / np.maximum(size, 1e-300)[:, None]
    sigma = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", along, spread, along), 0.0))
    k = int(np.argmax(size / np.where(sigma > 0, sigma, np.inf)))
    far = f"{g2(size[k])} ± {g1(sigma[k])} {length_unit(task.volumes)}".rstrip()
    others = "the other shows" if len(task.views) == 2 else "the others show"
    words = f"{task.markers.name[k]} is {far} from where {others} it{MOMENTS}"
    return words.replace("{", "{{").replace("}", "}}")


def _each(task: Task) -> range:
    """The views that may be the one: of one none, of two the first, for either may be."""
    count = len(task.views)
    return range(count - 1 if count <= 2 else count)


def two_moments(equations: Equations, best: float, patterned: bool) -> OwnState | None:
    """The view whose own state explains the residuals better than what costs ``best``; None without one.

    ``patterned``: whether neighbouring residuals agree. Without, it is looked for where a view asks for it, which then
    counts even where the own state, with a rigid motion of its own, costs more than it explains.
    """
    solved, asked = equations.solved, None if patterned else asked_for(equations)
    if not patterned and asked is None:
        return None
    found = [state for view in _each(solved.task) if (state := own_state(solved, view)) is not None]
    likely = min(found, key=lambda state: state.price, default=None)
    return likely if likely is not None and likely.price - 2 * np.log(FALSE) < best else asked


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
