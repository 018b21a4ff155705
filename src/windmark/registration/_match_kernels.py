"""The fast search as a numba kernel: look up, solve, check, look at the neighbourhood, grow, keep the best.

Private to the registration room; works in the search plane (see `_plane`). A quad of spots meets the quads of
markers that share its key. Three pairs give up to four poses (P3P); the anchor, which lies within their triangle or
near it, checks them sharply; the markers around it judge what is left (`_hypothesis_kernels`), and what they support
is grown (`_growth_kernels`). Readable twin: tests/registration/test_quads.py.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import to_camera
from windmark.geometry._p3p_kernels import p3p_kernel
from windmark.registration._growth_kernels import Gates, grow
from windmark.registration._hypothesis_kernels import PAIRS, Model, Picture, Rules, _allowed, _neighbourhood, _ray
from windmark.registration._quad_kernels import Table

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

CHECK = 0.5
"""The anchor must lie within this part of the tolerance."""
GROWTH = 4
"""Links that one growth takes as much time as, per marker."""
MOST_GROWN = 24
"""A quad of a lattice fits everywhere; after so many grown solutions its turn is over."""
SEEN = 64
"""So many of the last grown solutions are remembered, good or bad, and not grown again."""
ALIKE_TRACE = 1.0 + 2.0 * math.cos(math.radians(3.0))
ALIKE_SHARE = 0.6


class Best(NamedTuple):
    """The best distinct solutions, in no order; ``score`` is -inf where there is none."""

    rotation: Array  # (P, 3, 3)
    translation: Array  # (P, 3)
    focal: Array  # (P,)
    score: Array  # (P,) log-likelihood ratio
    matched: Ints  # (P,)
    match: Ints  # (P, N) spot of every marker or -1
    seen: Ints  # (SEEN, N) the same of the last solutions grown
    serial: NDArray[np.int64]  # (P + 2,) tells solutions apart; then how many were kept, and grown


def room_for_best(size: int, markers: int) -> Best:
    """Empty arrays for ``size`` solutions."""
    return Best(
        np.zeros((size, 3, 3)), np.zeros((size, 3)), np.zeros(size),
        np.full(size, -np.inf), np.zeros(size, np.int32), np.full((size, markers), -1, np.int32),
        np.full((SEEN, markers), -1, np.int32), np.zeros(size + 2, np.int64),
    )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def search_kernel(
    model: Model, picture: Picture, rules: Rules, gates: Gates, table: Table, focals: Array,
    quads: Ints, cells: Ints, start: int, work: int, stop_at: float, best: Best, known: Ints,
) -> tuple[int, int]:  # fmt: skip
    """Try quads of spots from number ``start`` on, until so much work is done (in links) or a better solution is met.

    Pairs that a solution in ``known`` (matches, as in `Best`) has already are not tried again.

    Returns
    -------
    The number of the quad to go on with, and the links tried. It stops after a quad that brought a solution with
    a score above ``stop_at``.
    """
    p, density, raster = picture.p, picture.density, picture.raster
    xyz, normal, near = model.xyz, model.normal, model.near
    grid = (picture.x0, picture.y0, picture.per_px)
    limits = (rules.tolerance, math.log(rules.p_seen), math.log(1.0 - rules.p_seen), rules.reject_at, rules.grow_at)
    prior = (rules.prior_cosine, rules.prior_scale)
    first, entry, seen, size = table.first, table.quad, best.seen, best.score.shape[0]
    check = CHECK * rules.tolerance
    rays, points = np.empty((3, 3)), np.empty((3, 3))
    r, t = np.empty((4, 3, 3)), np.empty((4, 3))
    marker, spot = np.empty(PAIRS, np.int32), np.empty(PAIRS, np.int32)
    match = np.empty(xyz.shape[0], np.int32)
    links, grown = 0, 0
    for q in range(start, quads.shape[0]):
        if links + GROWTH * xyz.shape[0] * grown >= work:
            return q, links
        a, b, c, d = quads[q, 0], quads[q, 1], quads[q, 2], quads[q, 3]
        met, before = False, grown
        for f in focals:
            _ray(rays, 0, p[b, 0], p[b, 1], f)
            _ray(rays, 1, p[c, 0], p[c, 1], f)
            _ray(rays, 2, p[d, 0], p[d, 1], f)
            sight = _sight(p, a, b, c, d, f)
            slack = check / f
            for e in range(first[cells[q]], first[cells[q] + 1]):
                i, j, k, m = entry[e, 0], entry[e, 1], entry[e, 2], entry[e, 3]
                links += 1
                if grown - before >= MOST_GROWN:
                    break
                if not _fits(xyz, i, j, k, m, sight, slack) or _known(known, i, j, k, m, a, b, c, d):
                    continue
                if _known(seen, i, j, k, m, a, b, c, d):
                    continue
                for axis in range(3):
                    points[0, axis], points[1, axis], points[2, axis] = xyz[j, axis], xyz[k, axis], xyz[m, axis]
                for s in range(p3p_kernel(rays, points, r, t)):
                    x, y, z = to_camera(r[s], t[s], xyz[i, 0], xyz[i, 1], xyz[i, 2])
                    if not (f * x / z - p[a, 0]) ** 2 + (f * y / z - p[a, 1]) ** 2 < check * check:
                        continue
                    if prior[0] > -1.0 and not _allowed(
                        r[s], t[s], f, xyz, i, rules.prior_rotation, rules.prior_depth, prior
                    ):
                        continue
                    pairs = _neighbourhood(
                        xyz, normal, near, p, density, raster, grid, limits,
                        r[s], t[s], f, (i, j, k), (a, b, c), marker, spot,
                    )  # fmt: skip
                    if pairs == 0:
                        continue
                    grown += 1
                    match[:] = -1
                    for n in range(pairs):
                        match[marker[n]] = spot[n]
                    score, focal, count = grow(model, picture, gates, match, r[s], t[s], f, pairs)
                    seen[best.serial[size + 1] % SEEN] = match
                    best.serial[size + 1] += 1
                    if score > -math.inf and keep(best, r[s], t[s], focal, score, count, match):
                        met = met or score > stop_at
        if met:
            return q + 1, links
    return quads.shape[0], links


@nb.njit(cache=True, nogil=True, error_model="numpy")
def rivals_kernel(
    model: Model, picture: Picture, gates: Gates, best: Best, symmetries: tuple[Ints, Array, Array],
    rotation: Array, translation: Array, focal: float, match: Ints,
) -> None:  # fmt: skip
    """Grow what the near-symmetries of the model make of a solution, and its mirror image in a plane."""
    onto, turn, shift = symmetries
    n = match.shape[0]
    r, t, new = np.empty((3, 3)), np.empty(3), np.empty(n, np.int32)
    for s in range(onto.shape[0]):
        # The spot of marker m is taken for that of marker onto[m], so the camera sees the model moved back.
        new[:] = -1
        pairs = 0
        for m in range(n):
            if match[m] >= 0 and onto[s, m] >= 0:
                new[onto[s, m]] = match[m]
                pairs += 1
        for i in range(3):
            for j in range(3):
                r[i, j] = 0.0
                for k in range(3):
                    r[i, j] += rotation[i, k] * turn[s, j, k]
        for i in range(3):
            t[i] = translation[i]
            for j in range(3):
                t[i] -= r[i, j] * shift[s, j]
        _regrow(model, picture, gates, best, r, t, focal, new, pairs)
    pairs = _mirrored(model.xyz, match, rotation, translation, r, t)
    new[:] = match
    _regrow(model, picture, gates, best, r, t, focal, new, pairs)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _regrow(
    model: Model, picture: Picture, gates: Gates, best: Best, r: Array, t: Array, f: float, match: Ints, pairs: int
) -> None:
    if pairs < 4:
        return
    score, focal, count = grow(model, picture, gates, match, r, t, f, pairs)
    if score > -math.inf:
        keep(best, r, t, focal, score, count, match)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _mirrored(xyz: Array, match: Ints, rotation: Array, translation: Array, r: Array, t: Array) -> int:
    """The other pose that sees nearly flat markers almost the same; the number of markers matched.

    The model is mirrored in the plane of its matched markers and in the one across the line of sight.
    """
    count, centre = 0, np.zeros(3)
    for m in range(match.shape[0]):
        if match[m] >= 0:
            count += 1
            centre += xyz[m]
    centre /= max(count, 1)
    moments = np.zeros((3, 3))
    for m in range(match.shape[0]):
        if match[m] >= 0:
            for i in range(3):
                for j in range(3):
                    moments[i, j] += (xyz[m, i] - centre[i]) * (xyz[m, j] - centre[j])
    normal = np.linalg.eigh(moments)[1][:, 0]
    sight = translation.copy()
    for i in range(3):
        for j in range(3):
            sight[i] += rotation[i, j] * centre[j]
    across = sight / math.sqrt(sight[0] ** 2 + sight[1] ** 2 + sight[2] ** 2)
    for i in range(3):
        for j in range(3):
            r[i, j] = 0.0
            for k in range(3):
                for q in range(3):
                    a = (1.0 if i == k else 0.0) - 2.0 * across[i] * across[k]
                    b = (1.0 if q == j else 0.0) - 2.0 * normal[q] * normal[j]
                    r[i, j] += a * rotation[k, q] * b
    for i in range(3):
        t[i] = sight[i]
        for j in range(3):
            t[i] -= r[i, j] * centre[j]
    return count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _sight(p: Array, a: int, b: int, c: int, d: int, f: float) -> tuple[float, float, float, float, float, float]:
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
def _fits(
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
    # The anchor is alpha e1 + gamma e2 + height (e1 cross e2) from b.
    alpha, gamma = (h1 * g22 - h2 * g12) / det, (h2 * g11 - h1 * g12) / det
    height = ((e1y * e2z - e1z * e2y) * e3x + (e1z * e2x - e1x * e2z) * e3y + (e1x * e2y - e1y * e2x) * e3z) / det
    ux, uy, vx, vy = cx - bx, cy - by, dx - bx, dy - by
    u2, v2, uv = ux * ux + uy * uy, vx * vx + vy * vy, ux * vx + uy * vy
    half = 0.5 * (u2 * g22 + v2 * g11 - 2.0 * uv * g12)
    s2 = (half + math.sqrt(max(half * half - det * (u2 * v2 - uv * uv), 0.0))) / det
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


@nb.njit(cache=True, nogil=True)
def _known(known: Ints, i: int, j: int, k: int, m: int, a: int, b: int, c: int, d: int) -> bool:
    """Whether a solution kept already has these four pairs."""
    for n in range(known.shape[0]):
        if known[n, i] == a and known[n, j] == b and known[n, k] == c and known[n, m] == d:
            return True
    return False


@nb.njit(cache=True, nogil=True)
def keep(best: Best, r: Array, t: Array, f: float, score: float, count: int, match: Ints) -> bool:
    """Keep a solution unless one like it is as good or the room is full of better ones; True if kept.

    Alike are nearly the same rotation (3 degrees) with mostly the same pairs. Two poses of one labelling, as
    mirrored in a plane, are *not* alike; nor is a shift along a row.
    """
    size = best.score.shape[0]
    worst = 0
    for n in range(size):
        if best.score[n] < best.score[worst]:
            worst = n
        if best.score[n] >= score and _alike(best, n, r, count, match):
            return False
    if best.score[worst] >= score:
        return False
    for n in range(size):
        if best.score[n] > -math.inf and _alike(best, n, r, count, match):
            best.score[n] = -math.inf
            best.match[n] = -1
            worst = n
    best.rotation[worst], best.translation[worst], best.focal[worst] = r, t, f
    best.score[worst], best.matched[worst], best.match[worst] = score, count, match
    best.serial[size] += 1
    best.serial[worst] = best.serial[size]
    return True


@nb.njit(cache=True, nogil=True)
def _alike(best: Best, n: int, r: Array, count: int, match: Ints) -> bool:
    trace = 0.0
    for i in range(3):
        for j in range(3):
            trace += r[i, j] * best.rotation[n, i, j]
    if trace < ALIKE_TRACE:
        return False
    shared = 0
    for m in range(match.shape[0]):
        shared += match[m] >= 0 and match[m] == best.match[n, m]
    return shared > ALIKE_SHARE * min(count, best.matched[n])
