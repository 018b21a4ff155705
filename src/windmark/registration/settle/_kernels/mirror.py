"""Which mirror images of a solution its residuals allow, as numba kernels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.registration._kernels.rival import _mirrored, moved_back
from windmark.registration.settle._kernels.fit import MOST_STEPS, refine
from windmark.registration.settle._kernels.state import COST_END, DECREASE, EXCESS, Sights, State, blank_kernel

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

HOPELESS = 8.0
"""Of residuals whose root mean square the first step promises to bring to so many times what is allowed, the median
does not come down to it."""
FARTHER2 = 25.0
"""Nor of others that would have to move by the root of so many times what the next step moves them (in their sigmas).
"""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def mirrors_kernel(
    sights: Sights, best: State, onto: Ints, turn: Array, shift: Array, reach: Array, across: Array
) -> tuple[NDArray[np.bool_], Array, Array, Array, Array]:
    """Which of B mirror images leave residuals (their median) within ``reach`` (C,), in every camera, and their poses.

    ``sights`` has the mirrored table; with image b the spots of marker m are those of marker ``onto[b, m]`` (of none:
    -1), and the model is seen from where ``turn`` (B, 3, 3) and ``shift`` (B, 3) put it. Of a model that is nearly flat
    ``across`` (3,), which is else zero, as many more follow, see `with_twins`. Those that need more steps than a fit
    may take leave none.

    Returns
    -------
    (B,) whether they do, and (B, 3, 3), (B, 3), (B, C, P) and (B, K) their poses, nuisances and coefficients at rest.
    """
    turn, shift = with_twins(best, turn, shift, across)
    (cameras, n), count, state = best.match.shape, turn.shape[0], blank_kernel(sights)
    out, table, away = np.zeros(count, np.bool_), np.zeros((cameras, n, 3)), np.empty(n)
    rotation, translation = np.zeros((count, 3, 3)), np.zeros((count, 3))
    nuisance, bent = np.zeros((count, cameras, state.nuisance.shape[1])), np.zeros((count, state.bent.shape[0]))
    for b in range(count):
        start(best, state, onto[b % onto.shape[0]], turn[b], shift[b])
        out[b] = _is_allowed(sights, state, table, reach, away)
        rotation[b], translation[b] = state.rotation, state.translation
        nuisance[b], bent[b] = state.nuisance, state.bent
    return out, rotation, translation, nuisance, bent


@nb.njit(cache=True, nogil=True, error_model="numpy")
def with_twins(best: State, turn: Array, shift: Array, across: Array) -> tuple[Array, Array]:
    """The same mirror images, of a nearly flat model also from the other pose that shows a plane nearly so.

    Seen from afar a relief looks like the reversed one that is tilted the other way, so where the relief is reversed,
    the best solution is tilted the wrong way.
    """
    if not across.any():
        return turn, shift
    images, most, c = turn.shape[0], -1, 0
    for other in range(best.match.shape[0]):
        count = (best.match[other] >= 0).sum()
        if count > most:
            most, c = count, other
    plane, sight, towards = np.eye(3), np.eye(3), np.zeros(3)
    for i in range(3):
        for j in range(3):
            towards[i] += best.rotations[c, j, i] * best.translations[c, j]
    away2 = towards[0] ** 2 + towards[1] ** 2 + towards[2] ** 2
    for i in range(3):
        for j in range(3):
            plane[i, j] -= 2.0 * across[i] * across[j]
            sight[i, j] -= 2.0 * towards[i] * towards[j] / away2
    turns, shifts = np.empty((2 * images, 3, 3)), np.empty((2 * images, 3))
    turns[:images], shifts[:images] = turn, shift
    for b in range(images):
        turns[images + b] = plane @ turn[b] @ sight
        shifts[images + b] = turns[images + b] @ (shift[b] @ turn[b])
    return turns, shifts


@nb.njit(cache=True, nogil=True, error_model="numpy")
def twin_kernel(sights: Sights, best: State, reach: Array) -> tuple[bool, Array, Array]:
    """The other pose that sees nearly flat markers almost the same, and whether its residuals (their median) come
    within ``reach`` (C,) with the labels as they are.

    The solution is mirrored in the plane of the matched markers and across the line of sight of the camera with most
    of them.
    """  # fmt: skip
    (cameras, n), state, most, c = best.match.shape, blank_kernel(sights), -1, 0
    for other in range(cameras):
        count = 0
        for m in range(n):
            count += best.match[other, m] >= 0
        if count > most:
            most, c = count, other
    rot, shift, seen_rot, seen_shift = best.rotations[c], best.translations[c], np.empty((3, 3)), np.empty(3)
    _mirrored(sights.xyz, best.match[c], rot, shift, seen_rot, seen_shift)
    rotation, translation = np.zeros((3, 3)), best.translation.copy()
    for i in range(3):
        for j in range(3):
            # From the camera's axes to those of the unknowns.
            back = best.rotation[i, 0] * rot[j, 0] + best.rotation[i, 1] * rot[j, 1] + best.rotation[i, 2] * rot[j, 2]
            translation[i] += back * (seen_shift[j] - shift[j])
            for k in range(3):
                rotation[i, k] += back * seen_rot[j, k]
    state.rotation[:], state.translation[:], state.match[:] = rotation, translation, best.match
    for other in range(cameras):
        state.numbers[other, EXCESS] = best.numbers[other, EXCESS]
    near = _is_allowed(sights, state, np.zeros((cameras, n, 3)), reach, np.empty(n))
    return near, rotation, translation


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _is_allowed(sights: Sights, state: State, table: Array, reach: Array, away: Array) -> bool:
    """Whether what is begun comes to rest with residuals (their median) within ``reach``; ``away`` (N,) is scratch."""
    refine(sights, state, table, 1)
    promised = 2.0 * state.report[COST_END] - state.report[DECREASE]
    if not promised < HOPELESS**2 * _allowed(sights, state, table, reach):
        return False
    return _comes_near(sights, state, table, reach, away)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _variance(sights: Sights, state: State, table: Array, c: int, m: int) -> float:
    """Of the residual of a matched marker, per coordinate."""
    s = sights.first[c] + state.match[c, m]
    given = sights.cov[s, 0] + sights.cov[s, 2] + table[c, m, 0] + table[c, m, 2]
    return 0.5 * given + state.numbers[c, EXCESS]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _allowed(sights: Sights, state: State, table: Array, reach: Array) -> float:
    """Sum of squares, in sigmas, of residuals that are all as large as they may be."""
    total = 0.0
    for c in range(state.match.shape[0]):
        for m in range(state.match.shape[1]):
            if state.match[c, m] >= 0:
                total += reach[c] ** 2 / _variance(sights, state, table, c, m)
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _comes_near(sights: Sights, state: State, table: Array, reach: Array, away: Array) -> bool:
    """Whether the residuals' medians come within ``reach``; given up as soon as the steps are too small for that."""
    for _ in range(MOST_STEPS - 1):  # besides the first one
        if refine(sights, state, table, 1):
            return refine(sights, state, table) and _loosest(state, reach, away) <= 1.0
        if not _still_to_go(sights, state, table, reach, away) < FARTHER2 * state.report[DECREASE] < math.inf:
            return False
    return False


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _still_to_go(sights: Sights, state: State, table: Array, reach: Array, away: Array) -> float:
    """Least sum of squares, in sigmas, by which residuals must change to bring their median within ``reach``.

    Of the worst camera. A Gauss-Newton step changes all residuals by the decrease that it promises.
    """
    worst = 0.0
    for c in range(state.match.shape[0]):
        count, match, residual = 0, state.match[c], state.residual[c]
        for m in range(match.shape[0]):
            if match[m] >= 0:
                beyond = max(0.0, math.hypot(residual[m, 0], residual[m, 1]) - reach[c])
                away[count] = beyond**2 / _variance(sights, state, table, c, m)
                count += 1
        worst = max(worst, np.sort(away[:count])[: count // 2].sum())
    return worst


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _loosest(state: State, reach: Array, away: Array) -> float:
    """Median residual of the worst camera, in units of its ``reach``; ``away`` (N,) is scratch."""
    worst = 0.0
    for c in range(state.match.shape[0]):
        count, match, residual = 0, state.match[c], state.residual[c]
        for m in range(match.shape[0]):
            if match[m] >= 0:
                away[count] = math.hypot(residual[m, 0], residual[m, 1])
                count += 1
        if count > 0:
            worst = max(worst, np.median(away[:count]) / reach[c])
    return worst


@nb.njit(cache=True, nogil=True, error_model="numpy")
def start(best: State, state: State, onto: Ints, turn: Array, shift: Array) -> None:
    """Begin ``state`` as a mirror image of a solution; markers that stand for what that does not see are hidden."""
    cameras, n = best.match.shape
    state.match[:], state.hidden[:] = -1, False
    state.nuisance[:], state.bent[:] = 0.0, 0.0
    moved_back(best.rotation, best.translation, turn, shift, state.rotation, state.translation)
    for c in range(cameras):
        state.numbers[c, EXCESS] = best.numbers[c, EXCESS]
        for m in range(n):
            if onto[m] >= 0:
                state.match[c, onto[m]] = best.match[c, m]
                state.hidden[c, onto[m]] = not (best.faces[c, m] or best.match[c, m] >= 0)
