"""The fast search as a numba kernel: look up, solve, check, look at the neighbourhood, grow, keep the best.

Private to the registration room; works in the search plane (see `_plane`). A quad of spots meets the quads of
markers that share its key. Three pairs give up to four poses (P3P); the anchor, which lies within their triangle or
near it, checks them sharply; the markers around it judge what is left (`_kernels.hypothesis`), and what they support
is grown (`_kernels.growth`). Readable twin: tests/registration/test_quads.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import to_camera
from windmark.geometry._p3p_kernels import p3p_kernel
from windmark.registration._kernels.best import Best, holds, keep
from windmark.registration._kernels.growth import Gates, grow
from windmark.registration._kernels.hypothesis import PAIRS, Model, Picture, Rules, _allowed, _neighbourhood, _ray
from windmark.registration._kernels.quad import Table
from windmark.registration._kernels.screen import fits, sight_of

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

GROWTH = 4
"""Links that one growth takes as much time as, per marker."""
MOST_GROWN = 24
"""A quad of a lattice fits everywhere; after so many grown solutions its turn is over."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def search_kernel(
    model: Model, picture: Picture, rules: Rules, gates: Gates, table: Table, focals: Array, check: float,
    quads: Ints, cells: Ints, start: int, work: int, stop_at: float, best: Best, known: Ints,
) -> tuple[int, int, int]:  # fmt: skip
    """Try quads of spots from number ``start`` on, until so much work is done (in links) or a better solution is met.

    The anchor must lie within ``check`` px of where the other three have it. Pairs that a solution in ``known``
    (matches, as in `Best`) has already are not tried again.

    Returns
    -------
    The number of the quad to go on with, the links tried, and the work done (links, and growth in links). It stops
    after a quad that brought a solution with a score above ``stop_at``.
    """
    p, density, raster = picture.p, picture.density, picture.raster
    xyz, normal, near = model.xyz, model.normal, model.near
    grid = (picture.x0, picture.y0, picture.per_px)
    limits = (rules.tolerance, math.log(rules.p_seen), math.log(1.0 - rules.p_seen), rules.reject_at, rules.grow_at)
    prior = (rules.prior_cosine, rules.prior_scale)
    first, entry, seen, size = table.first, table.quad, best.seen, best.score.shape[0]
    rays, points = np.empty((3, 3)), np.empty((3, 3))
    r, t = np.empty((4, 3, 3)), np.empty((4, 3))
    marker, spot = np.empty(PAIRS, np.int32), np.empty(PAIRS, np.int32)
    match = np.empty(xyz.shape[0], np.int32)
    links, grown = 0, 0
    for q in range(start, quads.shape[0]):
        if links + GROWTH * xyz.shape[0] * grown >= work:
            return q, links, links + GROWTH * xyz.shape[0] * grown
        a, b, c, d = quads[q, 0], quads[q, 1], quads[q, 2], quads[q, 3]
        met, before = False, grown
        for f in focals:
            _ray(rays, 0, p[b, 0], p[b, 1], f)
            _ray(rays, 1, p[c, 0], p[c, 1], f)
            _ray(rays, 2, p[d, 0], p[d, 1], f)
            sight = sight_of(p, a, b, c, d, f)
            slack = check / f
            for e in range(first[cells[q]], first[cells[q] + 1]):
                i, j, k, m = entry[e, 0], entry[e, 1], entry[e, 2], entry[e, 3]
                links += 1
                if grown - before >= MOST_GROWN:
                    break
                if not fits(xyz, i, j, k, m, sight, slack) or holds(known, i, j, k, m, a, b, c, d):
                    continue
                if holds(seen, i, j, k, m, a, b, c, d):
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
                    seen[best.serial[size + 1] % seen.shape[0]] = match
                    best.serial[size + 1] += 1
                    if score > -math.inf and keep(best, r[s], t[s], focal, score, count, match):
                        met = met or score > stop_at
        if met:
            return q + 1, links, links + GROWTH * xyz.shape[0] * grown
    return quads.shape[0], links, links + GROWTH * xyz.shape[0] * grown
