"""Labels from a predicted pose with its covariance, as numba kernels.

Private to the registration room; works on the unit model in the search plane. Where the prediction is sharper than
the markers' spacing every marker looks for its spot in its own gate. Where it is not, one pair of a marker and a spot
is supposed at a time: most of the uncertainty is common to all markers, so the pair narrows all other gates, and what
they then hold decides (the one-point idea of Civera, Grasa, Davison and Montiel 2010). Readable twins:
tests/registration/test_track_kernels.py.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import solved
from windmark.geometry._jit import nb
from windmark.geometry._kernels import to_camera
from windmark.registration._kernels.fit import Markers, Spots
from windmark.registration._kernels.growth import _derivative, _move
from windmark.registration._kernels.hypothesis import _towards
from windmark.registration.track._kernels.motion import difference, invert_factored
from windmark.registration.track._kernels.spots import Columns, place_of

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

GATE = 12.0
"""Largest squared Mahalanobis distance of a spot from a prediction (99.75 % of right ones)."""
SHARE = 0.42
"""No gate is wider than this part of the distance to the next marker's image."""
WIDE = 0.5
"""With gates beyond their limit at more than this part of the markers, pairs are supposed."""
ANCHORS, SPOTS_EACH, WITNESSES = 8, 8, 24
"""Markers that pairs are supposed of, their nearest spots, and the markers that judge."""
CLEAR = 0.35
"""If more than this part of them agree to a pair, all spots of its marker are supposed, but no other marker's."""
ROUNDS = 2
"""Of labelling and fitting before the labels are settled."""
HUBER = 2.0


class Sight(NamedTuple):
    """Markers as seen from a pose."""

    uv: Array  # (N, 2) in the search plane
    by_pose: Array  # (N, 2, 6) its derivative
    spacing: Array  # (N,) distance to the next marker's image
    seen: NDArray[np.bool_]  # (N,) before the camera and facing it
    spread: Array  # (N, 3) xx, xy, yy by the covariance of the pose, of those that are seen


@nb.njit(cache=True, nogil=True, error_model="numpy")
def sight_from(markers: Markers, near: Ints, r: Array, t: Array, f: float, cov: Array) -> Sight:
    """Projections, their derivative by [rotation, translation], their spacing, and their covariance."""
    n, xyz = markers.xyz.shape[0], markers.xyz
    spread = np.empty((n, 3))
    uv, by_pose, spacing, seen = np.empty((n, 2)), np.empty((n, 2, 6)), np.empty(n), np.empty(n, np.bool_)
    u, v = np.empty(7), np.empty(7)
    ex = -(r[0, 0] * t[0] + r[1, 0] * t[1] + r[2, 0] * t[2])
    ey = -(r[0, 1] * t[0] + r[1, 1] * t[1] + r[2, 1] * t[2])
    ez = -(r[0, 2] * t[0] + r[1, 2] * t[1] + r[2, 2] * t[2])
    for m in range(n):
        facing = _towards(markers.normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2])
        seen[m] = facing > 0.0 and to_camera(r, t, xyz[m, 0], xyz[m, 1], xyz[m, 2])[2] > 0.0
        _derivative(r, t, f, xyz[m, 0], xyz[m, 1], xyz[m, 2], u, v)
        uv[m, 0], uv[m, 1] = u[6], v[6]
        for k in range(6):
            by_pose[m, 0, k], by_pose[m, 1, k] = u[k], v[k]
        if seen[m]:
            spread[m, 0], spread[m, 1], spread[m, 2] = spread_of(by_pose, m, cov)
    for m in range(n):
        best = np.inf
        for k in range(min(4, near.shape[1])):
            o = near[m, k]
            if seen[o]:
                best = min(best, (uv[m, 0] - uv[o, 0]) ** 2 + (uv[m, 1] - uv[o, 1]) ** 2)
        spacing[m] = math.sqrt(best)
    return Sight(uv, by_pose, spacing, seen, spread)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def spread_of(by_pose: Array, m: int, cov: Array) -> tuple[float, float, float]:
    """xx, xy, yy of a marker's projection by the covariance (6, 6) of the pose; see `Sight.by_pose`.

    The first coordinate does not depend on the translation along the second one, nor the other way round.
    """
    u0, u1, u2, u3, u5 = by_pose[m, 0, 0], by_pose[m, 0, 1], by_pose[m, 0, 2], by_pose[m, 0, 3], by_pose[m, 0, 5]
    v0, v1, v2, v4, v5 = by_pose[m, 1, 0], by_pose[m, 1, 1], by_pose[m, 1, 2], by_pose[m, 1, 4], by_pose[m, 1, 5]
    xx, xy, yy = 0.0, 0.0, 0.0
    for a in range(6):
        cu = cov[a, 0] * u0 + cov[a, 1] * u1 + cov[a, 2] * u2 + cov[a, 3] * u3 + cov[a, 5] * u5
        cv = cov[a, 0] * v0 + cov[a, 1] * v1 + cov[a, 2] * v2 + cov[a, 4] * v4 + cov[a, 5] * v5
        xx += by_pose[m, 0, a] * cu
        xy += by_pose[m, 0, a] * cv
        yy += by_pose[m, 1, a] * cv
    return xx, xy, yy


