"""Which spot each marker has, from where the unknowns put it: closest first, one to one, each within its gate."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import inverse_factor
from windmark.geometry._jit import nb
from windmark.registration._kernels.hypothesis import GRAZING, _towards
from windmark.registration._kernels.near import first_from
from windmark.registration.settle._kernels.fit import by_unknowns
from windmark.registration.settle._kernels.project import room_for, see
from windmark.registration.settle._kernels.state import EXCESS, Mask, Sights, State

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
    cameras, n = state.match.shape
    inverse, (xy, by) = inverse_factor(state.factor, state.factor.shape[0]), room_for(state)
    for c in range(cameras):
        see(sights, state, c, _facing(sights, state, c), xy, by)
        by_unknowns(inverse, xy, by, state.place[c])
        _expect(sights, state, c, xy)
        pair_m, pair_s, pair_d = _in_gates(sights, state, c, xy, table[c], shut)
        for m in range(n):
            new[c, m] = state.bound[c, m] if not math.isnan(xy[m, 0]) else -1
        spots = sights.first[c + 1] - sights.first[c]
        _pair_up(state.match[c], state.bent.shape[0] > 0, spots, pair_m, pair_s, pair_d, new[c])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _facing(sights: Sights, state: State, c: int) -> Mask:
    """(N,) markers that may be seen or are bound to a spot; `State.faces` on the way, of those that are not hidden."""
    xyz, normal, rot, shift = sights.xyz, sights.normal, state.rotations[c], state.translations[c]
    hidden, bound, faces, out = state.hidden[c], state.bound[c], state.faces[c], np.empty(xyz.shape[0], np.bool_)
    ex = -(rot[0, 0] * shift[0] + rot[1, 0] * shift[1] + rot[2, 0] * shift[2])
    ey = -(rot[0, 1] * shift[0] + rot[1, 1] * shift[1] + rot[2, 1] * shift[2])
    ez = -(rot[0, 2] * shift[0] + rot[1, 2] * shift[1] + rot[2, 2] * shift[2])
    for m in range(xyz.shape[0]):
        facing = _towards(normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2])
        out[m] = (facing > 0.0 and not hidden[m]) or bound[m] >= 0
        faces[m] = facing > GRAZING and out[m]
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _expect(sights: Sights, state: State, c: int, xy: Array) -> None:
    """Which markers turn to camera c and have an image, and which of them must be seen."""
    must, faces, place, (low, right, bottom) = state.must[c], state.faces[c], state.place[c], whole_within(sights, c)
    # Where the unknowns do not know yet, nothing is expected: the gate must tell a marker from clutter.
    widest = 4.0 * sights.tolerance[c] ** 2 / GATE
    if state.bent.shape[0] > 0:
        spots = max(sights.first[c + 1] - sights.first[c], 1)
        widest = sights.size[c, 0] * sights.size[c, 1] / (math.pi * CLEAR * spots)
    for m in range(xy.shape[0]):
        x, y = xy[m, 0], xy[m, 1]
        faces[m] = faces[m] and not math.isnan(x)
        must[m] = faces[m] and low < x < right and low < y < bottom and place[m, 0] + place[m, 2] < widest


@nb.njit(cache=True, nogil=True, error_model="numpy")
def whole_within(sights: Sights, c: int) -> tuple[float, float, float]:
    """Least x and y, largest x, largest y where a usual spot is whole in the image: a detector finds no half discs."""
    low = BORDER + sights.radius[c] - 0.5
    return low, sights.size[c, 0] - 1.0 - low, sights.size[c, 1] - 1.0 - low


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _in_gates(
    sights: Sights, state: State, c: int, xy: Array, table: Array, shut: bool
) -> tuple[Ints, Ints, Array]:  # fmt: skip
    """Markers, spots and squared distances of the pairs of camera c that are in their gates, in order of markers."""
    n, first, last, bent = xy.shape[0], sights.first[c], sights.first[c + 1], state.bent.shape[0] > 0
    spots, noise, density = sights.xy[first:last], sights.cov[first:last], sights.density[first:last]
    by_x, column, most2 = sights.by_x[first:last], sights.x[first:last], 9.0 * sights.tolerance[c] ** 2
    match, bound, place, excess = state.match[c], state.bound[c], state.place[c], state.numbers[c, EXCESS]
    pair_m, pair_s, pair_d = np.empty(4 * n, np.int32), np.empty(4 * n, np.int32), np.empty(4 * n)
    largest, used = 0.0, 0
    for s in range(last - first):
        largest = max(largest, noise[s, 0] + noise[s, 2])
    for m in range(n):
        x, y = xy[m, 0], xy[m, 1]
        if math.isnan(x) or bound[m] >= 0:
            continue
        while used + (last - first) > pair_d.shape[0]:
            pair_m, pair_s = np.append(pair_m, pair_m), np.append(pair_s, pair_s)
            pair_d = np.append(pair_d, pair_d)
        txx, txy, tyy = table[m, 0] + excess, table[m, 1], table[m, 2] + excess
        sxx, sxy, syy = place[m, 0], place[m, 1], place[m, 2]
        reach2 = GATE * (sxx + syy + txx + tyy + largest)
        if not bent:
            reach2 = min(reach2, most2)
        reach = math.sqrt(reach2)
        for at in range(first_from(column, x - reach), last - first):
            if column[at] - x > reach:
                break
            s = by_x[at]
            du, dv = x - spots[s, 0], y - spots[s, 1]
            held = match[m] == s
            if du * du + dv * dv > reach2 or (shut and not held):
                continue
            distance2, root_det = leave_one_out(
                du, dv, txx + noise[s, 0], txy + noise[s, 1], tyy + noise[s, 2], sxx, sxy, syy, held
            )  # fmt: skip
            odds = 1.0 / (2.0 * math.pi * root_det * density[s])
            if distance2 < min(GATE, 2.0 * math.log(odds / (CLEAR if bent and not held else 1.0))):
                pair_m[used], pair_s[used], pair_d[used] = m, s, distance2
                used += 1
    return pair_m[:used], pair_s[:used], pair_d[:used]


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
