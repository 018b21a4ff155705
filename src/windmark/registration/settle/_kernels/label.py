"""Which spot each marker has, from where the unknowns put it: closest first, one to one, each within its gate."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import inverse_factor
from windmark.geometry._jit import nb
from windmark.registration._kernels.hypothesis import GRAZING, _towards
from windmark.registration.settle._kernels.fit import by_unknowns
from windmark.registration.settle._kernels.project import see, sight_of
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
    size, (cameras, n), bent = state.factor.shape[0], state.match.shape, state.bent.shape[0] > 0
    u, v, by_xyz, other = np.empty(size), np.empty(size), np.empty((2, 3)), np.empty(12)
    inverse, normal = inverse_factor(state.factor, size), sights.normal
    pair_m, pair_s, pair_d = np.empty(4 * n, np.int32), np.empty(4 * n, np.int32), np.empty(4 * n)
    for c in range(cameras):
        first, last = sights.first[c], sights.first[c + 1]
        spots, noise, density = sights.xy[first:last], sights.cov[first:last], sights.density[first:last]
        by_x, column, tolerance2 = sights.by_x[first:last], sights.x[first:last], sights.tolerance[c] ** 2
        match, own, place, excess = state.match[c], table[c], state.place[c], state.numbers[c, EXCESS]
        must, faces, hidden, bound = state.must[c], state.faces[c], state.hidden[c], state.bound[c]
        largest, low = 0.0, BORDER + sights.radius[c] - 0.5
        right, bottom = sights.size[c, 0] - 1.0 - low, sights.size[c, 1] - 1.0 - low
        for s in range(last - first):
            largest = max(largest, noise[s, 0] + noise[s, 2])
        # Where the unknowns do not know yet, nothing is expected: the gate must tell a marker from clutter.
        widest = 4.0 * tolerance2 / GATE
        if bent:
            widest = sights.size[c, 0] * sights.size[c, 1] / (math.pi * CLEAR * max(last - first, 1))
        xyz, modes, bend, rot, turn, rot_c, shift_c, cam, loose, offset = sight_of(sights, state, c)
        ex = -(rot_c[0, 0] * shift_c[0] + rot_c[1, 0] * shift_c[1] + rot_c[2, 0] * shift_c[2])
        ey = -(rot_c[0, 1] * shift_c[0] + rot_c[1, 1] * shift_c[1] + rot_c[2, 1] * shift_c[2])
        ez = -(rot_c[0, 2] * shift_c[0] + rot_c[1, 2] * shift_c[1] + rot_c[2, 2] * shift_c[2])
        used = 0
        for m in range(n):
            new[c, m], must[m], faces[m] = -1, False, False
            facing = _towards(normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2])
            if (facing <= 0.0 or hidden[m]) and bound[m] < 0:
                continue
            x, y, valid = see(
                m, xyz, modes, bend, rot, turn, rot_c, shift_c, cam, loose, offset, c, u, v, by_xyz, other
            )  # fmt: skip
            if not valid:
                continue
            by_unknowns(inverse, u, v, size, m, place)
            whole = low < x < right and low < y < bottom  # a detector finds no half discs
            faces[m] = facing > GRAZING
            must[m] = facing > GRAZING and whole and place[m, 0] + place[m, 2] < widest
            if bound[m] >= 0:
                new[c, m] = bound[m]
                continue
            while used + (last - first) > pair_d.shape[0]:
                pair_m, pair_s = np.append(pair_m, pair_m), np.append(pair_s, pair_s)
                pair_d = np.append(pair_d, pair_d)
            used = _near_spots(
                m, x, y, spots, noise, density, by_x, column, own, place, excess, tolerance2, largest, bent, match[m],
                shut, used, pair_m, pair_s, pair_d,
            )  # fmt: skip
        _pair_up(match, bent, last - first, pair_m[:used], pair_s[:used], pair_d[:used], new[c])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _near_spots(
    m: int, x: float, y: float, spots: Array, noise: Array, density: Array, by_x: NDArray[np.int64], column: Array,
    table: Array, place: Array, excess: float, tolerance2: float, largest: float, bent: bool, holds: int, shut: bool,
    used: int, pair_m: Ints, pair_s: Ints, pair_d: Array,
) -> int:  # fmt: skip
    """Append the spots in the gate of marker m, which is seen at (x, y) and ``holds`` a spot or -1."""
    txx, txy, tyy = table[m, 0] + excess, table[m, 1], table[m, 2] + excess
    sxx, sxy, syy = place[m, 0], place[m, 1], place[m, 2]
    reach2 = GATE * (sxx + syy + txx + tyy + largest)
    if not bent:
        reach2 = min(reach2, 9.0 * tolerance2)
    reach = math.sqrt(reach2)
    for at in range(np.searchsorted(column, x - reach), column.shape[0]):
        if column[at] - x > reach:
            break
        s = by_x[at]
        du, dv = x - spots[s, 0], y - spots[s, 1]
        held = holds == s
        if du * du + dv * dv > reach2 or (shut and not held):
            continue
        distance2, root_det = leave_one_out(
            du, dv, txx + noise[s, 0], txy + noise[s, 1], tyy + noise[s, 2], sxx, sxy, syy, held
        )  # fmt: skip
        odds = 1.0 / (2.0 * math.pi * root_det * density[s])
        if distance2 < min(GATE, 2.0 * math.log(odds / (CLEAR if bent and not held else 1.0))):
            pair_m[used], pair_s[used], pair_d[used] = m, s, distance2
            used += 1
    return used


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _pair_up(
    match: Ints, bent: bool, spots: int, pair_m: Ints, pair_s: Ints, pair_d: Array, new: Ints
) -> None:  # fmt: skip
    """Closest first and one to one; of a model that may be bent only pairs that are ahead of all others."""
    n, used = match.shape[0], pair_d.shape[0]
    taken = np.zeros(spots, np.bool_)
    for m in range(n):
        if new[m] >= 0:
            taken[new[m]] = True
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
        if new[m] >= 0 or taken[s]:
            continue
        if bent:
            ahead = HELD_AHEAD if match[m] == s else AHEAD
            if d > best_m[m] or d > best_s[s] or next_m[m] - d < ahead or next_s[s] - d < ahead:
                continue
        new[m] = s
        taken[s] = True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _whole(sights: Sights, c: int, x: float, y: float) -> bool:
    """Whether a spot of the usual size is whole in the image where a marker is: a detector finds no half discs."""
    low = BORDER + sights.radius[c] - 0.5
    return low < x < sights.size[c, 0] - 1.0 - low and low < y < sights.size[c, 1] - 1.0 - low


@nb.njit(cache=True, nogil=True, error_model="numpy")
def leave_one_out(
    du: float, dv: float, xx: float, xy: float, yy: float, sxx: float, sxy: float, syy: float, held: bool
) -> tuple[float, float]:
    """Squared Mahalanobis distance of a spot from where *the others* have its marker, and the root of the determinant.

    ``xx, xy, yy`` is the covariance of the residual but for that of the solution, ``sxx`` and so on. A held pair has
    the covariance D = N - S of its residual r; without it the residual would be N D^-1 r with N D^-1 N, and that is
    the distance r' D^-1 r with the determinant |N|^2 / |D|.
    """
    if not held:
        xx, xy, yy = xx + sxx, xy + sxy, yy + syy
        det = xx * yy - xy * xy
        return (yy * du * du - 2.0 * xy * du * dv + xx * dv * dv) / det, math.sqrt(det)
    floor, own = LEAST_LEFT * (xx + yy), xx * yy - xy * xy
    xx, xy, yy = xx - sxx, xy - sxy, yy - syy
    mean, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    c, s = math.cos(angle), math.sin(angle)
    high, low = max(mean + half, floor), max(mean - half, floor)
    along, across = c * du + s * dv, c * dv - s * du
    return along * along / high + across * across / low, own / math.sqrt(high * low)
