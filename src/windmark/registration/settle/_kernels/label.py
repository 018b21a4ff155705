"""Which spot each marker has, from where the unknowns put it: closest first, one to one, each within its gate."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import inverse_factor
from windmark.geometry._jit import nb
from windmark.registration._kernels.hypothesis import GRAZING, _towards
from windmark.registration.settle._kernels.fit import by_unknowns
from windmark.registration.settle._kernels.project import see
from windmark.registration.settle._kernels.state import EXCESS, Sights, State

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

GATE = 23.0
"""Largest squared Mahalanobis distance of a match (99.999 % of right ones)."""
CLEAR, AHEAD, HELD_AHEAD = 20.0, 9.0, 4.0
"""Of a model that may be bent the gates are wide: a new pair must be so many times likelier than a foreign spot, and
ahead of every other pair of its marker or its spot by so much in squared distance; less for one that is held."""
LEAST_LEFT = 0.05
"""Least part of its variance that a pair leaves to its residual: a pair alone may determine part of the solution."""
BORDER = 2.5
"""A spot that comes this near to the image's border (px) may be cut, and its marker need not be seen."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def label(sights: Sights, state: State, table: Array, new: Ints, shut: bool) -> None:
    """New labels (C, N), which markers must be seen and which turn to the camera; ``shut``: pairs may only go.

    A spot that holds the solution already has pulled it, so its residual is *smaller* than its noise by the
    projection's covariance; for any other spot it is larger. Both tests are the same leave-one-out test.
    """
    size, (cameras, n) = state.factor.shape[0], state.match.shape
    u, v, by_xyz, other = np.empty(size), np.empty(size), np.empty((2, 3)), np.empty(12)
    inverse = inverse_factor(state.factor, size)
    pair_m, pair_s, pair_d = np.empty(4 * n, np.int32), np.empty(4 * n, np.int32), np.empty(4 * n)
    for c in range(cameras):
        first, last = sights.first[c], sights.first[c + 1]
        largest = 0.0
        for s in range(first, last):
            largest = max(largest, sights.cov[s, 0] + sights.cov[s, 2])
        mean_density = (last - first) / (sights.size[c, 0] * sights.size[c, 1])
        r, t, used = state.rotations[c], state.translations[c], 0
        ex = -(r[0, 0] * t[0] + r[1, 0] * t[1] + r[2, 0] * t[2])
        ey = -(r[0, 1] * t[0] + r[1, 1] * t[1] + r[2, 1] * t[2])
        ez = -(r[0, 2] * t[0] + r[1, 2] * t[1] + r[2, 2] * t[2])
        for m in range(n):
            new[c, m], state.must[c, m], state.faces[c, m] = -1, False, False
            facing = _towards(
                sights.normal, m, ex - sights.xyz[m, 0], ey - sights.xyz[m, 1], ez - sights.xyz[m, 2]
            )  # fmt: skip
            if (facing <= 0.0 or state.hidden[c, m]) and state.bound[c, m] < 0:
                continue
            x, y, valid = see(sights, state, c, m, u, v, by_xyz, other)
            if not valid:
                continue
            place = state.place[c, m]
            by_unknowns(inverse, u, v, size, place)
            state.faces[c, m] = facing > GRAZING
            state.must[c, m] = (
                facing > GRAZING and _whole(sights, c, x, y) and _narrow(sights, c, place, mean_density)
            )  # fmt: skip
            if state.bound[c, m] >= 0:
                new[c, m] = state.bound[c, m]
                continue
            while used + (last - first) > pair_d.shape[0]:
                pair_m, pair_s = np.append(pair_m, pair_m), np.append(pair_s, pair_s)
                pair_d = np.append(pair_d, pair_d)
            used = _near_spots(sights, state, table[c, m], c, m, x, y, largest, shut, used, pair_m, pair_s, pair_d)
        _pair_up(sights, state, c, pair_m[:used], pair_s[:used], pair_d[:used], new)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _near_spots(
    sights: Sights, state: State, table: Array, c: int, m: int, x: float, y: float, largest: float, shut: bool,
    used: int, pair_m: Ints, pair_s: Ints, pair_d: Array,
) -> int:  # fmt: skip
    """Append the spots in the gate of a marker that is seen at (x, y)."""
    first, excess, place, bent = sights.first[c], state.numbers[c, EXCESS], state.place[c, m], state.bent.shape[0] > 0
    wide = place[0] + place[2] + table[0] + table[2] + 2.0 * excess
    reach2 = GATE * (wide + largest)
    if not bent:
        reach2 = min(reach2, 9.0 * sights.tolerance[c] ** 2)
    reach = math.sqrt(reach2)
    column = sights.x[first : sights.first[c + 1]]
    for at in range(np.searchsorted(column, x - reach), column.shape[0]):
        s = sights.by_x[first + at]
        du, dv = x - sights.xy[first + s, 0], y - sights.xy[first + s, 1]
        if du < -reach:
            break
        held = state.match[c, m] == s
        if du * du + dv * dv > reach2 or (shut and not held) or used == pair_d.shape[0]:
            continue
        noise = sights.cov[first + s]
        distance2, root_det = leave_one_out(
            du, dv, table[0] + excess + noise[0], table[1] + noise[1], table[2] + excess + noise[2], place, held
        )  # fmt: skip
        odds = 1.0 / (2.0 * math.pi * root_det * sights.density[first + s])
        if distance2 < min(GATE, 2.0 * math.log(odds / (CLEAR if bent and not held else 1.0))):
            pair_m[used], pair_s[used], pair_d[used] = m, s, distance2
            used += 1
    return used


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _pair_up(sights: Sights, state: State, c: int, pair_m: Ints, pair_s: Ints, pair_d: Array, new: Ints) -> None:
    """Closest first and one to one; of a model that may be bent only pairs that are ahead of all others."""
    n, used, spots = state.match.shape[1], pair_d.shape[0], sights.first[c + 1] - sights.first[c]
    taken = np.zeros(spots, np.bool_)
    for m in range(n):
        if new[c, m] >= 0:
            taken[new[c, m]] = True
    bent = state.bent.shape[0] > 0
    best_m, next_m = np.full(n, math.inf), np.full(n, math.inf)
    best_s, next_s = np.full(spots, math.inf), np.full(spots, math.inf)
    if bent:
        for k in range(used):
            m, s, d = pair_m[k], pair_s[k], pair_d[k]
            next_m[m] = min(next_m[m], max(best_m[m], d))
            best_m[m] = min(best_m[m], d)
            next_s[s] = min(next_s[s], max(best_s[s], d))
            best_s[s] = min(best_s[s], d)
    for k in np.argsort(pair_d, kind="mergesort"):
        m, s, d = pair_m[k], pair_s[k], pair_d[k]
        if new[c, m] >= 0 or taken[s]:
            continue
        if bent:
            ahead = HELD_AHEAD if state.match[c, m] == s else AHEAD
            if d > best_m[m] or d > best_s[s] or next_m[m] - d < ahead or next_s[s] - d < ahead:
                continue
        new[c, m] = s
        taken[s] = True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _whole(sights: Sights, c: int, x: float, y: float) -> bool:
    """Whether a spot of the usual size is whole in the image where a marker is: a detector finds no half discs."""
    low = BORDER + sights.radius[c] - 0.5
    return low < x < sights.size[c, 0] - 1.0 - low and low < y < sights.size[c, 1] - 1.0 - low


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _narrow(sights: Sights, c: int, place: Array, mean_density: float) -> bool:
    """Whether a marker's gate tells it from clutter; where the unknowns do not know yet, nothing is expected."""
    wide = place[0] + place[2]
    if sights.modes.shape[0] > 0:
        return math.pi * wide * mean_density < 1.0 / CLEAR
    return wide * GATE < 4.0 * sights.tolerance[c] ** 2


@nb.njit(cache=True, nogil=True, error_model="numpy")
def leave_one_out(
    du: float, dv: float, xx: float, xy: float, yy: float, place: Array, held: bool
) -> tuple[float, float]:
    """Squared Mahalanobis distance of a spot from where *the others* have its marker, and the root of the determinant.

    ``xx, xy, yy`` is the covariance of the residual but for that of the solution, ``place``. A pair that is held has
    the covariance D = N - S of its residual r; without it the residual would be N D^-1 r with N D^-1 N, and that is
    the distance r' D^-1 r with the determinant |N|^2 / |D|.
    """
    if not held:
        xx, xy, yy = xx + place[0], xy + place[1], yy + place[2]
        det = xx * yy - xy * xy
        return (yy * du * du - 2.0 * xy * du * dv + xx * dv * dv) / det, math.sqrt(det)
    floor, own = LEAST_LEFT * (xx + yy), xx * yy - xy * xy
    xx, xy, yy = xx - place[0], xy - place[1], yy - place[2]
    mean, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    c, s = math.cos(angle), math.sin(angle)
    high, low = max(mean + half, floor), max(mean - half, floor)
    along, across = c * du + s * dv, c * dv - s * du
    return along * along / high + across * across / low, own / math.sqrt(high * low)
