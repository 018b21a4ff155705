"""The exhaustive search for few spots as a numba kernel: every way to take three spots for three markers.

Private to the registration room; works in the search plane (see `search.plane`). Where most markers are hidden, four
neighbouring markers are hardly ever seen as four neighbouring spots, and the quads of the fast search find nothing. But
few spots can be tried in full: three of them far apart fix the pose well wherever the others are, and if nearly all
spots are markers, nearly all must be explained. Readable twin: tests/registration/test_sparse.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import to_camera
from windmark.geometry._p3p_kernels import p3p_kernel
from windmark.registration._kernels.best import Best, keep
from windmark.registration._kernels.growth import Gates, _normal_equations, grow
from windmark.registration._kernels.hypothesis import Model, Picture, Rules, _allowed, _ray, _towards, lookup

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

ORDERS = np.array([[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]], dtype=np.int32)
"""Of three markers; the last three turn the other way round."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def sparse_kernel(
    model: Model, picture: Picture, rules: Rules, gates: Gates, focals: Array, corners: Ints, triplets: Ints,
    turns: NDArray[np.int8], only: Ints, best: Best, price: Array,
) -> tuple[int, int]:  # fmt: skip
    """Take three spots for all triplets of markers, and grow what explains enough of the other spots.

    Parameters
    ----------
    gates : with the number of spots to explain
    corners : (3,) spots
    triplets, turns : (T, 3) markers, each triplet once, and (T,) as in `hypotheses_kernel`
    only : (M,) marker that a spot must have, or -1
    best : keeps the best by likelihood *and* price: with few pairs the poses' freedom decides as much
    price : (P,) of each solution kept: logarithm of the volume of poses that its pairs leave, in the order of `Best`

    Returns
    -------
    The links tried, and the hypotheses grown.
    """
    p, xyz, normal, raster = picture.p, model.xyz, model.normal, picture.raster
    grid, prior = (picture.x0, picture.y0, picture.per_px), (rules.prior_cosine, rules.prior_scale)
    rays, points, step = np.empty((3, 3)), np.empty((3, 3)), np.empty(7)
    r, t, factor = np.empty((4, 3, 3)), np.empty((4, 3)), np.empty((7, 7))
    match, owner = np.empty(xyz.shape[0], np.int32), np.empty(p.shape[0], np.int32)
    a, b, c = corners[0], corners[1], corners[2]
    area = (p[b, 0] - p[a, 0]) * (p[c, 1] - p[a, 1]) - (p[b, 1] - p[a, 1]) * (p[c, 0] - p[a, 0])
    links, grown, size = 0, 0, best.score.shape[0]
    for f in focals:
        _ray(rays, 0, p[a, 0], p[a, 1], f)
        _ray(rays, 1, p[b, 0], p[b, 1], f)
        _ray(rays, 2, p[c, 0], p[c, 1], f)
        for n in range(triplets.shape[0]):
            for o in range(6):
                i, j, k = triplets[n, ORDERS[o, 0]], triplets[n, ORDERS[o, 1]], triplets[n, ORDERS[o, 2]]
                if area * turns[n] * (1.0 if o < 3 else -1.0) < 0.0:
                    continue
                if (
                    (only[a] >= 0 and only[a] != i)
                    or (only[b] >= 0 and only[b] != j)
                    or (only[c] >= 0 and only[c] != k)
                ):
                    continue
                links += 1
                for axis in range(3):
                    points[0, axis], points[1, axis], points[2, axis] = xyz[i, axis], xyz[j, axis], xyz[k, axis]
                for s in range(p3p_kernel(rays, points, r, t)):
                    if prior[0] > -1.0 and not _allowed(
                        r[s], t[s], f, xyz, i, rules.prior_rotation, rules.prior_depth, prior
                    ):
                        continue
                    if not _explains(
                        xyz, normal, p, raster, grid, rules.tolerance, r[s], t[s], f, (i, j, k), (a, b, c),
                        gates.least, owner,
                    ):  # fmt: skip
                        continue
                    match[:] = -1
                    pairs = 0
                    for q in range(owner.shape[0]):
                        if owner[q] >= 0:
                            match[owner[q]] = q
                            pairs += 1
                    grown += 1
                    score, focal, count = grow(model, picture, gates, match, r[s], t[s], f, pairs)
                    if score == -math.inf or not _normal_equations(
                        xyz, p, match, r[s], t[s], focal, factor, step, 6, 0.0
                    ):
                        continue
                    # Of rotation, place in the image and logarithm of the distance, as `Solution.freedom` has it.
                    left = 2.0 * math.log(focal) - 3.0 * math.log(t[s, 2])
                    for q in range(6):
                        left += math.log(gates.sigma / factor[q, q])
                    if keep(best, r[s], t[s], focal, score + left, count, match):
                        for q in range(size):
                            if best.serial[q] == best.serial[size] and best.score[q] > -math.inf:
                                price[q] = left
    return links, grown


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _explains(
    xyz: Array, normal: Array, p: Array, raster: Ints, grid: tuple[float, float, float], tolerance: float,
    r: Array, t: Array, f: float, triplet: tuple[int, int, int], spots: tuple[int, int, int], least: int, owner: Ints,
) -> bool:  # fmt: skip
    """Whether so many spots have a marker; ``owner`` (M,) is the nearest one of each, or -1.

    The neighbourhood widens with the distance from the three spots, as in `hypothesis._neighbourhood`.
    """
    (i, j, k), (a, b, c) = triplet, spots
    ex = -(r[0, 0] * t[0] + r[1, 0] * t[1] + r[2, 0] * t[2])
    ey = -(r[0, 1] * t[0] + r[1, 1] * t[1] + r[2, 1] * t[2])
    ez = -(r[0, 2] * t[0] + r[1, 2] * t[1] + r[2, 2] * t[2])
    for m in (i, j, k):
        if _towards(normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2]) < 0.0:
            return False
    cx, cy = (p[a, 0] + p[b, 0] + p[c, 0]) / 3.0, (p[a, 1] + p[b, 1] + p[c, 1]) / 3.0
    size2 = ((p[a, 0] - cx) ** 2 + (p[a, 1] - cy) ** 2 + (p[b, 0] - cx) ** 2 + (p[b, 1] - cy) ** 2
             + (p[c, 0] - cx) ** 2 + (p[c, 1] - cy) ** 2) / 3.0  # fmt: skip
    owner[:] = -1
    owner[a], owner[b], owner[c] = i, j, k
    pairs = 3
    for m in range(xyz.shape[0]):
        x, y, z = to_camera(r, t, xyz[m, 0], xyz[m, 1], xyz[m, 2])
        if z <= 0.0:
            continue
        u, v = f * x / z, f * y / z
        s = lookup(raster, grid, u, v)
        if s < 0 or s in (a, b, c) or m in (i, j, k):
            continue
        reach = tolerance * min(3.0, 1.0 + 0.5 * math.sqrt(((u - cx) ** 2 + (v - cy) ** 2) / size2))
        d2 = (p[s, 0] - u) ** 2 + (p[s, 1] - v) ** 2
        if not d2 < reach * reach or _towards(normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2]) < 0.0:
            continue
        if owner[s] < 0:
            pairs += 1
        else:
            x, y, z = to_camera(r, t, xyz[owner[s], 0], xyz[owner[s], 1], xyz[owner[s], 2])
            if (p[s, 0] - f * x / z) ** 2 + (p[s, 1] - f * y / z) ** 2 <= d2:
                continue
        owner[s] = m
    return pairs >= least
