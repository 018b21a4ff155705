"""Explanations come to rest: labels, pose, cameras and deformation that agree, from a start or from another freedom."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.registration.settle._kernels.settle import STEADY, accept_kernel, fit_kernel, settle_kernel
from windmark.registration.settle._kernels.state import EXCESS, State, state_of
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import Views

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

HIDING_ROUNDS = 3
"""How often what hides what is asked again from a better pose; markers on a silhouette may never rest."""


def settle(
    views: Views, rotation: Array, translation: Array, match: Ints, *, focal_px: float | Array | None = None,
    trusted: int = 0, anywhere: bool = False,
) -> Solution | None:  # fmt: skip
    """Refine a start to a fixed point of labelling; None where it falls apart or leaves the prior.

    Parameters
    ----------
    views : what was seen, and with how much freedom it is to be explained
    rotation, translation : pose of the unit model in the rig
    match : (C, N) spots of the markers in each camera, or -1
    focal_px : (C,) or one for all, of the cameras whose focal lengths are free
    trusted : rounds that the labels stay at most while the excess settles
    anywhere : beyond the priors, too, which are those of cameras where they are given
    """
    state = state_of(views.sights, rotation, translation, match)
    if focal_px is not None:
        for c, plane in enumerate(views.planes):
            if (task := plane.task).free_focal:
                focal = float(np.broadcast_to(focal_px, len(views.planes))[c])
                state.nuisance[c, 0] = np.log(focal / task.camera.focal_px) / task.focal_sigma
    return settle_state(views, state, trusted=trusted, anywhere=anywhere)


def settle_state(views: Views, state: State, *, trusted: int = 0, anywhere: bool = False) -> Solution | None:
    """`settle` from a state, which is changed."""
    _bind(views, state)
    if settle_kernel(views.sights, state, trusted) != STEADY:
        return None
    if any(plane.task.visible is not None for plane in views.planes) and not _with_hiding(views, state):
        return None
    solution = Solution(views, state)
    for c, plane in enumerate([] if anywhere else views.planes):
        if plane.task.prior is not None and not plane.task.allows(solution.cam_from_model(c), state.camera[c, 0]):
            return None
    return solution


def _bind(views: Views, state: State) -> None:
    for c, plane in enumerate(views.planes):
        if plane.task.binding:
            for spot, marker in plane.task.fixed:
                state.bound[c, marker] = spot
                state.match[c, marker] = spot


def _with_hiding(views: Views, state: State) -> bool:
    """Settle with what hides what. It depends on the pose and the pose on what is matched; it comes to rest at once
    but for markers on a silhouette, which stay as the last pose has them. False where it falls apart.
    """  # fmt: skip
    for _ in range(HIDING_ROUNDS):
        hidden = np.stack([
            plane.task.hidden_from(
                views.layout.frame.pose(state.rotations[c], state.translations[c]), views.camera(c, state.camera[c])
            )
            for c, plane in enumerate(views.planes)
        ])  # fmt: skip
        if (hidden == state.hidden).all():
            return True
        state.hidden[:] = hidden
        state.match[hidden] = -1
        if settle_kernel(views.sights, state, 0) != STEADY:
            return False
    return True


def copied(views: Views, state: State) -> State:
    """A state of its own, with the freedom of other views of the same spots; what it has not had before is zero."""
    own = State._make([part.copy() for part in opened(views, state)])
    own.readings[:] = np.nan  # it is to be changed
    return own


def opened(views: Views, state: State) -> State:
    """The same state with room for the freedom of other views, to be looked at and not to be changed."""
    (c, p), k = (views.loose.shape[0], views.loose.shape[2]), len(views.modes)
    if state.nuisance.shape == (c, p) and len(state.bent) == k:
        return state
    size = 6 + c * p + k
    nuisance = np.zeros((c, p))
    same = min(p, state.nuisance.shape[1])
    nuisance[:, :same] = state.nuisance[:, :same]
    bent = state.bent if len(state.bent) == k else np.zeros(k)
    return state._replace(nuisance=nuisance, bent=bent, factor=np.zeros((size, size)))


def with_freedom(views: Views, solution: Solution, *, relabel: bool = True) -> Solution | None:
    """The solution as it is with the freedom of other views; None where it falls apart."""
    state = copied(views, solution.state)
    if relabel:
        return settle_state(views, state)
    return Solution(views, state) if fit_kernel(views.sights, state) else None


def with_excess(solution: Solution, excess: Array) -> Solution | None:
    """The same labels with each camera's excess (C,) held; None where it falls apart."""
    state = copied(solution.views, solution.state)
    state.numbers[:, EXCESS] = excess
    return replace(solution, state=state) if fit_kernel(solution.views.sights, state) else None


def accepted(solution: Solution) -> Solution:
    """The solution as it is reported: its excess by the residuals alone.

    While labels may still be wrong, the gates are kept a little open. Once they are accepted that doubt has
    no place in the covariance.
    """
    state = copied(solution.views, solution.state)
    if not accept_kernel(solution.views.sights, state):
        return solution
    return replace(solution, state=state)