@nb.njit(cache=True, nogil=True, error_model="numpy")
def gates_overlap(sight: Sight, size: Array) -> bool:
    """Whether many gates reach beyond half the way to the next marker."""
    wide, count = 0, 0
    for m in range(sight.seen.shape[0]):
        if sight.seen[m] and abs(sight.uv[m, 0]) < size[0] and abs(sight.uv[m, 1]) < size[1]:
            count += 1
            wide += GATE * max(sight.spread[m, 0], sight.spread[m, 2]) > (SHARE * sight.spacing[m]) ** 2
    return wide > WIDE * count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def label_in_gates(sight: Sight, spots: Spots, columns: Columns, floor2: float, match: Ints) -> int:
    """Pairs within the gates, closest first, one to one; their number."""
    n = match.shape[0]
    pair_m, pair_s, pair_d = np.empty(64, np.int32), np.empty(64, np.int32), np.empty(64)
    used = 0
    match[:] = -1
    for m in range(n):
        if not sight.seen[m]:
            continue
        xx, xy, yy = sight.spread[m, 0] + floor2, sight.spread[m, 1], sight.spread[m, 2] + floor2
        reach = min(math.sqrt(GATE * xx), SHARE * sight.spacing[m])
        limit2 = (SHARE * sight.spacing[m]) ** 2
        x, y = sight.uv[m, 0], sight.uv[m, 1]
        for place in range(place_of(columns, x - reach), spots.x.shape[0]):
            s = spots.by_x[place]
            du, dv = spots.p[s, 0] - x, spots.p[s, 1] - y
            if du > reach:
                break
            if du < -reach or du * du + dv * dv > limit2:
                continue
            a, b, c = xx + spots.cov[s, 0], xy + spots.cov[s, 1], yy + spots.cov[s, 2]
            d2 = (c * du * du - 2.0 * b * du * dv + a * dv * dv) / (a * c - b * b)
            if d2 < GATE:
                if used == pair_d.shape[0]:
                    pair_m, pair_s = np.append(pair_m, pair_m), np.append(pair_s, pair_s)
                    pair_d = np.append(pair_d, pair_d)
                pair_m[used], pair_s[used], pair_d[used] = m, s, d2
                used += 1
    taken = np.zeros(spots.p.shape[0], np.bool_)
    count = 0
    for k in np.argsort(pair_d[:used], kind="mergesort"):
        if match[pair_m[k]] < 0 and not taken[pair_s[k]]:
            match[pair_m[k]] = pair_s[k]
            taken[pair_s[k]] = True
            count += 1
    return count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def supposed(
    markers: Markers, sight: Sight, spots: Spots, columns: Columns, f: float, r: Array, t: Array, cov: Array,
    floor2: float,
) -> float:  # fmt: skip
    """Suppose single pairs and keep the best: changes pose and covariance in place; its worth in nats.

    ``sight`` is that from the pose and with the covariance that come. A pair that can no longer be the best, however
    well the markers that are left agree to it, is given up.
    """
    n = markers.xyz.shape[0]
    size, order = np.full(n, np.inf), np.zeros(n, np.int64)
    for m in range(n):
        inside = abs(sight.uv[m, 0]) < spots.size[0] and abs(sight.uv[m, 1]) < spots.size[1]
        if sight.seen[m] and inside:
            size[m] = sight.spread[m, 0] + sight.spread[m, 2]
    order = np.argsort(size, kind="mergesort")
    known = 0
    while known < n and size[order[known]] < np.inf:
        known += 1
    stride = max(1, known // WITNESSES)
    asked = (known + stride - 1) // stride
    most = max(0.0, -math.log(2.0 * math.pi * floor2 * spots.density.min()))  # nats of one witness
    best, clear = 0.0, False
    r1, t1, c1, step = np.empty((3, 3)), np.empty(3), np.empty((6, 6)), np.empty(6)
    r_best, t_best, c_best = r.copy(), t.copy(), cov.copy()
    around, away = np.empty(SPOTS_EACH, np.int64), np.empty(SPOTS_EACH)
    for a in range(min(ANCHORS, known)):
        m = order[a]
        found = _spots_round(sight, m, spots, columns, floor2, around, away)
        for k in range(found):
            s = around[k]
            _narrow(sight, m, cov, spots, s, floor2, step, c1)
            r1[:], t1[:] = r, t
            _move(r1, t1, step)
            worth, agree = 0.0, 0
            for w in range(asked):
                nats = _witness(markers, order[w * stride], sight, r1, t1, f, c1, spots, columns, floor2)
                worth += nats
                agree += nats > 0.0
                if clear and worth + (asked - 1 - w) * most <= best:
                    break
            clear = clear or agree > CLEAR * asked
            if worth > best:
                best = worth
                r_best[:], t_best[:], c_best[:] = r1, t1, c1
        if clear:
            break
    r[:], t[:], cov[:] = r_best, t_best, c_best
    return best


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _spots_round(
    sight: Sight, m: int, spots: Spots, columns: Columns, floor2: float, around: NDArray[np.int64], away: Array
) -> int:
    """The spots in a marker's whole gate, nearest first."""
    xx, xy, yy = sight.spread[m, 0] + floor2, sight.spread[m, 1], sight.spread[m, 2] + floor2
    reach, found = math.sqrt(GATE * xx), 0
    for place in range(place_of(columns, sight.uv[m, 0] - reach), spots.x.shape[0]):
        s = spots.by_x[place]
        du, dv = spots.p[s, 0] - sight.uv[m, 0], spots.p[s, 1] - sight.uv[m, 1]
        if du > reach:
            break
        d2 = (yy * du * du - 2.0 * xy * du * dv + xx * dv * dv) / (xx * yy - xy * xy)
        if d2 > GATE or (found == SPOTS_EACH and d2 >= away[found - 1]):
            continue
        slot = min(found, SPOTS_EACH - 1)
        while slot > 0 and d2 < away[slot - 1]:
            away[slot], around[slot] = away[slot - 1], around[slot - 1]
            slot -= 1
        away[slot], around[slot] = d2, s
        found = min(found + 1, SPOTS_EACH)
    return found


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _narrow(sight: Sight, m: int, cov: Array, spots: Spots, s: int, floor2: float, step: Array, out: Array) -> None:
    """What one pair does to the pose: the step, and the covariance after it (Kalman)."""
    j, xx, yy = sight.by_pose, sight.spread[m, 0] + floor2, sight.spread[m, 2] + floor2
    a, b, c = xx + spots.cov[s, 0], sight.spread[m, 1] + spots.cov[s, 1], yy + spots.cov[s, 2]
    k = 1.0 / (a * c - b * b)
    du, dv = spots.p[s, 0] - sight.uv[m, 0], spots.p[s, 1] - sight.uv[m, 1]
    common = np.zeros((6, 2))
    for i in range(6):
        for q in range(6):
            common[i, 0] += cov[i, q] * j[m, 0, q]
            common[i, 1] += cov[i, q] * j[m, 1, q]
    for i in range(6):
        cu, cv = common[i, 0], common[i, 1]
        gu, gv = k * (c * cu - b * cv), k * (a * cv - b * cu)
        step[i] = gu * du + gv * dv
        for q in range(6):
            out[i, q] = cov[i, q] - gu * common[q, 0] - gv * common[q, 1]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _witness(
    markers: Markers, m: int, sight: Sight, r: Array, t: Array, f: float, cov: Array, spots: Spots, columns: Columns,
    floor2: float,
) -> float:  # fmt: skip
    """Nats by which the best spot in a marker's narrowed gate is likelier its image than chance; 0 without one."""
    x, y, z = to_camera(r, t, markers.xyz[m, 0], markers.xyz[m, 1], markers.xyz[m, 2])
    if z <= 0.0:
        return 0.0
    u, v = f * x / z, f * y / z
    xx, xy, yy = spread_of(sight.by_pose, m, cov)
    xx, yy = xx + floor2, yy + floor2
    det = xx * yy - xy * xy
    limit2 = (SHARE * sight.spacing[m]) ** 2
    reach, best = min(math.sqrt(GATE * xx), SHARE * sight.spacing[m]), 0.0
    for place in range(place_of(columns, u - reach), spots.x.shape[0]):
        s = spots.by_x[place]
        du, dv = spots.p[s, 0] - u, spots.p[s, 1] - v
        if du > reach:
            break
        if du >= -reach and du * du + dv * dv < limit2:
            d2 = (yy * du * du - 2.0 * xy * du * dv + xx * dv * dv) / det
            best = max(best, -math.log(2.0 * math.pi * math.sqrt(det) * spots.density[s]) - 0.5 * d2)
    return best


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fit_with_prior(
    markers: Markers, spots: Spots, f: float, match: Ints, prior: tuple[Array, Array, Array], floor2: float,
    r: Array, t: Array, cov: Array,
) -> bool:  # fmt: skip
    """Pose of the matched markers and the prediction, robust (Huber); ``prior`` is its pose and information."""
    u, v, g, away, a = np.empty(7), np.empty(7), np.empty(6), np.empty(6), np.empty((6, 6))
    for _ in range(2):
        difference(prior[0], prior[1], r, t, away)
        for i in range(6):
            g[i] = 0.0
            for j in range(6):
                a[i, j] = prior[2][i, j]  # the factorisation looks at the lower half only
                g[i] += prior[2][i, j] * away[j]
        for m in range(match.shape[0]):
            s = match[m]
            if s < 0:
                continue
            _derivative(r, t, f, markers.xyz[m, 0], markers.xyz[m, 1], markers.xyz[m, 2], u, v)
            du, dv = spots.p[s, 0] - u[6], spots.p[s, 1] - v[6]
            w = 1.0 / (floor2 + 0.5 * (spots.cov[s, 0] + spots.cov[s, 2]))
            w *= min(1.0, HUBER / math.sqrt(w * (du * du + dv * dv) + 1e-300))
            for i in range(6):
                g[i] += w * (u[i] * du + v[i] * dv)
                for j in range(i + 1):
                    a[i, j] += w * (u[i] * u[j] + v[i] * v[j])
        if not solved(a, g, 6, 1e-13):
            return False
        _move(r, t, g)
    invert_factored(a, cov)
    return True
