"""Rivals of a solution as numba kernels: by the model's near-symmetries, and mirrored in a plane.

Private to the registration room. Readable twin: tests/registration/test_quads.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import to_camera
from windmark.registration._kernels.best import Best, keep
from windmark.registration._kernels.growth import PRIOR_WORTH, Gates, grow, refine
from windmark.registration._kernels.hypothesis import GRAZING, OUT, Model, Picture, _towards, lookup
from windmark.registration._kernels.match import GROWTH
from windmark.registration.rules import AS_MANY

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

HOPELESS = 80.0
"""What can at best come so much (nats) below the best solution is not grown: no rival of it. But where it explains
nearly as many spots: on a board that goes on beyond its table the others are no evidence (`settle.common`)."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def rivals_kernel(
    model: Model, picture: Picture, gates: Gates, best: Best, r: Array, t: Array, f: float, match: Ints
) -> tuple[int, bool]:
    """Grow what is made of a solution: poses r (S, 3, 3), t (S, 3) with labels (S, N), all changed; first its own.

    It ends as soon as one is better by far: the solution is no answer, and the rivals of that one are to be looked for.

    Returns
    -------
    The work done, in links; whether it ended so.
    """
    n, many = match.shape[1], AS_MANY * (match[0] >= 0).sum()
    factor, step, work = np.empty((7, 7)), np.empty(7), GROWTH * n
    own = grow(model, picture, gates, match[0], r[0], t[0], f, (match[0] >= 0).sum())[0]
    least = max(own, best.score.max()) - HOPELESS
    for s in range(1, match.shape[0]):
        if own > -math.inf and best.score.max() > own + HOPELESS:
            return work, True
        work += n
        pairs = (match[s] >= 0).sum()
        if pairs < 4 or not refine(model.xyz, picture.p, match[s], r[s], t[s], f, factor, step, 6, gates.sigma**2)[0]:
            continue
        if pairs >= many or promise(model, picture, gates, r[s], t[s], f) > least:
            work += GROWTH * n
            score, focal, count = grow(model, picture, gates, match[s], r[s], t[s], f, pairs)
            if score > -math.inf:
                keep(best, r[s], t[s], focal, score, count, match[s])
    return work, False


@nb.njit(cache=True, nogil=True, error_model="numpy")
def made_kernel(
    xyz: Array, rotation: Array, translation: Array, match: Ints, onto: Ints, turn: Array, shift: Array
) -> tuple[Array, Array, Ints]:
    """Poses (S + 2, 3, 3), (S + 2, 3) and labels (S + 2, N) that start from a solution's: its own, what the S motions
    ``onto`` (S, N), ``turn`` (S, 3, 3) and ``shift`` (S, 3) make of it, and its own from the mirrored pose.

    The spot of marker m is taken for that of marker onto[m], so the camera sees the model moved back.
    """  # fmt: skip
    moves, n = onto.shape
    r, t = np.empty((moves + 2, 3, 3)), np.empty((moves + 2, 3))
    labels = np.full((moves + 2, n), -1, np.int32)
    r[0], t[0], labels[0], labels[moves + 1] = rotation, translation, match, match
    for s in range(moves):
        moved_back(rotation, translation, turn[s], shift[s], r[s + 1], t[s + 1])
        for m in range(n):
            if onto[s, m] >= 0 and match[m] >= 0:
                labels[s + 1, onto[s, m]] = match[m]
    _mirrored(xyz, match, rotation, translation, r[moves + 1], t[moves + 1])
    return r, t, labels


@nb.njit(cache=True, nogil=True, error_model="numpy")
def moved_back(rotation: Array, translation: Array, turn: Array, shift: Array, r: Array, t: Array) -> None:
    """The pose that sees a moved model as another pose sees the model, into ``r`` and ``t``."""
    for i in range(3):
        t[i] = translation[i]
        for j in range(3):
            r[i, j] = 0.0
            for k in range(3):
                r[i, j] += rotation[i, k] * turn[j, k]
            t[i] -= r[i, j] * shift[j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def promise(model: Model, picture: Picture, gates: Gates, r: Array, t: Array, f: float) -> float:
    """More than the score that can be grown from a pose, unless that moves much farther.

    As if every marker that has a spot within the reach of the raster had it for itself and exactly, see
    `growth.likelihood`.
    """
    xyz, normal, density, raster = model.xyz, model.normal, picture.density, picture.raster
    grid = (picture.x0, picture.y0, picture.per_px)
    ex = -(r[0, 0] * t[0] + r[1, 0] * t[1] + r[2, 0] * t[2])
    ey = -(r[0, 1] * t[0] + r[1, 1] * t[1] + r[2, 1] * t[2])
    ez = -(r[0, 2] * t[0] + r[1, 2] * t[1] + r[2, 2] * t[2])
    hits, missed, gain = 0, 0, 0.0
    for m in range(xyz.shape[0]):
        facing = _towards(normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2])
        x, y, z = to_camera(r, t, xyz[m, 0], xyz[m, 1], xyz[m, 2])
        if z <= 0.0 or facing < 0.0:
            continue
        s = lookup(raster, grid, f * x / z, f * y / z)
        if s >= 0:
            hits += 1
            gain -= math.log(density[s])
        elif s != OUT and facing > GRAZING:
            missed += 1
    p_seen = min(0.95, max(0.25, (hits + 1.0) / (hits + missed + 2.0)))
    variance = PRIOR_WORTH * gates.sigma**2 / (PRIOR_WORTH + 2.0 * hits)
    return gain + hits * math.log(p_seen / (2.0 * math.pi * variance)) + missed * math.log(1.0 - p_seen)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def thinnest(a: Array) -> Array:
    """Unit eigenvector of the smallest eigenvalue of a symmetric 3 x 3 matrix; any one of them if they are many.

    In closed form (the characteristic cubic by the cosine of a third of an angle): LAPACK takes several times as long
    as all the rest of mirroring.
    """
    mean = (a[0, 0] + a[1, 1] + a[2, 2]) / 3.0
    squares = 2.0 * (a[0, 1] ** 2 + a[0, 2] ** 2 + a[1, 2] ** 2)
    for i in range(3):
        squares += (a[i, i] - mean) ** 2
    size, b, best, out = math.sqrt(squares / 6.0), a.copy(), 0.0, np.array([0.0, 0.0, 1.0])
    if size == 0.0:
        return out
    for i in range(3):
        b[i, i] -= mean
    det = b[0, 0] * (b[1, 1] * b[2, 2] - b[1, 2] ** 2) - b[0, 1] * (b[0, 1] * b[2, 2] - b[1, 2] * b[0, 2])
    det += b[0, 2] * (b[0, 1] * b[1, 2] - b[1, 1] * b[0, 2])
    third = math.acos(min(1.0, max(-1.0, 0.5 * det / size**3))) / 3.0
    least = 2.0 * size * math.cos(third + 2.0 * math.pi / 3.0)
    for i in range(3):
        b[i, i] -= least
    # The vector is across all rows: of the products of two rows the longest is the surest.
    for i in range(3):
        p, q = b[i], b[(i + 1) % 3]
        x, y, z = p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]
        length = math.sqrt(x * x + y * y + z * z)
        if length > best:
            best = length
            out[0], out[1], out[2] = x / length, y / length, z / length
    return out


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
    normal = thinnest(moments)
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
