"""Labels from a prediction that is less sharp than the markers' spacing, as numba kernels.

One pair of a marker and a spot is supposed at a time: most of the uncertainty is common to all markers, so the pair
narrows all other gates, and what they then hold decides (the one-point idea of Civera, Grasa, Davison and Montiel
2010). Private to the registration room. Readable twin: tests/registration/test_track_kernels.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point, to_camera
from windmark.registration._kernels.growth import _move
from windmark.registration._kernels.near import first_from
from windmark.registration.settle._kernels.state import Sights, State
from windmark.registration.track._kernels.gates import GATE, SHARE, Sight, inside, spread_of

Array = NDArray[np.float64]

ANCHORS, SPOTS_EACH, WITNESSES = 8, 8, 24
"""Markers that pairs are supposed of, their nearest spots, and the markers that judge."""
CLEAR = 0.35
"""If more than this part of them agree to a pair, all spots of its marker are supposed, but no other marker's."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def supposed(sights: Sights, sight: Sight, state: State, cov: Array, floor2: float) -> float:
    """Suppose single pairs and keep the best: changes pose and covariance in place; its worth in nats.

    ``sight`` is that from the pose and with the covariance that come. A pair that can no longer be the best, however
    well the markers that are left agree to it, is given up.
    """
    n, r, t = sights.xyz.shape[0], state.rotation, state.translation
    size = np.full(n, np.inf)
    for m in range(n):
        if inside(sights, sight, m):
            size[m] = sight.spread[m, 0] + sight.spread[m, 2]
    order = np.argsort(size, kind="mergesort")
    known = 0
    while known < n and size[order[known]] < np.inf:
        known += 1
    stride = max(1, known // WITNESSES)
    asked = (known + stride - 1) // stride
    most = max(0.0, -math.log(2.0 * math.pi * floor2 * sights.density.min()))  # nats of one witness
    best, clear = 0.0, False
    r1, t1, c1, step = np.empty((3, 3)), np.empty(3), np.empty((6, 6)), np.empty(6)
    r_best, t_best, c_best = r.copy(), t.copy(), cov.copy()
    around, away = np.empty(SPOTS_EACH, np.int64), np.empty(SPOTS_EACH)
    for a in range(min(ANCHORS, known)):
        m = order[a]
        found = _spots_round(sights, sight, m, floor2, around, away)
        for k in range(found):
            s = around[k]
            _narrow(sights, sight, m, cov, s, floor2, step, c1)
            r1[:], t1[:] = r, t
            _move(r1, t1, step)
            worth, agree = 0.0, 0
            for w in range(asked):
                nats = _witness(sights, sight, order[w * stride], r1, t1, c1, floor2)
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
def _spots_round(sights: Sights, sight: Sight, m: int, floor2: float, around: NDArray[np.int64], away: Array) -> int:
    """The spots in a marker's whole gate, nearest first."""
    xx, xy, yy = sight.spread[m, 0] + floor2, sight.spread[m, 1], sight.spread[m, 2] + floor2
    reach, found = math.sqrt(GATE * xx), 0
    for place in range(first_from(sights.x, sight.xy[m, 0] - reach), sights.x.shape[0]):
        s = sights.by_x[place]
        du, dv = sights.xy[s, 0] - sight.xy[m, 0], sights.xy[s, 1] - sight.xy[m, 1]
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
def _narrow(sights: Sights, sight: Sight, m: int, cov: Array, s: int, floor2: float, step: Array, out: Array) -> None:
    """What one pair does to the pose: the step, and the covariance after it (Kalman)."""
    j, xx, yy = sight.by_pose, sight.spread[m, 0] + floor2, sight.spread[m, 2] + floor2
    a, b, c = xx + sights.cov[s, 0], sight.spread[m, 1] + sights.cov[s, 1], yy + sights.cov[s, 2]
    k = 1.0 / (a * c - b * b)
    du, dv = sights.xy[s, 0] - sight.xy[m, 0], sights.xy[s, 1] - sight.xy[m, 1]
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
def _witness(sights: Sights, sight: Sight, m: int, r: Array, t: Array, cov: Array, floor2: float) -> float:
    """Nats by which the best spot in a marker's narrowed gate is likelier its image than chance; 0 without one."""
    x, y, valid = project_point(
        sights.camera[0], *to_camera(r, t, sights.xyz[m, 0], sights.xyz[m, 1], sights.xyz[m, 2])
    )  # fmt: skip
    if not valid:
        return 0.0
    xx, xy, yy = spread_of(sight.by_pose[m], cov)
    xx, yy = xx + floor2, yy + floor2
    det = xx * yy - xy * xy
    limit2 = (SHARE * sight.spacing[m]) ** 2
    reach, best = min(math.sqrt(GATE * xx), SHARE * sight.spacing[m]), 0.0
    for place in range(first_from(sights.x, x - reach), sights.x.shape[0]):
        s = sights.by_x[place]
        du, dv = sights.xy[s, 0] - x, sights.xy[s, 1] - y
        if du > reach:
            break
        if du >= -reach and du * du + dv * dv < limit2:
            d2 = (yy * du * du - 2.0 * xy * du * dv + xx * dv * dv) / det
            best = max(best, -math.log(2.0 * math.pi * math.sqrt(det) * sights.density[s]) - 0.5 * d2)
    return best
