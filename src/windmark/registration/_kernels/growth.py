"""Steps 4 to 6 of the search as a numba kernel: match, refine, count, until nothing changes.

Private to the registration room; works in the search plane (see `search.plane`). The few pairs that support a
hypothesis give a first least-squares pose; from then on every marker is matched within a gate that its
predicted uncertainty opens, one to one, and the pose is refined again: far markers join as the pose
becomes known. Readable twin: tests/registration/slow_twins.py.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import cholesky, solve_factored
from windmark.geometry._jit import nb
from windmark.geometry._kernels import to_camera
from windmark.registration._kernels.hypothesis import GRAZING, OUT, Model, Picture, _towards, lookup

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

STEPS = 10
"""Most rounds of matching and refining."""
PRIOR_WORTH = 4.0
"""How many coordinates the expected misfit counts for in the estimate of the misfit."""


class Gates(NamedTuple):
    """Constants of growth."""

    tolerance: float  # px: a match is never farther than three of it, and no farther than one once the pose is known
    sigma: float  # px, expected misfit per coordinate of a good solution
    min_score: float  # a solution worth less is given up
    focal_low: float  # range of a free focal length; equal where it is fixed
    focal_high: float
    least: int = 5  # a solution with fewer pairs is given up, and one ...
    least_part: float = 0.2  # ... with less than this part of the markers that should be seen


@nb.njit(cache=True, nogil=True, error_model="numpy")
def grow(
    model: Model, picture: Picture, gates: Gates, match: Ints, r: Array, t: Array, f: float, count: int
) -> tuple[float, float, int]:
    """Grow one hypothesis of ``count`` pairs in place; its score (-inf: given up), focal length and pairs."""
    markers, spots = model.xyz.shape[0], picture.p.shape[0]
    last, owner, best = np.empty(markers, np.int32), np.empty(spots, np.int32), np.empty(spots)
    factor, step = np.empty((7, 7)), np.empty(7)
    score, variance = -math.inf, gates.sigma**2
    for round_ in range(STEPS):
        size = 7 if gates.focal_high > gates.focal_low and count >= 6 else 6
        score = -math.inf
        good, f = refine(model.xyz, picture.p, match, r, t, f, factor, step, size, variance)
        if not good or (size == 7 and not gates.focal_low < f < gates.focal_high):
            break
        for m in range(markers):
            last[m] = match[m]
        count, expected, squares = _assign(model, picture, gates, r, t, f, factor, size, variance, match, owner, best)
        if count < gates.least or count < gates.least_part * expected:
            break
        # The expected misfit takes part, so that few markers do not fake precision.
        variance = (PRIOR_WORTH * gates.sigma**2 + squares) / (PRIOR_WORTH + max(2 * count - size, 0))
        score = likelihood(picture.density, match, count, expected, squares, variance)
        changed = 0
        for m in range(markers):
            changed += match[m] != last[m]
        if changed == 0 or (round_ > 0 and score < gates.min_score):
            break
    return (score if score >= gates.min_score else -math.inf), f, count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def refine(
    xyz: Array, p: Array, match: Ints, r: Array, t: Array, f: float,
    factor: Array, step: Array, size: int, variance: float,
) -> tuple[bool, float]:  # fmt: skip
    """Two Gauss-Newton steps on the matched markers; whether they are sane, and the focal length."""
    for _ in range(2):
        if not _normal_equations(xyz, p, match, r, t, f, factor, step, size, 10.0 * variance):
            return False, f
        solve_factored(factor, step, size)
        if step[0] ** 2 + step[1] ** 2 + step[2] ** 2 > 1.0:
            return False, f
        _move(r, t, step)
        if size == 7:
            f *= math.exp(min(0.3, max(-0.3, step[6])))
    return True, f


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _derivative(r: Array, t: Array, f: float, x: float, y: float, z: float, u_row: Array, v_row: Array) -> None:
    """Projection of a point and its derivative by [rotation, translation, log focal]; element 6 is the projection.

    The rotation turns about the model's centre (the origin), so it hardly couples with the translation.
    """
    ax = r[0, 0] * x + r[0, 1] * y + r[0, 2] * z
    ay = r[1, 0] * x + r[1, 1] * y + r[1, 2] * z
    az = r[2, 0] * x + r[2, 1] * y + r[2, 2] * z
    s = f / (az + t[2])
    u, v = s * (ax + t[0]), s * (ay + t[1])
    gu, gv = -u * s / f, -v * s / f
    u_row[0], u_row[1], u_row[2] = gu * ay, s * az - gu * ax, -s * ay
    v_row[0], v_row[1], v_row[2] = gv * ay - s * az, -gv * ax, s * ax
    u_row[3], u_row[4], u_row[5], u_row[6] = s, 0.0, gu, u
    v_row[3], v_row[4], v_row[5], v_row[6] = 0.0, s, gv, v


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _normal_equations(
    xyz: Array, p: Array, match: Ints, r: Array, t: Array, f: float, a: Array, g: Array, size: int, weak: float
) -> bool:
    """Cholesky factor (lower) of J'J into ``a`` and J'(observed - projected) into ``g``; False if singular.

    ``weak`` is the weight of "the focal length stays": without it frontal views of flat models diverge.
    """
    u_row, v_row = np.empty(7), np.empty(7)
    for i in range(7):
        g[i] = 0.0
        for j in range(7):
            a[i, j] = 0.0
    a[6, 6] = weak
    for m in range(xyz.shape[0]):
        spot = match[m]
        if spot < 0:
            continue
        _derivative(r, t, f, xyz[m, 0], xyz[m, 1], xyz[m, 2], u_row, v_row)
        du, dv = p[spot, 0] - u_row[6], p[spot, 1] - v_row[6]
        for i in range(size):
            g[i] += u_row[i] * du + v_row[i] * dv
            for j in range(i + 1):
                a[i, j] += u_row[i] * u_row[j] + v_row[i] * v_row[j]
    return cholesky(a, size, 1e-9)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _move(r: Array, t: Array, step: Array) -> None:
    """Apply a step to the pose in place (Rodrigues' formula on the columns of r)."""
    wx, wy, wz = step[0], step[1], step[2]
    angle = math.sqrt(wx * wx + wy * wy + wz * wz)
    if angle > 0.0:
        c, s = math.cos(angle), math.sin(angle)
        wx, wy, wz = wx / angle, wy / angle, wz / angle
        for j in range(3):
            x, y, z = r[0, j], r[1, j], r[2, j]
            d = (wx * x + wy * y + wz * z) * (1.0 - c)
            r[0, j] = c * x + s * (wy * z - wz * y) + d * wx
            r[1, j] = c * y + s * (wz * x - wx * z) + d * wy
            r[2, j] = c * z + s * (wx * y - wy * x) + d * wz
    for i in range(3):
        t[i] += step[3 + i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _spread(
    r: Array, t: Array, f: float, x: float, y: float, z: float, a: Array, size: int, u_row: Array, v_row: Array
) -> float:
    """Variance of a projection per unit of spot variance, both coordinates together, from the Cholesky factor."""
    _derivative(r, t, f, x, y, z, u_row, v_row)
    total = 0.0
    for row in (u_row, v_row):
        for i in range(size):
            for k in range(i):
                row[i] -= a[i, k] * row[k]
            row[i] /= a[i, i]
            total += row[i] * row[i]
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _assign(
    model: Model, picture: Picture, gates: Gates, r: Array, t: Array, f: float, factor: Array, size: int,
    variance: float, match: Ints, owner: Ints, best: Array,
) -> tuple[int, int, float]:  # fmt: skip
    """Match every marker to the spot in its gate, one to one; the number matched, expected, and sum of squares."""
    xyz, normal, p, raster = model.xyz, model.normal, picture.p, picture.raster
    grid = (picture.x0, picture.y0, picture.per_px)
    u_row, v_row = np.empty(7), np.empty(7)
    gate2 = min(gates.tolerance, max(0.25 * gates.tolerance, 3.5 * math.sqrt(variance))) ** 2
    ex = -(r[0, 0] * t[0] + r[1, 0] * t[1] + r[2, 0] * t[2])
    ey = -(r[0, 1] * t[0] + r[1, 1] * t[1] + r[2, 1] * t[2])
    ez = -(r[0, 2] * t[0] + r[1, 2] * t[1] + r[2, 2] * t[2])
    for s in range(owner.shape[0]):
        owner[s] = -1
    expected, count, squares = 0, 0, 0.0
    for m in range(xyz.shape[0]):
        match[m] = -1
        facing = _towards(normal, m, ex - xyz[m, 0], ey - xyz[m, 1], ez - xyz[m, 2])
        x, y, z = to_camera(r, t, xyz[m, 0], xyz[m, 1], xyz[m, 2])
        if z <= 0.0 or facing < 0.0:
            continue
        u, v = f * x / z, f * y / z
        s = lookup(raster, grid, u, v)
        if s == OUT:
            continue
        d2 = (p[s, 0] - u) ** 2 + (p[s, 1] - v) ** 2 if s >= 0 else math.inf
        limit2 = gate2
        if d2 > gate2:
            limit2 += 9.0 * variance * _spread(r, t, f, xyz[m, 0], xyz[m, 1], xyz[m, 2], factor, size, u_row, v_row)
        # Where the pose does not know yet, nothing is expected.
        if facing > GRAZING and limit2 < 4.0 * gates.tolerance**2:
            expected += 1
        if d2 < min(limit2, 9.0 * gates.tolerance**2) and (owner[s] < 0 or d2 < best[s]):
            owner[s], best[s] = m, d2
    for s in range(owner.shape[0]):
        if owner[s] >= 0:
            match[owner[s]] = s
            count += 1
            squares += best[s]
    return count, max(expected, count), squares


@nb.njit(cache=True, nogil=True, error_model="numpy")
def likelihood(density: Array, match: Ints, count: int, expected: int, squares: float, variance: float) -> float:
    """Log-likelihood ratio of a solution: its matched spots against chance, its missing ones against it.

    A matched spot is Gaussian with ``variance`` per coordinate about the projection if the solution is
    right, uniform with the local density of spots if not. The chance to see a marker is taken from the
    solution itself, within 25 and 95 %.
    """
    p_seen = min(0.95, max(0.25, (count + 1.0) / (expected + 2.0)))
    score = (expected - count) * math.log(1.0 - p_seen) - 0.5 * squares / variance
    gain = math.log(p_seen / (2.0 * math.pi * variance))
    for m in range(match.shape[0]):
        if match[m] >= 0:
            score += gain - math.log(density[match[m]])
    return score
