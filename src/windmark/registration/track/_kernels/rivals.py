"""Rivals of a tracked labelling as a numba kernel: by the model's near-symmetries, and mirrored in a plane.

On regular rows a labelling that has slipped by one spacing fits nearly as well. Every near-symmetry of the model makes
such a rival of the solution; those that could come near are refined, and the better worth, of picture and motion
together, decides. Private to the registration room. Readable twin: tests/registration/test_track_rivals.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point, to_camera
from windmark.registration._kernels.evidence import likelihood_ratio
from windmark.registration._kernels.fit import EXPECTED, FOCAL, Fit, Markers, Spots, State
from windmark.registration._kernels.hypothesis import GRAZING, _towards
from windmark.registration._kernels.rival import _mirrored
from windmark.registration._kernels.settle import STEADY, settle_kernel, whole
from windmark.registration.track._kernels.motion import difference, distance2_of, invert_factored
from windmark.registration.track._kernels.spots import Columns, place_of

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

JUMP = 15.0
"""No motion is more unlikely than this (nats): the model may be knocked, so a prediction is never certain."""
TURN, TURN_LEFT = 0.5, 0.5
"""A rival turned by more than this (rad) keeps at least so much of it when it is refined."""
REACH = 0.45
"""A rival's pose before its refinement is wrong by this part of the spacing at most."""
LOOSER = 4.0
"""The covariance of a rival's pose is taken for so many times that of the solution."""
SAME = 0.6
"""With more than this share of the pairs in common a rival is the solution itself."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def worth_of(spots: Spots, state: State) -> float:
    """Log-likelihood ratio of a settled solution with all spots."""
    n, count = state.match.shape[0], 0
    residual, spread, density = np.empty((n, 2)), np.empty((n, 3)), np.empty(n)
    for m in range(n):
        if state.match[m] >= 0:
            residual[count], spread[count] = state.residual[m], state.spread[m]
            density[count] = spots.density[state.match[m]]
            count += 1
    return likelihood_ratio(residual[:count], spread[:count], density[:count], int(state.numbers[EXPECTED]))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def unlikely(state: State, predicted: tuple[Array, Array, Array]) -> float:
    """Nats by which the motion speaks against a solution, see `against`; ``predicted`` is pose and covariance."""
    away, cov = np.empty(6), np.empty((6, 6))
    difference(state.rotation, state.translation, predicted[0], predicted[1], away)
    invert_factored(state.factor, cov)
    return against(distance2_of(away, predicted[2], cov))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def against(distance2: float) -> float:
    """Nats that a squared Mahalanobis distance from the prediction counts for, at most `JUMP`."""
    return min(JUMP, 0.5 * distance2)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def rival_kernel(
    markers: Markers, near: Ints, spots: Spots, columns: Columns, fit: Fit, symmetries: tuple[Ints, Array, Array],
    predicted: tuple[Array, Array, Array], best: State, worth: float, margin: float, rival: State,
) -> float:  # fmt: skip
    """Lead in nats of a solution over its best rival, which is left in ``rival``; infinite if none comes near.

    ``predicted`` is pose and covariance by the motion so far, ``worth`` that of the solution by picture and motion;
    only rivals that can come within ``margin`` are refined.
    """
    onto, turn, shift = symmetries
    n = best.match.shape[0]
    trial = State(
        np.empty((3, 3)), np.empty(3), np.zeros(7), np.empty(n, np.int32), np.zeros((n, 2)), np.zeros((n, 3)),
        np.zeros((7, 7)),
    )  # fmt: skip
    r, t, lead = trial.rotation, trial.translation, math.inf
    gain = -np.log(2.0 * math.pi * _typical_variance(best) * spots.density)
    slack, spread = _slack(markers.xyz, near), np.empty((6, 6))
    invert_factored(best.factor, spread)
    spread = predicted[2] + LOOSER * spread
    for k in range(onto.shape[0] + 1):
        trial.numbers[:] = 0.0
        trial.numbers[FOCAL] = best.numbers[FOCAL]
        if k < onto.shape[0]:
            _moved_back(best, turn[k], shift[k], r, t)
            trial.match[:] = -1
            for m in range(n):
                if onto[k, m] >= 0:
                    trial.match[onto[k, m]] = best.match[m]
            least = worth - margin + _motion_least(r, t, predicted, spread, slack)
            if _most(markers, near, spots, columns, r, t, best.numbers[FOCAL], gain) < least:
                continue
        else:
            _mirrored(markers.xyz, best.match, best.rotation, best.translation, r, t)
            trial.match[:] = best.match
            if _turned_too_far(r, best.rotation, predicted[2]):
                continue
        if settle_kernel(markers, spots, fit, trial, 0) != STEADY or _same(best, trial, k < onto.shape[0]):
            continue
        other = worth - worth_of(spots, trial) + unlikely(trial, predicted)
        if other < lead:
            lead = other
            rival.rotation[:], rival.translation[:], rival.match[:] = r, t, trial.match
            rival.numbers[:] = trial.numbers
    return lead


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _moved_back(best: State, turn: Array, shift: Array, r: Array, t: Array) -> None:
    """The pose that sees a moved model as the solution sees the model."""
    for i in range(3):
        for j in range(3):
            r[i, j] = 0.0
            for k in range(3):
                r[i, j] += best.rotation[i, k] * turn[j, k]
    for i in range(3):
        t[i] = best.translation[i]
        for j in range(3):
            t[i] -= r[i, j] * shift[j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _slack(xyz: Array, near: Ints) -> float:
    """How far the model's centre may move, at most, when a rival is refined; see `REACH`."""
    total, n = 0.0, xyz.shape[0]
    for m in range(n):
        apart = 0.0
        for i in range(3):
            apart += (xyz[m, i] - xyz[near[m, 0], i]) ** 2
        total += math.sqrt(apart)
    return REACH * total / n


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _motion_least(r: Array, t: Array, predicted: tuple[Array, Array, Array], spread: Array, slack: float) -> float:
    """The least that the motion can speak against a rival (nats) once it is refined; see `unlikely`.

    A Mahalanobis distance is never less than that of a part of the coordinates: here of the centre across the line of
    sight, less what the refinement can move it by, and of a large turn.
    """
    away = np.empty(6)
    difference(r, t, predicted[0], predicted[1], away)
    xx, xy, yy = spread[3, 3], spread[3, 4], spread[4, 4]
    across = max(0.0, math.hypot(away[3], away[4]) - slack)
    least = across**2 / (0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy))
    turn = math.sqrt(away[0] ** 2 + away[1] ** 2 + away[2] ** 2)
    if turn > TURN:
        least = max(least, (TURN_LEFT * turn) ** 2 / (spread[0, 0] + spread[1, 1] + spread[2, 2]))
    return min(JUMP, 0.5 * least)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _typical_variance(best: State) -> float:
    total, count = 0.0, 0
    for m in range(best.match.shape[0]):
        if best.match[m] >= 0:
            total += math.sqrt(max(best.spread[m, 0] * best.spread[m, 2] - best.spread[m, 1] ** 2, 1e-300))
            count += 1
    return total / max(count, 1)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _most(
    markers: Markers, near: Ints, spots: Spots, columns: Columns, r: Array, t: Array, f: float, gain: Array
) -> float:
    """The most that a rival can be worth: spots near its markers fit without a residual, worth ``gain`` (M,) each."""
    n, xyz = markers.xyz.shape[0], markers.xyz
    ex = -(r[0, 0] * t[0] + r[1, 0] * t[1] + r[2, 0] * t[2])
    ey = -(r[0, 1] * t[0] + r[1, 1] * t[1] + r[2, 1] * t[2])
    ez = -(r[0, 2] * t[0] + r[1, 2] * t[1] + r[2, 2] * t[2])
    expected, count, total = 0, 0, 0.0
    for m in range(n):
        facing = _towards(markers.normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2])
        x, y, z = to_camera(r, t, xyz[m, 0], xyz[m, 1], xyz[m, 2])
        if z <= 0.0 or facing <= 0.0:
            continue
        u, v, o = f * x / z, f * y / z, near[m, 0]
        px, py, valid = project_point(spots.camera, x / z, y / z, 1.0)
        if not valid:
            continue
        apart = 0.0
        for i in range(3):
            apart += (xyz[m, i] - xyz[o, i]) ** 2
        reach2 = REACH**2 * apart * (f / z) ** 2
        reach, best = math.sqrt(reach2), -math.inf
        for place in range(place_of(columns, u - reach), spots.x.shape[0]):
            s = spots.by_x[place]
            if spots.p[s, 0] - u > reach:
                break
            if (spots.p[s, 0] - u) ** 2 + (spots.p[s, 1] - v) ** 2 < reach2:
                best = max(best, gain[s])
        if best > -math.inf:
            total += best
            count += 1
            expected += 1
        elif facing > GRAZING:
            expected += whole(spots, px, py)
    if count < 4:
        return -math.inf
    p_seen = min(0.95, max(0.25, (count + 1.0) / (expected + 2.0)))
    return total + count * math.log(p_seen) + (expected - count) * math.log(1.0 - p_seen)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _turned_too_far(r: Array, r0: Array, cov: Array) -> bool:
    """Whether a rotation is beyond what the motion allows, by five sigma."""
    away, zero = np.empty(6), np.zeros(3)
    difference(r, zero, r0, zero, away)
    return away[0] ** 2 + away[1] ** 2 + away[2] ** 2 > 25.0 * (cov[0, 0] + cov[1, 1] + cov[2, 2])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _same(best: State, trial: State, by_labels: bool) -> bool:
    """Whether a rival has come back to the solution: mostly its labels, or its rotation."""
    if not by_labels:
        trace = 0.0
        for i in range(3):
            for j in range(3):
                trace += best.rotation[i, j] * trial.rotation[i, j]
        away = math.acos(min(1.0, max(-1.0, 0.5 * (trace - 1.0))))
        spread = np.empty((6, 6))
        invert_factored(best.factor, spread)
        return away**2 < 9.0 * (spread[0, 0] + spread[1, 1] + spread[2, 2])
    shared, one, other = 0, 0, 0
    for m in range(best.match.shape[0]):
        one += best.match[m] >= 0
        other += trial.match[m] >= 0
        shared += best.match[m] >= 0 and best.match[m] == trial.match[m]
    return shared > SAME * min(one, other)
