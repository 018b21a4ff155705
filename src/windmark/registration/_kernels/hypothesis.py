"""What a pose from three pairs must pass before it is grown (steps 3 and 4 of the paper's search), as numba kernels.

Private to the registration room. Everything happens in the *search plane* (see `search.plane`): ideal pixels
with the principal point at the origin, so that a marker at camera-frame (X, Y, Z) is seen at
f (X, Y) / Z. A raster of that plane names the nearest spot of every cell, so projecting and testing one
marker is O(1). Readable twin: tests/registration/slow_twins.py.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import to_camera

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
    """What a hypothesis must pass."""

    tolerance: float  # px, the neighbourhood of step 4
    p_seen: float  # assumed chance that a marker in view has a spot
    reject_at: float  # log-likelihood ratio below which a hypothesis is dropped
    grow_at: float  # ... and above which it is kept
    prior_rotation: Array  # (3, 3), zero without a prior
    prior_cosine: float  # of the largest angle to the prior; -2 without a prior
    prior_depth: Array  # (N,) depth over focal length of every marker in the prior
    prior_scale: float  # largest ratio of scales
    least: int = 0  # not 0: so many spots must have a marker, of all, and nothing else counts


@nb.njit(cache=True, nogil=True, error_model="numpy")
def ray_to(rays: Array, n: int, u: float, v: float, f: float) -> None:
    q = 1.0 / math.sqrt(u * u + v * v + f * f)
    rays[n, 0], rays[n, 1], rays[n, 2] = q * u, q * v, q * f


@nb.njit(cache=True, nogil=True, error_model="numpy")
def allowed(xyz: Array, rules: Rules, r: Array, t: Array, f: float, m: int) -> bool:
    """Whether a pose is within the prior's angle and scale (paper, section III.C); the scale is taken at marker m."""
    if rules.prior_cosine < -1.0:
        return True
    rotation, trace = rules.prior_rotation, 0.0
    for i in range(3):
        for j in range(3):
            trace += r[i, j] * rotation[i, j]
    if 0.5 * (trace - 1.0) < rules.prior_cosine:
        return False
    ratio = to_camera(r, t, xyz[m, 0], xyz[m, 1], xyz[m, 2])[2] / (f * rules.prior_depth[m])
    return ratio < rules.prior_scale and ratio * rules.prior_scale > 1.0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def neighbourhood(
    model: Model, picture: Picture, rules: Rules, r: Array, t: Array, f: float,
    triplet: tuple[int, int, int], spots: tuple[int, int, int], marker: Ints, spot: Ints,
) -> int:  # fmt: skip
    """Sum the log-likelihood ratio of the triplet's neighbours, nearest first, until lost or convincing.

    A hit counts by how unlikely it is at the local density of spots, a miss by the chance that a marker is
    hidden. Returns the number of pairs in ``marker`` and ``spot``, 0 if the hypothesis is dropped. The
    neighbourhood widens with the distance from the triplet, where its pose is known best. With ``rules.least``
    all markers are asked, each spot that is hit counts one and a miss nothing.
    """
    (i, j, k), (a, b, c) = triplet, spots
    xyz, normal, near, p, density = model.xyz, model.normal, model.near, picture.p, picture.density
    raster, grid = picture.raster, (picture.x0, picture.y0, picture.per_px)
    ex = -(r[0, 0] * t[0] + r[1, 0] * t[1] + r[2, 0] * t[2])
    ey = -(r[0, 1] * t[0] + r[1, 1] * t[1] + r[2, 1] * t[2])
    ez = -(r[0, 2] * t[0] + r[1, 2] * t[1] + r[2, 2] * t[2])
    for m in (i, j, k):
        if _towards(normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2]) < 0.0:
            return 0
    cx, cy = (p[a, 0] + p[b, 0] + p[c, 0]) / 3.0, (p[a, 1] + p[b, 1] + p[c, 1]) / 3.0
    size2 = ((p[a, 0] - cx) ** 2 + (p[a, 1] - cy) ** 2 + (p[b, 0] - cx) ** 2 + (p[b, 1] - cy) ** 2
             + (p[c, 0] - cx) ** 2 + (p[c, 1] - cy) ** 2) / 3.0  # fmt: skip
    every, enough = rules.least > 0, rules.grow_at if rules.least == 0 else rules.least - 3.5
    score, pairs = 0.0, 3
    marker[0], marker[1], marker[2] = i, j, k
    spot[0], spot[1], spot[2] = a, b, c
    for n in range(xyz.shape[0] if every else near.shape[1]):
        if pairs == PAIRS or (score > enough and not every):
            break
        m = n if every else near[i, n]
        if m in (i, j, k):
            continue
        # Of all markers hardly one is near a spot, so which way they face is asked later.
        facing = 1.0 if every else _towards(normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2])
        if facing < 0.0:
            continue
        x, y, z = to_camera(r, t, xyz[m, 0], xyz[m, 1], xyz[m, 2])
        if z <= 0.0:
            continue
        u, v = f * x / z, f * y / z
        s = lookup(raster, grid, u, v)
        if s == OUT:
            continue
        if s >= 0 and s not in (a, b, c):
            reach2 = rules.tolerance**2 * min(3.0, 1.0 + 0.5 * math.sqrt(((u - cx) ** 2 + (v - cy) ** 2) / size2)) ** 2
            d2 = (p[s, 0] - u) ** 2 + (p[s, 1] - v) ** 2
            if d2 < reach2:
                if every and _towards(normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2]) < 0.0:
                    continue
                marker[pairs], spot[pairs] = m, s
                new = 1
                for q in range(3, pairs if every else 3):
                    new *= spot[q] != s
                pairs += new
                chance = CORE_MASS * math.pi * max(d2, CORE2 * reach2) * density[s]
                score += new if every else math.log(rules.p_seen / chance)
                continue
        if facing > GRAZING and not every:
            score += math.log(1.0 - rules.p_seen)
            if score < rules.reject_at:
                return 0
    return pairs if score > enough or pairs == PAIRS else 0


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
