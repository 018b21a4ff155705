"""Fit, widen or narrow the gates, label again, until all is steady."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.registration.settle._kernels.fit import (
    excess_of,
    refine,
    spread_places,
    taken_of,
    weigh_residuals,
)
from windmark.registration.settle._kernels.label import label
from windmark.registration.settle._kernels.places import open_kernel
from windmark.registration.settle._kernels.state import EXCESS, EXPECTED, TAKEN, Sights, State
from windmark.registration.settle._kernels.worth import worth_kernel

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

OPEN_ROUNDS, ROUNDS = 8, 20
BENT_OPEN_ROUNDS, BENT_ROUNDS = 20, 30
"""Rounds in which pairs may come and go; after them they may only go, so that no cycle remains. A bent model is
labelled from its rigid core outwards."""
FIRST, BENT_FIRST, DOUBT = 8.0, 4.0, 16.0
"""The excess to start with, and the one expected besides the covariances, are the tolerance divided by these."""
SETTLING = 2
"""After so many rounds of a bent model the excess must not be more than at first."""
FINAL_ROUNDS, LUCK = 3, 1.0
"""Rounds of the last fit, and sigma by which its misfit may be above the covariances before it counts as excess."""
STEADY_PART = 0.02
LOST, STEADY = -1, 1


@nb.njit(cache=True, nogil=True, error_model="numpy")
def settle_kernel(sights: Sights, state: State, trusted: int) -> int:
    """Label and refine until nothing changes: STEADY, or LOST if it falls apart or never comes to rest.

    What is steady is weighed: `State.readings` and `State.open`.

    The labels that come stay while the excess settles, for so many rounds at most as they are ``trusted``: looking
    for labels is the larger part of a round.
    """
    (cameras, n), bent = state.match.shape, state.bent.shape[0] > 0
    new, table = np.empty((cameras, n), np.int32), np.zeros((cameras, n, 3))
    rounds, open_rounds = (BENT_ROUNDS, BENT_OPEN_ROUNDS) if bent else (ROUNDS, OPEN_ROUNDS)
    for c in range(cameras):
        state.numbers[c, EXCESS] = (sights.tolerance[c] / (BENT_FIRST if bent else FIRST)) ** 2
        state.numbers[c, TAKEN] = 6.0 / cameras
    for round_ in range(rounds):
        if not refine(sights, state, table):
            return LOST
        exact = bent or cameras > 1 or state.nuisance.shape[1] > 0
        if exact:
            spread_places(sights, state)
        steady = True
        for c in range(cameras):
            if exact:
                state.numbers[c, TAKEN] = taken_of(sights, state, table, c)
            before = state.numbers[c, EXCESS]
            now, noise = excess_of(sights, state, table, c, (sights.tolerance[c] / DOUBT) ** 2, 0.0)
            state.numbers[c, EXCESS] = now
            steady = steady and abs(math.sqrt(now) - math.sqrt(before)) < STEADY_PART * math.sqrt(now + noise) + 1e-300
            if bent and round_ >= SETTLING and now > (sights.tolerance[c] / BENT_FIRST) ** 2:
                return LOST
        if round_ < trusted and not steady:
            continue
        label(sights, state, table, new, round_ >= open_rounds)
        same, match = True, state.match
        for c in range(cameras):
            for m in range(n):
                same = same and new[c, m] == match[c, m]
        if same and steady:
            _count(state)
            weigh_residuals(sights, state, table)
            worth_kernel(sights, state)
            open_kernel(state, state.place)
            return STEADY
        match[:] = new
    return LOST


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _count(state: State) -> None:
    """Markers expected in each camera: those that must be seen and those that are."""
    for c in range(state.match.shape[0]):
        must, match, count = state.must[c], state.match[c], 0
        for m in range(match.shape[0]):
            count += must[m] or match[m] >= 0
        state.numbers[c, EXPECTED] = count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fit_kernel(sights: Sights, state: State) -> bool:
    """The unknowns for labels and excess as they are; residuals, places and taken coordinates with them."""
    table = np.zeros((*state.match.shape, 3))
    state.readings[:] = math.nan
    if not refine(sights, state, table):
        return False
    spread_places(sights, state)
    for c in range(table.shape[0]):
        state.numbers[c, TAKEN] = taken_of(sights, state, table, c)
    weigh_residuals(sights, state, table)
    open_kernel(state, state.place)
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def accept_kernel(sights: Sights, state: State) -> bool:
    """The excess by the residuals alone, once the labels are accepted and the doubt about them has no place."""
    table = np.zeros((*state.match.shape, 3))
    still, state.readings[:] = False, math.nan
    for _ in range(FINAL_ROUNDS):
        if not refine(sights, state, table):
            return False
        spread_places(sights, state)
        still = True
        for c in range(table.shape[0]):
            state.numbers[c, TAKEN] = taken_of(sights, state, table, c)
            before = state.numbers[c, EXCESS]
            state.numbers[c, EXCESS] = excess_of(sights, state, table, c, 0.0, LUCK)[0]
            still = still and state.numbers[c, EXCESS] == before
        if still:
            break
    if not still:  # else the last fit was made with this excess
        if not refine(sights, state, table):
            return False
        spread_places(sights, state)
    weigh_residuals(sights, state, table)
    open_kernel(state, state.place)
    return True
