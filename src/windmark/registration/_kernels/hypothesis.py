"""Steps 2 to 4 of the search in one numba kernel: link, solve, reject, look at the neighbourhood.

Private to the registration room. Everything happens in the *search plane* (see `_plane`): ideal pixels
with the principal point at the origin, so that a marker at camera-frame (X, Y, Z) is seen at
f (X, Y) / Z. A raster of that plane names the nearest spot of every cell, so projecting and testing one
marker is O(1). The hot functions take plain arrays and scalars: a record of arrays would be unpacked,
with reference counts, at every call.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import to_camera
from windmark.geometry._p3p_kernels import p3p_kernel

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

OUT = -2
"""Raster value outside of the image."""
EMPTY = -1
"""Raster value in the image with no spot near."""
GRAZING = 0.17
"""Cosine of the angle of view (80 degrees) below which a marker may be seen but need not."""
PAIRS = 24
"""Most pairs of a hypothesis."""

CORE2 = 1 / 16
"""A miss distance has the density 1 / d^2 of an unknown scale, flat within a core of a quarter of the reach ..."""
CORE_MASS = 1 + 2 * math.log(4.0)
"""... and this normalises it."""


class Model(NamedTuple):
    """Markers, centred and scaled to unit size."""

    xyz: Array  # (N, 3)
    normal: Array  # (N, 3), zero where unknown
    near: Ints  # (N, K) other markers, nearest first


class Picture(NamedTuple):
    """Spots in the search plane."""

    p: Array  # (M, 2)
    density: Array  # (M,) spots per px^2 round the spot
    near: Ints  # (M, K) other spots, nearest first
    raster: Ints  # (rows, columns): nearest spot, EMPTY or OUT
    x0: float  # plane coordinates of the raster's corner
    y0: float
    per_px: float  # cells per pixel


class Rules(NamedTuple):
    """Constants of the search."""

    tolerance: float  # px, the neighbourhood of step 4
    p_seen: float  # assumed chance that a marker in view has a spot
    reject_at: float  # log-likelihood ratio below which a hypothesis is dropped
    grow_at: float  # ... and above which it is kept
    prior_rotation: Array  # (3, 3), zero without a prior
    prior_cosine: float  # of the largest angle to the prior; -2 without a prior
    prior_depth: Array  # (N,) depth over focal length of every marker in the prior
    prior_scale: float  # largest ratio of scales


class Hypotheses(NamedTuple):
    """Poses that the neighbourhood supports, with the pairs that do."""

    rotation: Array  # (B, 3, 3)
    translation: Array  # (B, 3)
    focal: Array  # (B,)
    marker: Ints  # (B, PAIRS)
    spot: Ints  # (B, PAIRS)
    pairs: Ints  # (B,)


def room_for(size: int) -> Hypotheses:
    """Empty arrays for ``size`` hypotheses."""
    return Hypotheses(
        np.empty((size, 3, 3)), np.empty((size, 3)), np.empty(size),
        np.empty((size, PAIRS), np.int32), np.empty((size, PAIRS), np.int32), np.empty(size, np.int32),
    )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def hypotheses_kernel(
    model: Model, picture: Picture, rules: Rules, out: Hypotheses,
    triplets: Ints, turns: NDArray[np.int8], anchors: Ints, reach: int, focals: Array,
) -> tuple[int, int]:  # fmt: skip
    """Link every marker triplet to triplets of neighbouring spots and keep what the neighbourhood supports.

    Parameters
    ----------
    triplets : (T, 3) markers
    turns : (T,) sign of the triplet's area in the image when its markers face the camera, 0 if either
    anchors : spots that the first marker is linked to; the others are among its ``reach`` nearest spots
    focals : focal lengths to try

    Returns
    -------
    The number of hypotheses found and of links tried. When ``out`` is full the rest is counted, not kept.
    """
    p, beside, density, raster = picture.p, picture.near, picture.density, picture.raster
    xyz, normal, near = model.xyz, model.normal, model.near
    grid = (picture.x0, picture.y0, picture.per_px)
    limits = (rules.tolerance, math.log(rules.p_seen), math.log(1.0 - rules.p_seen), rules.reject_at, rules.grow_at)
    prior = (rules.prior_cosine, rules.prior_scale)
    rays, points = np.empty((3, 3)), np.empty((3, 3))
    r, t = np.empty((4, 3, 3)), np.empty((4, 3))
    marker, spot = np.empty(PAIRS, np.int32), np.empty(PAIRS, np.int32)
    found, links = 0, 0
    for n in range(triplets.shape[0]):
        i, j, k = triplets[n, 0], triplets[n, 1], triplets[n, 2]
        for q in range(3):
            points[0, q], points[1, q], points[2, q] = xyz[i, q], xyz[j, q], xyz[k, q]
        for a in anchors:
            for code in range(reach * reach):
                b, c = beside[a, code // reach], beside[a, code % reach]
                area = (p[b, 0] - p[a, 0]) * (p[c, 1] - p[a, 1]) - (p[b, 1] - p[a, 1]) * (p[c, 0] - p[a, 0])
                if b == c or area * turns[n] < 0.0:
                    continue
                for f in focals:
                    links += 1
                    _ray(rays, 0, p[a, 0], p[a, 1], f)
                    _ray(rays, 1, p[b, 0], p[b, 1], f)
                    _ray(rays, 2, p[c, 0], p[c, 1], f)
                    for s in range(p3p_kernel(rays, points, r, t)):
                        if prior[0] > -1.0 and not _allowed(
                            r[s], t[s], f, xyz, i, rules.prior_rotation, rules.prior_depth, prior
                        ):
                            continue
                        pairs = _neighbourhood(
                            xyz, normal, near, p, density, raster, grid, limits,
                            r[s], t[s], f, (i, j, k), (a, b, c), marker, spot,
                        )  # fmt: skip
                        if pairs > 0:
                            if found < out.focal.shape[0]:
                                _keep(out, found, r[s], t[s], f, marker, spot, pairs)
                            found += 1
    return found, links


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _ray(rays: Array, n: int, u: float, v: float, f: float) -> None:
    q = 1.0 / math.sqrt(u * u + v * v + f * f)
    rays[n, 0], rays[n, 1], rays[n, 2] = q * u, q * v, q * f


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _allowed(
    r: Array, t: Array, f: float, xyz: Array, m: int, rotation: Array, depth: Array, limits: tuple[float, float]
) -> bool:
    """Whether a pose is within the prior's angle and scale (paper, section III.C); the scale is taken at marker m."""
    trace = 0.0
    for i in range(3):
        for j in range(3):
            trace += r[i, j] * rotation[i, j]
    if 0.5 * (trace - 1.0) < limits[0]:
        return False
    ratio = to_camera(r, t, xyz[m, 0], xyz[m, 1], xyz[m, 2])[2] / (f * depth[m])
    return ratio < limits[1] and ratio * limits[1] > 1.0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _neighbourhood(
    xyz: Array, normal: Array, near: Ints, p: Array, density: Array, raster: Ints,
    grid: tuple[float, float, float], limits: tuple[float, float, float, float, float],
    r: Array, t: Array, f: float, triplet: tuple[int, int, int], spots: tuple[int, int, int],
    marker: Ints, spot: Ints,
) -> int:  # fmt: skip
    """Sum the log-likelihood ratio of the triplet's neighbours, nearest first, until lost or convincing.

    A hit counts by how unlikely it is at the local density of spots, a miss by the chance that a marker is
    hidden. Returns the number of pairs in ``marker`` and ``spot``, 0 if the hypothesis is dropped. The
    neighbourhood widens with the distance from the triplet, where its pose is known best.
    """
    (i, j, k), (a, b, c) = triplet, spots
    tolerance, log_seen, log_missed, reject_at, grow_at = limits
    ex = -(r[0, 0] * t[0] + r[1, 0] * t[1] + r[2, 0] * t[2])
    ey = -(r[0, 1] * t[0] + r[1, 1] * t[1] + r[2, 1] * t[2])
    ez = -(r[0, 2] * t[0] + r[1, 2] * t[1] + r[2, 2] * t[2])
    for m in (i, j, k):
        if _towards(normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2]) < 0.0:
            return 0
    cx, cy = (p[a, 0] + p[b, 0] + p[c, 0]) / 3.0, (p[a, 1] + p[b, 1] + p[c, 1]) / 3.0
    size2 = ((p[a, 0] - cx) ** 2 + (p[a, 1] - cy) ** 2 + (p[b, 0] - cx) ** 2 + (p[b, 1] - cy) ** 2
             + (p[c, 0] - cx) ** 2 + (p[c, 1] - cy) ** 2) / 3.0  # fmt: skip
    score, pairs = 0.0, 3
    for n in range(near.shape[1]):
        m = near[i, n]
        facing = _towards(normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2])
        if m in (j, k) or facing < 0.0:
            continue
        x, y, z = to_camera(r, t, xyz[m, 0], xyz[m, 1], xyz[m, 2])
        if z <= 0.0:
            continue
        u, v = f * x / z, f * y / z
        s = lookup(raster, grid, u, v)
        if s == OUT:
            continue
        if s >= 0 and s != a and s != b and s != c:
            reach2 = tolerance**2 * min(3.0, 1.0 + 0.5 * math.sqrt(((u - cx) ** 2 + (v - cy) ** 2) / size2)) ** 2
            d2 = (p[s, 0] - u) ** 2 + (p[s, 1] - v) ** 2
            if d2 < reach2:
                marker[pairs], spot[pairs] = m, s
                pairs += 1
                score += log_seen - math.log(CORE_MASS * math.pi * max(d2, CORE2 * reach2) * density[s])
                if score > grow_at or pairs == PAIRS:
                    break
                continue
        if facing > GRAZING:
            score += log_missed
            if score < reject_at:
                return 0
    if not score > grow_at and pairs < PAIRS:
        return 0
    marker[0], marker[1], marker[2] = i, j, k
    spot[0], spot[1], spot[2] = a, b, c
    return pairs


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _towards(normal: Array, m: int, dx: float, dy: float, dz: float) -> float:
    """Cosine of the angle between a marker's normal and the line to the eye; 1 where the normal is unknown."""
    nx, ny, nz = normal[m, 0], normal[m, 1], normal[m, 2]
    if nx == 0.0 and ny == 0.0 and nz == 0.0:
        return 1.0
    return (nx * dx + ny * dy + nz * dz) / math.sqrt(dx * dx + dy * dy + dz * dz)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def lookup(raster: Ints, grid: tuple[float, float, float], u: float, v: float) -> int:
    """Spot nearest to a point of the plane, EMPTY or OUT; ``grid`` is corner x, corner y, cells per px."""
    column, row = (u - grid[0]) * grid[2], (v - grid[1]) * grid[2]
    if not (column >= 0.0 and row >= 0.0 and column < raster.shape[1] and row < raster.shape[0]):
        return OUT
    return raster[int(row), int(column)]


@nb.njit(cache=True, nogil=True)
def _keep(out: Hypotheses, n: int, r: Array, t: Array, f: float, marker: Ints, spot: Ints, pairs: int) -> None:
    for i in range(3):
        for j in range(3):
            out.rotation[n, i, j] = r[i, j]
        out.translation[n, i] = t[i]
    for i in range(pairs):
        out.marker[n, i], out.spot[n, i] = marker[i], spot[i]
    out.focal[n], out.pairs[n] = f, pairs
