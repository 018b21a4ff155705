"""The search as a numba kernel: link, solve, check, look at the neighbourhood, grow, keep the best.

Private to the registration room; works in the search plane (see `search.plane`). Three spots that are taken for three
markers give up to four poses (P3P). Where a fourth pair comes with them, the anchor, which lies within their triangle
or near it, checks these sharply; the markers around judge what is left (`_kernels.hypothesis`), and what they support
is grown (`_kernels.growth`). Readable twin: tests/registration/test_quads.py.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import to_camera
from windmark.geometry._p3p_kernels import p3p_kernel
from windmark.registration._kernels.best import Best, holds, keep
from windmark.registration._kernels.growth import Gates, grow
from windmark.registration._kernels.hypothesis import PAIRS, Model, Picture, Rules, allowed, neighbourhood, ray_to

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

GROWTH = 4
"""Links that one growth takes as much time as, per marker."""


class Links(NamedTuple):
    """Spots, each four of them with a range of markers that they are to be linked to."""

    spots: Ints  # (Q, 4) the anchor first; -1 for three spots without one
    first: Ints  # (Q,) the spots' markers are markers[first:last]
    last: Ints  # (Q,)
    markers: Ints  # (E, 4) in the order of the spots
    check: float  # px, how far the anchor may be from where the other three have it
    most: int  # after so many grown solutions the turn of four spots is over: those of a lattice fit everywhere


@nb.njit(cache=True, nogil=True, error_model="numpy")
def search_kernel(
    model: Model, picture: Picture, rules: Rules, gates: Gates, links: Links, focals: Array,
    start: int, work: int, stop_at: float, best: Best, known: Ints,
) -> tuple[int, int, int]:  # fmt: skip
    """Try links from spots number ``start`` on, until so much work is done (in links) or a better solution is met.

    Pairs that a solution in ``known`` (matches, as in `Best`) has already are not tried again.

    Returns
    -------
    The number of the spots to go on with, the links tried, and the work done (links, and growth in links). It stops
    after spots that brought a solution with a score above ``stop_at``.
    """
    p, xyz, seen, size = picture.p, model.xyz, best.seen, best.score.shape[0]
    spots, first, last, markers, check = links.spots, links.first, links.last, links.markers, links.check
    rays, points = np.empty((3, 3)), np.empty((3, 3))
    r, t = np.empty((4, 3, 3)), np.empty((4, 3))
    marker, spot = np.empty(PAIRS, np.int32), np.empty(PAIRS, np.int32)
    match = np.empty(xyz.shape[0], np.int32)
    tried, grown = 0, 0
    for q in range(start, spots.shape[0]):
        if tried + GROWTH * xyz.shape[0] * grown >= work:
            return q, tried, tried + GROWTH * xyz.shape[0] * grown
        b, c, d = spots[q, 1], spots[q, 2], spots[q, 3]
        anchored = spots[q, 0] >= 0
        a = spots[q, 0] if anchored else d
        met, before = False, grown
        for f in focals:
            ray_to(rays, 0, p[b, 0], p[b, 1], f)
            ray_to(rays, 1, p[c, 0], p[c, 1], f)
            ray_to(rays, 2, p[d, 0], p[d, 1], f)
            sight = sight_of(p, a, b, c, d, f)
            for e in range(first[q], last[q]):
                j, k, m = markers[e, 1], markers[e, 2], markers[e, 3]
                i = markers[e, 0] if anchored else m
                tried += 1
                if grown - before >= links.most:
                    break
                if anchored and (
                    not fits(xyz, i, j, k, m, sight, check / f)
                    or holds(known, i, j, k, m, a, b, c, d)
                    or holds(seen, i, j, k, m, a, b, c, d)
                ):
                    continue
                for axis in range(3):
                    points[0, axis], points[1, axis], points[2, axis] = xyz[j, axis], xyz[k, axis], xyz[m, axis]
                for s in range(p3p_kernel(rays, points, r, t)):
                    x, y, z = to_camera(r[s], t[s], xyz[i, 0], xyz[i, 1], xyz[i, 2])
                    if not (f * x / z - p[a, 0]) ** 2 + (f * y / z - p[a, 1]) ** 2 < check * check:
                        continue
                    if not allowed(xyz, rules, r[s], t[s], f, i):
                        continue
                    pairs = neighbourhood(
                        model, picture, rules, r[s], t[s], f, (i, j, k), (a, b, c), marker, spot
                    )  # fmt: skip
                    # Without an anchor to screen them it is cheaper to ask of few links whether they are known.
                    if pairs == 0 or (
                        not anchored and (holds(known, i, j, k, m, a, b, c, d) or holds(seen, i, j, k, m, a, b, c, d))
                    ):
                        continue
                    grown += 1
                    match[:] = -1
                    for n in range(pairs):
                        match[marker[n]] = spot[n]
                    score, focal, count = grow(model, picture, gates, match, r[s], t[s], f, pairs)
                    seen[best.serial[size + 1] % seen.shape[0]] = match
                    best.serial[size + 1] += 1
                    if score > -math.inf and keep(best, r[s], t[s], focal, score, count, match):
                        met = met or score > stop_at
        if met:
            return q + 1, tried, tried + GROWTH * xyz.shape[0] * grown
    return spots.shape[0], tried, tried + GROWTH * xyz.shape[0] * grown


@nb.njit(cache=True, nogil=True, error_model="numpy")
def sight_of(p: Array, a: int, b: int, c: int, d: int, f: float) -> tuple[float, float, float, float, float, float]:
    """Directions of b, c, d in the frame of a camera of unit focal length turned towards a."""
    h = 1.0 / math.sqrt(p[a, 0] ** 2 + p[a, 1] ** 2 + f * f)
    zx, zy, zz = h * p[a, 0], h * p[a, 1], h * f
    g = 1.0 / math.sqrt(zx * zx + zz * zz)
    # x = (zz, 0, -zx) g is perpendicular to z; y = z cross x.
    yx, yy, yz = -zy * zx * g, (zz * zz + zx * zx) * g, -zy * zz * g
    kb = 1.0 / (zx * p[b, 0] + zy * p[b, 1] + zz * f)
    kc = 1.0 / (zx * p[c, 0] + zy * p[c, 1] + zz * f)
    kd = 1.0 / (zx * p[d, 0] + zy * p[d, 1] + zz * f)
    return (
        (zz * p[b, 0] - zx * f) * g * kb, (yx * p[b, 0] + yy * p[b, 1] + yz * f) * kb,
        (zz * p[c, 0] - zx * f) * g * kc, (yx * p[c, 0] + yy * p[c, 1] + yz * f) * kc,
        (zz * p[d, 0] - zx * f) * g * kd, (yx * p[d, 0] + yy * p[d, 1] + yz * f) * kd,
    )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fits(
    xyz: Array, i: int, j: int, k: int, m: int, sight: tuple[float, float, float, float, float, float], slack: float
) -> bool:
    """Whether four markers can be seen like this, to first order in the perspective; ten times cheaper than P3P.

    Three points seen from afar leave one scale and two mirrored orientations (Huttenlocher and Ullman 1990). The
    depths that follow correct the perspective; the anchor must then be where the camera looks.
    """
    bx, by, cx, cy, dx, dy = sight
    ox, oy, oz = xyz[j, 0], xyz[j, 1], xyz[j, 2]
    e1x, e1y, e1z = xyz[k, 0] - ox, xyz[k, 1] - oy, xyz[k, 2] - oz
    e2x, e2y, e2z = xyz[m, 0] - ox, xyz[m, 1] - oy, xyz[m, 2] - oz
    e3x, e3y, e3z = xyz[i, 0] - ox, xyz[i, 1] - oy, xyz[i, 2] - oz
    g11, g12 = e1x * e1x + e1y * e1y + e1z * e1z, e1x * e2x + e1y * e2y + e1z * e2z
    g22 = e2x * e2x + e2y * e2y + e2z * e2z
    h1, h2 = e1x * e3x + e1y * e3y + e1z * e3z, e2x * e3x + e2y * e3y + e2z * e3z
    det = g11 * g22 - g12 * g12
    per = 1.0 / det  # divisions are half of the time that this takes
    # The anchor is alpha e1 + gamma e2 + height (e1 cross e2) from b.
    alpha, gamma = (h1 * g22 - h2 * g12) * per, (h2 * g11 - h1 * g12) * per
    height = ((e1y * e2z - e1z * e2y) * e3x + (e1z * e2x - e1x * e2z) * e3y + (e1x * e2y - e1y * e2x) * e3z) * per
    ux, uy, vx, vy = cx - bx, cy - by, dx - bx, dy - by
    u2, v2, uv = ux * ux + uy * uy, vx * vx + vy * vy, ux * vx + uy * vy
    half = 0.5 * (u2 * g22 + v2 * g11 - 2.0 * uv * g12)
    s2 = (half + math.sqrt(max(half * half - det * (u2 * v2 - uv * uv), 0.0))) * per
    w1, w2 = math.sqrt(max(s2 * g11 - u2, 0.0)), math.sqrt(max(s2 * g22 - v2, 0.0))
    if s2 * g12 < uv:
        w2 = -w2
    # The camera's depth axis points away from the viewer, so (u, v, w) is right-handed with y down.
    lift = height / math.sqrt(s2)
    flat = lift * (ux * vy - uy * vx)
    ax, ay = bx + alpha * ux + gamma * vx, by + alpha * uy + gamma * vy
    for sign in (1.0, -1.0):
        p1, p2 = sign * w1, sign * w2
        wb = -(alpha * p1 + gamma * p2 + flat)
        wc, wd = wb + p1, wb + p2
        beta = 1.0 - alpha - gamma
        x = lift * (uy * p2 - p1 * vy) + ax
        y = lift * (p1 * vx - ux * p2) + ay
        sx = beta * wb * bx + alpha * wc * cx + gamma * wd * dx
        sy = beta * wb * by + alpha * wc * cy + gamma * wd * dy
        room = slack + 0.5 * (abs(sx) + abs(sy))
        x, y = x + sx, y + sy
        if x * x + y * y < room * room:
            return True
    return False
