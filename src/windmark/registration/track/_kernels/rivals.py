"""Rivals of a tracked labelling as a numba kernel: by the model's near-symmetries, and mirrored in a plane.

On regular rows a labelling that has slipped by one spacing fits nearly as well. Every near-symmetry of the model makes
such a rival of the solution; those that could come near are settled, and the better worth, of picture and motion
together, decides. Private to the registration room. Readable twin: tests/registration/test_track_rivals.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point, to_camera
from windmark.registration._kernels.hypothesis import GRAZING, _towards
from windmark.registration._kernels.rival import _mirrored, moved_back
from windmark.registration.settle._kernels.label import whole_within
from windmark.registration.settle._kernels.settle import STEADY, settle_kernel
from windmark.registration.settle._kernels.state import (
    ALONE,
    CLOSED,
    PAIRS,
    PIECES,
    SYSTEMATIC,
    Sights,
    State,
    blank_kernel,
)
from windmark.registration.settle._kernels.worth import _alone, smooth_kernel
from windmark.registration.track._kernels.motion import difference, distance2_of, invert_factored

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
def lead_of(best: Array, other: Array) -> float:
    """Lead (nats) of one solution's readings over another's, in the reading that is worst for it.

    As `Solution.lead_over`; the freedom of the pose costs both the same, since the motion is its prior and far wider.
    """
    hiding = max(best[ALONE], best[PIECES]) - max(other[ALONE], other[PIECES])
    closed = max(best[CLOSED], best[PIECES]) - max(other[CLOSED], other[PIECES])
    return best[PAIRS] - other[PAIRS] + min(hiding, closed) + min(0.0, best[SYSTEMATIC] - other[SYSTEMATIC])


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
    sights: Sights, symmetries: tuple[Ints, Array, Array], predicted: tuple[Array, Array, Array],
    best: State, margin: float, rival: State,
) -> float:  # fmt: skip
    """Lead in nats of a solution over its best rival, which is left in ``rival``; infinite if none comes near.

    ``predicted`` is pose and covariance by the motion so far; only rivals that can come within ``margin`` by picture
    and motion are refined.
    """
    onto, turn, shift = symmetries
    n, trial, lead, readings = best.match.shape[1], blank_kernel(sights), math.inf, best.readings[0]
    columns = _columns(sights.x)
    r, t, own = trial.rotation, trial.translation, unlikely(best, predicted)
    gain = -np.log(2.0 * math.pi * _typical_variance(best) * sights.density)
    slack, spread = _slack(sights.xyz, sights.near), np.empty((6, 6))
    invert_factored(best.factor, spread)
    spread = predicted[2] + LOOSER * spread
    for k in range(onto.shape[0] + 1):
        trial.nuisance[:] = 0.0
        if k < onto.shape[0]:
            moved_back(best.rotation, best.translation, turn[k], shift[k], r, t)
            trial.match[:] = -1
            for m in range(n):
                if onto[k, m] >= 0:
                    trial.match[0, onto[k, m]] = best.match[0, m]
            least = _motion_least(r, t, predicted, spread, slack) - own
            if least + _least_lead(sights, columns, r, t, gain, readings) >= margin:
                continue
        else:
            _mirrored(sights.xyz, best.match[0], best.rotation, best.translation, r, t)
            trial.match[:] = best.match
            if _turned_too_far(r, best.rotation, predicted[2]):
                continue
        if settle_kernel(sights, trial, 0) != STEADY or _same(best, trial, k < onto.shape[0]):
            continue
        smooth_kernel(sights, best)
        smooth_kernel(sights, trial)
        other = lead_of(readings, trial.readings[0]) + unlikely(trial, predicted) - own
        if other < lead:
            lead = other
            rival.rotation[:], rival.translation[:], rival.match[:] = r, t, trial.match
    return lead


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
    for m in range(best.match.shape[1]):
        if best.match[0, m] >= 0:
            total += math.sqrt(max(best.spread[0, m, 0] * best.spread[0, m, 2] - best.spread[0, m, 1] ** 2, 1e-300))
            count += 1
    return total / max(count, 1)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _least_lead(sights: Sights, columns: Ints, r: Array, t: Array, gain: Array, readings: Array) -> float:
    """The least lead over a rival at a pose: spots near its markers fit without residuals, worth ``gain`` (M,) each."""
    n, xyz, camera = sights.xyz.shape[0], sights.xyz, sights.camera[0]
    ex = -(r[0, 0] * t[0] + r[1, 0] * t[1] + r[2, 0] * t[2])
    ey = -(r[0, 1] * t[0] + r[1, 1] * t[1] + r[2, 1] * t[2])
    ez = -(r[0, 2] * t[0] + r[1, 2] * t[1] + r[2, 2] * t[2])
    expected, faces, count, total, (low, right, bottom) = 0, 0, 0, 0.0, whole_within(sights, 0)
    for m in range(n):
        facing = _towards(sights.normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2])
        x, y, z = to_camera(r, t, xyz[m, 0], xyz[m, 1], xyz[m, 2])
        u, v, valid = project_point(camera, x, y, z)
        if facing <= 0.0 or not valid:
            continue
        apart, o = 0.0, sights.near[m, 0]
        for i in range(3):
            apart += (xyz[m, i] - xyz[o, i]) ** 2
        reach2 = REACH**2 * apart * (camera[0] / z) ** 2
        reach, best = math.sqrt(reach2), -math.inf
        for place in range(_place_of(sights.x, columns, u - reach), sights.x.shape[0]):
            s = sights.by_x[place]
            if sights.xy[s, 0] - u > reach:
                break
            if (sights.xy[s, 0] - u) ** 2 + (sights.xy[s, 1] - v) ** 2 < reach2:
                best = max(best, gain[s])
        if best > -math.inf:
            total += best
            count += 1
            expected += 1
            faces += 1
        elif facing > GRAZING:
            expected += low < u < right and low < v < bottom
            faces += 1
    if count < 4:
        return math.inf
    # What is hidden in one piece costs the logarithm of the number of markers at least.
    pieces = -math.log(n)
    hiding = max(readings[ALONE], readings[PIECES]) - max(_alone(count, expected), pieces)
    closed = max(readings[CLOSED], readings[PIECES]) - max(_alone(count, faces), pieces)
    return readings[PAIRS] - total + min(hiding, closed)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _columns(x: Array) -> Ints:
    """Of twice as many columns as there are spots, in order of x: the place of the first spot in it or right of it.

    For the many questions of `_least_lead` a table is faster than a search by halves.
    """
    m, place = x.shape[0], 0
    first, per_px = np.empty(2 * m, np.int32), _per_px(x)
    for column in range(2 * m):
        while place < m and (x[place] - x[0]) * per_px < column:
            place += 1
        first[column] = place
    return first


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _per_px(x: Array) -> float:
    return 2 * x.shape[0] / max(x[-1] - x[0], 1e-9)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _place_of(x: Array, columns: Ints, at: float) -> int:
    """A place in the order by x that no spot at ``at`` or right of it comes before."""
    column = (at - x[0]) * _per_px(x)
    if not column > 0.0:
        return 0
    return columns[int(min(column, columns.shape[0] - 1.0))]


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
    for m in range(best.match.shape[1]):
        one += best.match[0, m] >= 0
        other += trial.match[0, m] >= 0
        shared += best.match[0, m] >= 0 and best.match[0, m] == trial.match[0, m]
    return shared > SAME * min(one, other)
