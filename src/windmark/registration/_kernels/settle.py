"""From a candidate to a solution as a numba kernel: fit, widen or narrow the gates, label again, until all is steady.

Private to the registration room; `_kernels.fit` has the fit. Readable twin: tests/registration/test_settle.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import inverse_factor
from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point, to_camera
from windmark.registration._kernels.fit import (
    EXCESS,
    EXPECTED,
    FOCAL,
    Fit,
    Markers,
    Spots,
    State,
    excess_of,
    refine,
    table_spread,
    weigh_residuals,
)  # fmt: skip
from windmark.registration._kernels.growth import _derivative
from windmark.registration._kernels.hypothesis import GRAZING, _towards

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

GATE = 23.0
"""Largest squared Mahalanobis distance of a match (99.999 % of right ones)."""
P_SEEN = 0.5
"""A match must be likelier than a marker that is hidden, beside a foreign spot by the density of spots."""
OPEN_ROUNDS, ROUNDS = 8, 20
"""Rounds in which pairs may come and go; after them they may only go, so that no cycle remains."""
FINAL_ROUNDS = 3
LUCK = 1.0
"""Sigma by which the misfit of an accepted solution may be above the given covariances before it counts as excess."""
BORDER = 2.5
"""A spot that comes this near to the image's border (px) may be cut, and its marker need not be seen."""
LOST, STEADY = -1, 1


@nb.njit(cache=True, nogil=True, error_model="numpy")
def settle_kernel(markers: Markers, spots: Spots, fit: Fit, state: State, trusted: int) -> int:
    """Label and refine until nothing changes: STEADY, or LOST if it falls apart or never comes to rest.

    The labels that come stay while the excess settles, for so many rounds at most as they are ``trusted``: looking
    for labels is the larger part of a round.
    """
    n, numbers, match = markers.xyz.shape[0], state.numbers, state.match
    numbers[EXCESS] = (fit.tolerance / 8.0) ** 2
    doubt2 = (fit.tolerance / 16.0) ** 2
    new, table, must = np.empty(n, np.int32), np.zeros((n, 3)), np.empty(n, np.bool_)
    taken = 7.0 if fit.focal_weight > 0.0 else 6.0
    table_spread(markers, state, table)
    for round_ in range(ROUNDS):
        if not refine(markers.xyz, spots, fit, state, table):
            return LOST
        table_spread(markers, state, table)
        before = numbers[EXCESS]
        numbers[EXCESS], known = excess_of(spots, state, table, doubt2, 0.0, taken)
        steady = abs(math.sqrt(numbers[EXCESS]) - math.sqrt(before)) < 0.02 * math.sqrt(numbers[EXCESS] + known)
        if round_ < trusted and not steady:
            continue
        label(markers, spots, fit, state, table, must, new, round_ >= OPEN_ROUNDS)
        same = True
        for m in range(n):
            same = same and new[m] == match[m]
        if same and steady:
            numbers[EXPECTED] = 0.0
            for m in range(n):
                numbers[EXPECTED] += must[m] or match[m] >= 0
            weigh_residuals(spots, state, table, taken)
            return STEADY
        match[:] = new
    return LOST


