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
Sight = tuple[float, float, float, float, float, float]

GROWTH = 4
"""Links that one growth takes as much time as, per marker."""
ARRIVED, SLACKER = 1e-3, 1.3
"""Relative error of the three lengths at which Newton's steps have arrived, and the room left for it."""


class Links(NamedTuple):
    """Spots, each four of them with a range of markers that they are to be linked to."""

    spots: Ints  # (Q, 4) the anchor first; -1 for three spots without one
    first: Ints  # (Q,) the spots' markers are number entry[first:last]
    last: Ints  # (Q,)
    entry: Ints  # (E,)
    markers: Ints  # (T, 4) in the order of the spots
    shape: Array  # (T, 8) of those with an anchor, see `quad.shape_of`
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
    spots, first, last, entry, markers, shape, check, most = links
    rays, points = np.empty((3, 3)), np.empty((3, 3))
    r, t = np.empty((4, 3, 3)), np.empty((4, 3))
    marker, spot = np.empty(PAIRS, np.int32), np.empty(PAIRS, np.int32)
    match, room = np.empty(xyz.shape[0], np.int32), (last - first).max() if len(first) else 0
    some, fit = np.empty((8, room)), np.empty(room, np.bool_)
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
            slack, count = check / f, last[q] - first[q]
            if anchored:
                # Side by side, as the loop over them is then done for four or eight at once.
                for e in range(count):
                    for part in range(8):
                        some[part, e] = shape[entry[first[q] + e], part]
                for e in range(count):
                    fit[e] = fits(some, e, sight, slack)
            for e in range(count):
                tried += 1
                if grown - before >= most:
                    break
                n = entry[first[q] + e]
                if anchored and not (fit[e] and stands(some, e, sight, slack)):
                    continue
                j, k, m = markers[n, 1], markers[n, 2], markers[n, 3]
                i = markers[n, 0] if anchored else m
                if anchored and (holds(known, i, j, k, m, a, b, c, d) or holds(seen, i, j, k, m, a, b, c, d)):
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
                    for pair in range(pairs):
                        match[marker[pair]] = spot[pair]
                    score, focal, matched = grow(model, picture, gates, match, r[s], t[s], f, pairs)
                    seen[best.serial[size + 1] % seen.shape[0]] = match
                    best.serial[size + 1] += 1
                    if score > -math.inf and keep(best, r[s], t[s], focal, score, matched, match):
                        met = met or score > stop_at
        if met:
            return q + 1, tried, tried + GROWTH * xyz.shape[0] * grown
    return spots.shape[0], tried, tried + GROWTH * xyz.shape[0] * grown


@nb.njit(cache=True, nogil=True, error_model="numpy")
def sight_of(p: Array, a: int, b: int, c: int, d: int, f: float) -> Sight:
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


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def fits(shape: Array, n: int, sight: Sight, slack: float) -> bool:
    """Whether four markers can be seen like this, to first order in the perspective; a hundred times cheaper than P3P.

    Three points seen from afar leave one scale and two mirrored orientations (Huttenlocher and Ullman 1990). The
    depths that follow correct the perspective; the anchor must then be where the camera looks. Without branches: most
    links end here.

    Parameters
    ----------
    shape : (8, n) of four markers each, see `quad.shape_of`, of which number ``n`` is asked
    sight : directions of the corners, see `sight_of`
    slack : how far the anchor may lie off, radians
    """
    bx, by, cx, cy, dx, dy = sight
    alpha, gamma, height = shape[5, n], shape[6, n], shape[7, n]
    ux, uy, vx, vy = cx - bx, cy - by, dx - bx, dy - by
    s2, w1, w2 = _afar(shape, n, ux, uy, vx, vy)
    # The camera's depth axis points away from the viewer, so (u, v, w) is right-handed with y down.
    lift = height / math.sqrt(s2)
    flat, lean, beta = lift * (ux * vy - uy * vx), alpha * w1 + gamma * w2, 1.0 - alpha - gamma
    ax, ay = bx + alpha * ux + gamma * vx, by + alpha * uy + gamma * vy
    tx, ty = lift * (uy * w2 - w1 * vy), lift * (w1 * vx - ux * w2)
    # The depths from the anchor's, one way round and the other.
    wb, xb = -(lean + flat), lean - flat
    sx = beta * wb * bx + alpha * (wb + w1) * cx + gamma * (wb + w2) * dx
    sy = beta * wb * by + alpha * (wb + w1) * cy + gamma * (wb + w2) * dy
    rx = beta * xb * bx + alpha * (xb - w1) * cx + gamma * (xb - w2) * dx
    ry = beta * xb * by + alpha * (xb - w1) * cy + gamma * (xb - w2) * dy
    room, other = slack + 0.5 * (abs(sx) + abs(sy)), slack + 0.5 * (abs(rx) + abs(ry))
    one = (tx + ax + sx) ** 2 + (ty + ay + sy) ** 2 < room * room
    return one | ((ax - tx + rx) ** 2 + (ay - ty + ry) ** 2 < other * other)


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _afar(
    shape: Array, n: int, ux: float, uy: float, vx: float, vy: float
) -> tuple[float, float, float]:  # fmt: skip
    """Square of the scale, and the depths of two corners from the third, of three markers seen from afar."""
    g11, g12, g22, det, per = shape[0, n], shape[1, n], shape[2, n], shape[3, n], shape[4, n]
    u2, v2, uv = ux * ux + uy * uy, vx * vx + vy * vy, ux * vx + uy * vy
    half = 0.5 * (u2 * g22 + v2 * g11 - 2.0 * uv * g12)
    s2 = (half + math.sqrt(max(half * half - det * (u2 * v2 - uv * uv), 0.0))) * per
    w1, w2 = math.sqrt(max(s2 * g11 - u2, 0.0)), math.sqrt(max(s2 * g22 - v2, 0.0))
    return s2, w1, -w2 if s2 * g12 < uv else w2


