"""What the settle kernels share: the sights of C cameras on N markers, and a solution that is changed in place.

Unknowns stand in one order everywhere: the pose of the unit model in the rig [rotation 3, translation 3], then for
each camera P *nuisances* (its interior parameters and its place, as far as they are open), then K coefficients of the
deformation.
Nuisances and coefficients are in sigmas of their priors, so the prior of each is the unit normal distribution.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Ints = NDArray[np.int32]
Mask = NDArray[np.bool_]

EXCESS, MISFIT, EXPECTED, TAKEN, NUMBERS = range(5)
"""Columns of `State.numbers`: excess and misfit variance, markers expected, coordinates taken by the fit."""
STEPS, COST_START, COST_END, DECREASE, REPORT = range(5)
"""Places in `State.report`: Gauss-Newton steps of the last fit, its cost at the start and the end, and twice the
decrease that its last step promised."""


PAIRS, ALONE, PIECES, CLOSED, SYSTEMATIC, LOG10_NFA, LEAD, READINGS = range(8)
"""Columns of `State.readings`: the pairs against chance; the markers without a spot if each is missing by itself, if
they are hidden in one piece, and if each is missing by itself and the image has no border; what a smooth misfit
explains better; the false-alarm number; which of the prefixes counts."""
REST, REST_PX, HELD, HELD_PX, OPEN = range(5)
"""Columns of `State.open`: the marker without a spot whose place is most open (-1: none), and its 1 sigma (px); the
marker whose place the pairs without its own leave most open, and that."""
PLACE, WIDE, SHEAR, ROWS = 12, 18, 21, 22
"""Of `Sights.loose`: the first row of a camera's place in the rig and of k4 to k6, that of the shear, and how many."""


class Sights(NamedTuple):
    """C cameras with known places in a rig, their spots one camera after the other, and the N markers."""

    xyz: Array  # (N, 3) markers, centred and scaled to unit size
    normal: Array  # (N, 3), zero where unknown
    near: Ints  # (N, K) other markers, nearest first
    sigma: Array  # (N, 3), zero where unknown
    modes: Array  # (K, N, 3) displacement by 1 sigma of each coefficient
    rotation: Array  # (C, 3, 3) of cam_from_rig
    translation: Array  # (C, 3) of it, in sizes of the model
    first: NDArray[np.int64]  # (C + 1,) first spot of every camera, and the number of all
    xy: Array  # (S, 2) spots in pixels
    cov: Array  # (S, 3) their covariance xx, xy, yy
    density: Array  # (S,) spots per px^2 round each
    leads: NDArray[np.int64]  # (C, L) prefixes of a camera's list that count as one by themselves; 0 for none
    dense: Array  # (L, S) the density among the spots of each prefix
    log_share: Array  # (C, L) what priors and labels leave of the ways to begin with those, as logarithms
    fixed: NDArray[np.int64]  # (C,) pairs that fix pose and camera
    by_x: NDArray[np.int64]  # (S,) spots of a camera in order of x, numbered within the camera
    x: Array  # (S,) that coordinate, in this order
    size: Array  # (C, 2) of the images
    radius: Array  # (C,) px, of the spots; 0 where unknown
    tolerance: Array  # (C,) px, the neighbourhood of the search
    camera: Array  # (C, 17) `Camera.packed`, as given
    loose: Array  # (C, 22, P) change by 1 sigma of each nuisance: of the packed camera, row 0 of the log focal length;
    # from row 12 on of its place [rotation 3, translation 3 in sizes of the model], which comes after cam_from_rig;
    # from row 18 on of k4, k5, k6, shear


class State(NamedTuple):
    """A solution."""

    rotation: Array  # (3, 3) of the unit model in the rig
    translation: Array  # (3,)
    nuisance: Array  # (C, P)
    bent: Array  # (K,)
    camera: Array  # (C, 17) with the nuisances
    rotations: Array  # (C, 3, 3) as each camera sees the model
    translations: Array  # (C, 3)
    numbers: Array  # (C, 4) see EXCESS and the names beside it
    report: Array  # (4,) see STEPS and the names beside it
    match: Ints  # (C, N) spot of every marker, numbered within the camera, or -1
    residual: Array  # (C, N, 2) projected - seen of matched markers
    spread: Array  # (C, N, 3) covariance of the residuals: spot, table and excess
    place: Array  # (C, N, 3) covariance of the projections by that of the unknowns
    must: Mask  # (C, N) markers that should be seen
    faces: Mask  # (C, N) markers that turn towards the camera and that nothing hides, in the image or not
    hidden: Mask  # (C, N) what something hides: neither matched nor expected
    offset: Array  # (C, N, 2) px, of the imaged disc's centre from the projection
    bound: Ints  # (C, N) spots that the markers are bound to, or -1
    factor: Array  # (P', P') lower Cholesky factor of the normal equations, priors included
    readings: Array  # (C, 7) what the labels are worth, see PAIRS and the names beside it; NaN where not weighed
    open: Array  # (C, 4) which places are most open, see REST and the names beside it


def state_of(sights: Sights, rotation: Array, translation: Array, match: Ints) -> State:
    """A state to start from: the pose of the unit model in the rig, and labels (C, N)."""
    state = blank_kernel(sights)
    state.rotation[:], state.translation[:], state.match[:] = rotation, translation, match
    return state


@nb.njit(cache=True, nogil=True)
def blank_kernel(sights: Sights) -> State:
    """A state without labels, and with the cameras as given."""
    c, n, p, k = sights.camera.shape[0], sights.xyz.shape[0], sights.loose.shape[2], sights.modes.shape[0]
    size = 6 + c * p + k
    return State(
        np.zeros((3, 3)), np.zeros(3), np.zeros((c, p)), np.zeros(k), sights.camera.copy(), np.zeros((c, 3, 3)),
        np.zeros((c, 3)), np.zeros((c, NUMBERS)), np.zeros(REPORT), np.full((c, n), -1, np.int32), np.zeros((c, n, 2)),
        np.zeros((c, n, 3)), np.zeros((c, n, 3)), np.zeros((c, n), np.bool_), np.zeros((c, n), np.bool_),
        np.zeros((c, n), np.bool_), np.zeros((c, n, 2)), np.full((c, n), -1, np.int32), np.zeros((size, size)),
        np.full((c, READINGS), np.nan), np.zeros((c, OPEN)),
    )  # fmt: skip


@nb.njit(cache=True, nogil=True)
def with_more(sights: Sights, loose: Array, modes: Array) -> Sights:
    """The same with cameras and a model that may vary in other ways."""
    return Sights(
        sights.xyz, sights.normal, sights.near, sights.sigma, modes, sights.rotation, sights.translation, sights.first,
        sights.xy, sights.cov, sights.density, sights.leads, sights.dense, sights.log_share, sights.fixed, sights.by_x,
        sights.x, sights.size, sights.radius, sights.tolerance, sights.camera, loose,
    )  # fmt: skip


@nb.njit(cache=True, nogil=True)
def wider(sights: Sights, state: State) -> State:
    """A settled state among sights with more freedom than it has had; what is new of it is zero."""
    wide, own = blank_kernel(sights), state.nuisance.shape[1]
    wide.rotation[:], wide.translation[:], wide.nuisance[:, :own] = state.rotation, state.translation, state.nuisance
    if state.bent.shape[0] == wide.bent.shape[0]:
        wide.bent[:] = state.bent
    wide.match[:], wide.residual[:], wide.spread[:] = state.match, state.residual, state.spread
    wide.offset[:] = state.offset
    return wide