@nb.njit(cache=True, nogil=True, error_model="numpy")
def accept_kernel(markers: Markers, spots: Spots, fit: Fit, state: State) -> bool:
    """The excess by the residuals alone, once the labels are accepted and the doubt about them has no place."""
    table, taken = np.zeros((markers.xyz.shape[0], 3)), 7.0 if fit.focal_weight > 0.0 else 6.0
    for round_ in range(FINAL_ROUNDS):
        table_spread(markers, state, table)
        before = state.numbers[EXCESS]
        state.numbers[EXCESS] = excess_of(spots, state, table, 0.0, LUCK, taken)[0]
        if round_ > 0 and state.numbers[EXCESS] == before:
            break  # mostly there is none, and the fit was made with that
        if not refine(markers.xyz, spots, fit, state, table):
            return False
    weigh_residuals(spots, state, table, taken)
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def label(
    markers: Markers, spots: Spots, fit: Fit, state: State, table: Array, must: NDArray[np.bool_], new: Ints, shut: bool
) -> None:
    """Pairs: closest first, one to one, each within its gate; and which markers must be seen.

    A spot that holds the pose already has pulled it, so its residual is *smaller* than its noise by the pose's
    covariance; for any other spot it is larger. Both tests are the same leave-one-out test. With ``shut`` pairs
    may only go.
    """
    n, xyz = markers.xyz.shape[0], markers.xyz
    r, t, f, a, match = state.rotation, state.translation, state.numbers[FOCAL], state.factor, state.match
    size = 7 if fit.focal_weight > 0.0 else 6
    u, v, inverse = np.empty(7), np.empty(7), inverse_factor(a, size)
    pair_m, pair_s, pair_d = np.empty(64, np.int32), np.empty(64, np.int32), np.empty(64)
    used = 0
    ex = -(r[0, 0] * t[0] + r[1, 0] * t[1] + r[2, 0] * t[2])
    ey = -(r[0, 1] * t[0] + r[1, 1] * t[1] + r[2, 1] * t[2])
    ez = -(r[0, 2] * t[0] + r[1, 2] * t[1] + r[2, 2] * t[2])
    largest = 0.0
    for s in range(spots.p.shape[0]):
        largest = max(largest, spots.cov[s, 0] + spots.cov[s, 2])
    for m in range(n):
        new[m], must[m] = -1, False
        facing = _towards(markers.normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2])
        z = to_camera(r, t, xyz[m, 0], xyz[m, 1], xyz[m, 2])[2]
        if z <= 0.0 or facing <= 0.0:
            continue
        _derivative(r, t, f, xyz[m, 0], xyz[m, 1], xyz[m, 2], u, v)
        x, y = u[6], v[6]
        xx, xy, yy = _by_pose(inverse, u, v, size)
        px, py, valid = project_point(spots.camera, x / spots.camera[0], y / spots.camera[0], 1.0)
        if not valid:
            continue
        must[m] = whole(spots, px, py) and facing > GRAZING and (xx + yy) * GATE < 4.0 * fit.tolerance**2
        wide = xx + yy + table[m, 0] + table[m, 2] + 2.0 * state.numbers[EXCESS]
        reach2 = min(GATE * (wide + largest), 9.0 * fit.tolerance**2)
        reach = math.sqrt(reach2)
        for place in range(np.searchsorted(spots.x, x - reach), spots.x.shape[0]):
            s = spots.by_x[place]
            du, dv = x - spots.p[s, 0], y - spots.p[s, 1]
            if du < -reach:
                break
            if du * du + dv * dv > reach2 or (shut and match[m] != s):
                continue
            noise = (
                table[m, 0] + state.numbers[EXCESS] + spots.cov[s, 0], table[m, 1] + spots.cov[s, 1],
                table[m, 2] + state.numbers[EXCESS] + spots.cov[s, 2],
            )  # fmt: skip
            distance2, root_det = _distance2(du, dv, noise, (xx, xy, yy), match[m] == s)
            likely = 2.0 * math.log(P_SEEN / ((1.0 - P_SEEN) * 2.0 * math.pi * root_det * spots.density[s]))
            if distance2 < min(GATE, likely):
                if used == pair_d.shape[0]:
                    pair_m, pair_s = np.append(pair_m, pair_m), np.append(pair_s, pair_s)
                    pair_d = np.append(pair_d, pair_d)
                pair_m[used], pair_s[used], pair_d[used] = m, s, distance2
                used += 1
    taken = np.zeros(spots.p.shape[0], np.bool_)
    for k in np.argsort(pair_d[:used], kind="mergesort"):
        if new[pair_m[k]] < 0 and not taken[pair_s[k]]:
            new[pair_m[k]] = pair_s[k]
            taken[pair_s[k]] = True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def whole(spots: Spots, x: float, y: float) -> bool:
    """Whether a spot of the usual size is whole in the image where a marker is: a detector finds no half discs."""
    low = BORDER + spots.radius - 0.5
    return low < x < spots.size[0] - 1.0 - low and low < y < spots.size[1] - 1.0 - low


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _by_pose(inverse: Array, u: Array, v: Array, size: int) -> tuple[float, float, float]:
    """Covariance of a projection by that of the pose, from the inverse of its Cholesky factor."""
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(size):
        along_u, along_v = 0.0, 0.0
        for k in range(i + 1):
            along_u += inverse[i, k] * u[k]
            along_v += inverse[i, k] * v[k]
        xx += along_u * along_u
        xy += along_u * along_v
        yy += along_v * along_v
    return xx, xy, yy


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _distance2(
    du: float, dv: float, noise: tuple[float, float, float], pose: tuple[float, float, float], held: bool
) -> tuple[float, float]:
    """Squared Mahalanobis distance, and the square root of the determinant of its covariance."""
    if not held:
        xx, xy, yy = noise[0] + pose[0], noise[1] + pose[1], noise[2] + pose[2]
        det = xx * yy - xy * xy
        return (yy * du * du - 2.0 * xy * du * dv + xx * dv * dv) / det, math.sqrt(det)
    # Kept positive where a pair alone determines part of the pose.
    floor = 0.05 * (noise[0] + noise[2])
    xx, xy, yy = noise[0] - pose[0], noise[1] - pose[1], noise[2] - pose[2]
    mean, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    c, s = math.cos(angle), math.sin(angle)
    high, low = max(mean + half, floor), max(mean - half, floor)
    along, across = c * du + s * dv, c * dv - s * du
    return along * along / high + across * across / low, math.sqrt(high * low)