@nb.njit(cache=True, nogil=True, error_model="numpy")
def stands(shape: Array, n: int, sight: Sight, slack: float) -> bool:
    """The same with the perspective in full: two Newton steps on the three depths from those of `fits`; a fifth of P3P.

    True, too, where they have not arrived (the two orientations meet in a frontal view): P3P is to say.
    """
    bx, by, cx, cy, dx, dy = sight
    g11, g12, g22, alpha, gamma = shape[0, n], shape[1, n], shape[2, n], shape[5, n], shape[6, n]
    s2, w1, w2 = _afar(shape, n, cx - bx, cy - by, dx - bx, dy - by)
    lift = shape[7, n] / math.sqrt(s2)
    for sign in (1.0, -1.0):
        # The depths of the corners, that of the anchor being about one; lengths are in its unit, too.
        b = 1.0 - sign * (alpha * w1 + gamma * w2) - lift * ((cx - bx) * (dy - by) - (cy - by) * (dx - bx))
        c, d, off = b + sign * w1, b + sign * w2, 0.0
        for step in range(3):
            e1x, e1y, e1z = c * cx - b * bx, c * cy - b * by, c - b
            e2x, e2y, e2z = d * dx - b * bx, d * dy - b * by, d - b
            f11 = 0.5 * (e1x * e1x + e1y * e1y + e1z * e1z - s2 * g11)
            f22 = 0.5 * (e2x * e2x + e2y * e2y + e2z * e2z - s2 * g22)
            f12 = e1x * e2x + e1y * e2y + e1z * e2z - s2 * g12
            if step == 2:
                off = (abs(f11) + abs(f22) + abs(f12)) / (s2 * (g11 + g22))
                break
            # The errors by the depths: of 11 by b and c, of 22 by b and d, of 12 by all.
            b1, c1 = e1x * bx + e1y * by + e1z, e1x * cx + e1y * cy + e1z
            b2, d2 = e2x * bx + e2y * by + e2z, e2x * dx + e2y * dy + e2z
            c12, d12 = e2x * cx + e2y * cy + e2z, e1x * dx + e1y * dy + e1z
            # (-b1, c1, 0), (-b2, 0, d2), (-b1 - b2, c12, d12): the first two give the steps of c and d.
            p, q = 1.0 / c1, 1.0 / d2
            move = (f12 - c12 * f11 * p - d12 * f22 * q) / (c12 * b1 * p + d12 * b2 * q - b1 - b2)
            b, c, d = b - move, c - (f11 + b1 * move) * p, d - (f22 + b2 * move) * q
        if not off < ARRIVED:
            return True
        x = b * bx + alpha * e1x + gamma * e2x + lift * (e1y * e2z - e1z * e2y)
        y = b * by + alpha * e1y + gamma * e2y + lift * (e1z * e2x - e1x * e2z)
        z = b + alpha * e1z + gamma * e2z + lift * (e1x * e2y - e1y * e2x)
        if x * x + y * y < (SLACKER * slack * z) ** 2:
            return True
    return False
