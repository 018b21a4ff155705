"""Labels and pose of a model seen by several cameras at once, as numba kernels: `settle` with one pose for all of them.

Private to the registration room. The pose is that of the unit model in the frame of the rig. Camera c sees it with
the rotation ``Rc R`` and the translation ``Rc t + Tc``, so a step of the pose is, in the camera's frame, the same
step turned by Rc: normal equations are summed in the rig's frame, and the pose's uncertainty is turned back into
each camera's, where `label` opens the gates by it. Readable twin: tests/registration/test_rig_kernels.py.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import cholesky, solve_factored
from windmark.geometry._jit import nb
from windmark.registration._kernels.fit import (
    EXCESS,
    EXPECTED,
    FOCAL,
    MIN_MATCHES,
    STEPS,
    Fit,
    Markers,
    Spots,
    State,
    add_normal_equations,
    excess_of,
    residuals,
    table_spread,
    weigh_residuals,
)  # fmt: skip
from windmark.registration._kernels.growth import _move
from windmark.registration._kernels.settle import FINAL_ROUNDS, LOST, LUCK, OPEN_ROUNDS, ROUNDS, STEADY, label

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

FIT_STEPS, FIT_START, FIT_END = range(3)
"""Places in `RigState.fit`: steps, cost at the start and at the end."""


class Rig(NamedTuple):
    """C cameras with known relative poses and their spots, camera after camera (see `Spots`)."""

    rotation: Array  # (C, 3, 3) of cam_from_rig
    translation: Array  # (C, 3) of it, in sizes of the model
    first: NDArray[np.int64]  # (C + 1,) first spot of every camera, and the number of all
    p: Array
    cov: Array
    density: Array
    by_x: NDArray[np.int64]  # numbered within the camera
    x: Array
    camera: Array  # (C, 12) packed
    size: Array  # (C, 2)
    radius: Array  # (C,)
    tolerance: Array  # (C,)


class RigState(NamedTuple):
    """A solution, changed in place; from ``numbers`` on as in `State`, for each camera."""

    rotation: Array  # (3, 3) of the unit model in the rig
    translation: Array  # (3,)
    factor: Array  # (6, 6) Cholesky factor of the normal equations in the rig's frame
    fit: Array  # (3,) see FIT_STEPS and the names beside it
    taken: Array  # (C,) coordinates that the fit has taken of each camera, six together
    rotations: Array  # (C, 3, 3)
    translations: Array  # (C, 3)
    numbers: Array  # (C, 7)
    match: Ints  # (C, N)
    residual: Array  # (C, N, 2)
    spread: Array  # (C, N, 3)
    factors: Array  # (C, 7, 7)


def rig_state_of(rotation: Array, translation: Array, focal: Array, match: Ints) -> RigState:
    """A state to start from: pose of the unit model in the rig, focal length and labels (C, N) of every camera."""
    (c, n), numbers = match.shape, np.zeros((len(focal), 7))
    numbers[:, FOCAL] = focal
    return RigState(
        np.array(rotation), np.array(translation), np.zeros((6, 6)), np.zeros(3), np.zeros(c), np.zeros((c, 3, 3)),
        np.zeros((c, 3)), numbers, np.array(match, dtype=np.int32), np.zeros((c, n, 2)), np.zeros((c, n, 3)),
        np.zeros((c, 7, 7)),
    )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def settle_rig_kernel(markers: Markers, rig: Rig, state: RigState) -> int:
    """Label and refine in all cameras until nothing changes: STEADY, or LOST if it falls apart or never rests."""
    cameras, n = state.match.shape
    table, new, must = np.zeros((cameras, n, 3)), np.empty((cameras, n), np.int32), np.empty((cameras, n), np.bool_)
    for c in range(cameras):
        state.numbers[c, EXCESS] = (rig.tolerance[c] / 8.0) ** 2
    for round_ in range(ROUNDS):
        if not refine_rig(markers, rig, state, table):
            return LOST
        same = True
        for c in range(cameras):
            one, spots, fit = _state(state, c), _spots(rig, c), Fit(rig.tolerance[c], 1.0, 0.0)
            before = one.numbers[EXCESS]
            known = _excess(spots, one, table[c], (rig.tolerance[c] / 16.0) ** 2, 0.0, state.taken[c])
            label(markers, spots, fit, one, table[c], must[c], new[c], round_ >= OPEN_ROUNDS)
            for m in range(n):
                same = same and new[c, m] == one.match[m]
            change = abs(math.sqrt(one.numbers[EXCESS]) - math.sqrt(before))
            same = same and change <= 0.02 * math.sqrt(one.numbers[EXCESS] + known)
        if same:
            for c in range(cameras):
                state.numbers[c, EXPECTED] = 0.0
                for m in range(n):
                    state.numbers[c, EXPECTED] += must[c, m] or state.match[c, m] >= 0
                weigh_residuals(_spots(rig, c), _state(state, c), table[c], state.taken[c])
            return STEADY
        state.match[:] = new
    return LOST


@nb.njit(cache=True, nogil=True, error_model="numpy")
def accept_rig_kernel(markers: Markers, rig: Rig, state: RigState) -> bool:
    """The excess of every camera by its residuals alone, once the labels are accepted."""
    cameras, n = state.match.shape
    table = np.zeros((cameras, n, 3))
    for c in range(cameras):
        table_spread(markers, _state(state, c), table[c])
    for _ in range(FINAL_ROUNDS):
        for c in range(cameras):
            _excess(_spots(rig, c), _state(state, c), table[c], 0.0, LUCK, state.taken[c])
        if not refine_rig(markers, rig, state, table):
            return False
    for c in range(cameras):
        weigh_residuals(_spots(rig, c), _state(state, c), table[c], state.taken[c])
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def refine_rig(markers: Markers, rig: Rig, state: RigState, table: Array) -> bool:
    """Weighted least squares of the pose by the pairs of all cameras; False if it is singular or runs away.

    The markers' part of the spread, ``table`` (C, N, 3), is brought up to date.
    """
    cameras, pairs = state.match.shape[0], 0
    for s in state.match.flat:
        if s >= 0:
            pairs += 1
    if pairs < MIN_MATCHES:
        return False
    parts, a, g, decrease = np.empty((cameras, 6, 6)), state.factor, np.empty(6), 0.0
    for _ in range(STEPS):
        cost = _sum_up(markers.xyz, rig, state, table, parts, g)
        a[:] = 0.0
        for c in range(cameras):
            a += parts[c]
        if not cholesky(a, 6, 1e-12):
            return False
        if state.fit[FIT_STEPS] == 0.0:
            state.fit[FIT_START] = cost
        state.fit[FIT_STEPS] += 1.0
        state.fit[FIT_END] = cost
        step, decrease = g.copy(), 0.0
        solve_factored(a, step, 6)
        for i in range(6):
            decrease += g[i] * step[i]
        if step[0] ** 2 + step[1] ** 2 + step[2] ** 2 > 1.0:
            return False
        if decrease < 1e-12:
            break
        _move(state.rotation, state.translation, step)
    _place(rig, state)
    for c in range(cameras):
        residuals(markers.xyz, _spots(rig, c).p, _state(state, c))
        table_spread(markers, _state(state, c), table[c])
    return decrease < 1e-6 and _hand_out(rig, state, parts)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _sum_up(xyz: Array, rig: Rig, state: RigState, table: Array, parts: Array, g: Array) -> float:
    """Normal equations of every camera, turned into the rig's frame; their right side summed, and the cost."""
    _place(rig, state)
    cost, own, side = 0.0, np.empty((6, 6)), np.empty(6)
    g[:] = 0.0
    for c in range(rig.rotation.shape[0]):
        own[:] = 0.0
        side[:] = 0.0
        cost += add_normal_equations(xyz, _spots(rig, c), _state(state, c), table[c], 6, own, side)
        for i in range(6):
            for j in range(i):
                own[j, i] = own[i, j]
        r = rig.rotation[c]
        _turn(own, np.ascontiguousarray(r.T), parts[c])
        for i in range(6):
            for k in range(3):
                g[i] += r[k, i % 3] * side[3 * (i // 3) + k]
    return cost


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _turn(a: Array, r: Array, out: Array) -> None:
    """``B a B'`` with B = diag(r, r)."""
    for i in range(6):
        for j in range(6):
            total = 0.0
            for k in range(3):
                for m in range(3):
                    total += r[i % 3, k] * r[j % 3, m] * a[3 * (i // 3) + k, 3 * (j // 3) + m]
            out[i, j] = total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _hand_out(rig: Rig, state: RigState, parts: Array) -> bool:
    """The joint uncertainty as each camera sees it, and how many coordinates the fit has taken of it."""
    total, own, column = np.zeros((6, 6)), np.empty((6, 6)), np.empty(6)
    for part in parts:
        total += part
    for c in range(parts.shape[0]):
        state.taken[c] = 0.0
        for i in range(6):
            column[:] = parts[c, :, i]
            solve_factored(state.factor, column, 6)
            state.taken[c] += column[i]
        _turn(total, rig.rotation[c], own)
        if not cholesky(own, 6, 1e-12):
            return False
        state.factors[c, :6, :6] = own
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _excess(spots: Spots, one: State, table: Array, doubt2: float, luck: float, taken: float) -> float:
    """Set the excess of a camera; the mean variance of its spots. Without pairs it is only doubted."""
    for s in one.match:
        if s >= 0:
            one.numbers[EXCESS], known = excess_of(spots, one, table, doubt2, luck, taken)
            return known
    one.numbers[EXCESS] = doubt2
    return 0.0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _place(rig: Rig, state: RigState) -> None:
    """The pose as every camera sees it."""
    for c in range(rig.rotation.shape[0]):
        for i in range(3):
            state.translations[c, i] = rig.translation[c, i]
            for k in range(3):
                state.translations[c, i] += rig.rotation[c, i, k] * state.translation[k]
            for j in range(3):
                total = 0.0
                for k in range(3):
                    total += rig.rotation[c, i, k] * state.rotation[k, j]
                state.rotations[c, i, j] = total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _spots(rig: Rig, c: int) -> Spots:
    a, b = rig.first[c], rig.first[c + 1]
    return Spots(
        rig.p[a:b], rig.cov[a:b], rig.density[a:b], rig.by_x[a:b], rig.x[a:b], rig.camera[c], rig.size[c],
        rig.radius[c],
    )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _state(state: RigState, c: int) -> State:
    return State(
        state.rotations[c], state.translations[c], state.numbers[c], state.match[c],
        state.residual[c], state.spread[c], state.factors[c],
    )  # fmt: skip
