"""Labels from a predicted pose with its covariance, as numba kernels: every marker looks for its spot in its own gate.

Private to the registration room; works on the unit model, in pixels of the image. Readable twins:
tests/registration/test_track_kernels.py.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import solved
from windmark.geometry._jit import nb
from windmark.registration._kernels.growth import _move
from windmark.registration._kernels.hypothesis import _towards
from windmark.registration._kernels.near import first_from
from windmark.registration.settle._kernels.label import _pair_up
from windmark.registration.settle._kernels.project import place_cameras, room_for, see
from windmark.registration.settle._kernels.state import Sights, State
from windmark.registration.track._kernels.motion import difference, invert_factored

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

GATE = 12.0
"""Largest squared Mahalanobis distance of a spot from a prediction (99.75 % of right ones)."""
SHARE = 0.42
"""No gate is wider than this part of the distance to the next marker's image."""
WIDE = 0.5
"""With gates beyond their limit at more than this part of the markers, pairs are supposed."""
ROUNDS = 2
"""Of labelling and fitting before the labels are settled."""
HUBER = 2.0


class Sight(NamedTuple):
    """Markers as seen from a pose."""

    xy: Array  # (N, 2) in the image
    by_pose: Array  # (N, 2, 9) its derivative by the pose and, behind it, by the marker's place
    spacing: Array  # (N,) distance to the next marker's image
    seen: NDArray[np.bool_]  # (N,) before the camera and facing it
    spread: Array  # (N, 3) xx, xy, yy by the covariance of the pose, of those that are seen


@nb.njit(cache=True, nogil=True, error_model="numpy")
def sight_from(sights: Sights, state: State, cov: Array) -> Sight:
    """Projections, their derivative by [rotation, translation], their spacing, and their covariance.

    From the pose of a state that is rigid, with the camera as given; ``cov`` (6, 6) is the pose's.
    """
    n, xyz, normal, r, t = sights.xyz.shape[0], sights.xyz, sights.normal, state.rotation, state.translation
    spacing, seen, spread, (xy, by) = np.empty(n), np.empty(n, np.bool_), np.empty((n, 3)), room_for(state)
    ex = -(r[0, 0] * t[0] + r[1, 0] * t[1] + r[2, 0] * t[2])
    ey = -(r[0, 1] * t[0] + r[1, 1] * t[1] + r[2, 1] * t[2])
    ez = -(r[0, 2] * t[0] + r[1, 2] * t[1] + r[2, 2] * t[2])
    place_cameras(sights, state)
    for m in range(n):
        seen[m] = _towards(normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2]) > 0.0
    see(sights, state, 0, seen, xy, by)
    for m in range(n):
        seen[m] = not math.isnan(xy[m, 0])
        if seen[m]:
            spread[m, 0], spread[m, 1], spread[m, 2] = spread_of(by[m], cov)
    for m in range(n):
        best = np.inf
        for k in range(min(4, sights.near.shape[1])):
            o = sights.near[m, k]
            if seen[m] and seen[o]:
                best = min(best, (xy[m, 0] - xy[o, 0]) ** 2 + (xy[m, 1] - xy[o, 1]) ** 2)
        spacing[m] = math.sqrt(best)
    return Sight(xy, by, spacing, seen, spread)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def spread_of(by_pose: Array, cov: Array) -> tuple[float, float, float]:
    """xx, xy, yy of a projection by the covariance (6, 6) of the pose, from its derivative (2, 9)."""
    xx, xy, yy = 0.0, 0.0, 0.0
    for a in range(6):
        cu, cv = 0.0, 0.0
        for b in range(6):
            cu += cov[a, b] * by_pose[0, b]
            cv += cov[a, b] * by_pose[1, b]
        xx += by_pose[0, a] * cu
        xy += by_pose[0, a] * cv
        yy += by_pose[1, a] * cv
    return xx, xy, yy


@nb.njit(cache=True, nogil=True, error_model="numpy")
def inside(sights: Sights, sight: Sight, m: int) -> bool:
    """Whether a marker is seen within the image."""
    x, y = sight.xy[m, 0], sight.xy[m, 1]
    return sight.seen[m] and -0.5 < x < sights.size[0, 0] - 0.5 and -0.5 < y < sights.size[0, 1] - 0.5


@nb.njit(cache=True, nogil=True, error_model="numpy")
def gates_overlap(sights: Sights, sight: Sight) -> bool:
    """Whether many gates reach beyond half the way to the next marker."""
    wide, count = 0, 0
    for m in range(sight.seen.shape[0]):
        if inside(sights, sight, m):
            count += 1
            wide += GATE * max(sight.spread[m, 0], sight.spread[m, 2]) > (SHARE * sight.spacing[m]) ** 2
    return wide > WIDE * count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def label_in_gates(sights: Sights, sight: Sight, floor2: float, match: Ints) -> int:
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
        x, y = sight.xy[m, 0], sight.xy[m, 1]
        for place in range(first_from(sights.x, x - reach), sights.x.shape[0]):
            s = sights.by_x[place]
            du, dv = sights.xy[s, 0] - x, sights.xy[s, 1] - y
            if du > reach:
                break
            if du < -reach or du * du + dv * dv > limit2:
                continue
            a, b, c = xx + sights.cov[s, 0], xy + sights.cov[s, 1], yy + sights.cov[s, 2]
            d2 = (c * du * du - 2.0 * b * du * dv + a * dv * dv) / (a * c - b * b)
            if d2 < GATE:
                if used == pair_d.shape[0]:
                    pair_m, pair_s = np.append(pair_m, pair_m), np.append(pair_s, pair_s)
                    pair_d = np.append(pair_d, pair_d)
                pair_m[used], pair_s[used], pair_d[used] = m, s, d2
                used += 1
    _pair_up(match, False, sights.xy.shape[0], pair_m[:used], pair_s[:used], pair_d[:used], match)
    return (match >= 0).sum()


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fit_with_prior(sights: Sights, state: State, prior: tuple[Array, Array, Array], floor2: float, cov: Array) -> bool:
    """Pose of the matched markers and the prediction, robust (Huber); ``prior`` is its pose and information.

    The state's pose is changed, its covariance comes in ``cov`` (6, 6).
    """
    match, (xy, by) = state.match[0], room_for(state)
    g, away, a = np.empty(6), np.empty(6), np.empty((6, 6))
    for _ in range(2):
        place_cameras(sights, state)
        difference(prior[0], prior[1], state.rotation, state.translation, away)
        for i in range(6):
            g[i] = 0.0
            for j in range(6):
                a[i, j] = prior[2][i, j]  # the factorisation looks at the lower half only
                g[i] += prior[2][i, j] * away[j]
        see(sights, state, 0, match >= 0, xy, by)
        for m in range(match.shape[0]):
            if match[m] < 0:
                continue
            if math.isnan(xy[m, 0]):
                return False
            s = match[m]
            du, dv = sights.xy[s, 0] - xy[m, 0], sights.xy[s, 1] - xy[m, 1]
            w = 1.0 / (floor2 + 0.5 * (sights.cov[s, 0] + sights.cov[s, 2]))
            w *= min(1.0, HUBER / math.sqrt(w * (du * du + dv * dv) + 1e-300))
            for i in range(6):
                u, v = by[m, 0, i], by[m, 1, i]
                g[i] += w * (u * du + v * dv)
                for j in range(i + 1):
                    a[i, j] += w * (u * by[m, 0, j] + v * by[m, 1, j])
        if not solved(a, g, 6, 1e-13):
            return False
        _move(state.rotation, state.translation, g)
    invert_factored(a, cov)
    return True
