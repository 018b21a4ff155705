"""How a fitted disc's outline and inside differ from an even ellipse's. Private; arrays in, arrays out."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection.template._kernels.algebra import add_products, factor, substitute
from windmark.detection.template._kernels.model import CUT, evaluate, normal_edges, points_needed, whole
from windmark.detection.template._kernels.rim import rim_distance
from windmark.geometry._jit import nb

FIT = 10  # unknowns of the template
WAVES = (3, 4, 5)  # of the outline round the disc; 0 to 2 are ellipses too
INSIDE = 3  # slope along both axes, and a hole
OUTLINE = 2 * len(WAVES)
EXTRA = OUTLINE + INSIDE
COUNT = FIT + EXTRA
DAMPING = 1e-7  # of the normal equations: blur and size of points are one unknown
REACH_PX, REACH_BLURS = 1.0, 3.0  # beyond the edge
TRIALS = 8  # of the template beside the deviations
STILL = 1e-3  # of the squared residuals: no step brings more
CHANCE = FIT + 2.0 * math.sqrt(2.0 * FIT)  # noise variances by which noise lets the template leave less
MOST = 1.5  # factor by which the template may differ from the fitted one
SAMPLES = 4.0  # of the window's pixels per half axis are enough


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _waves(p: Any, points: int, table: Any, g: Any) -> None:
    """Change of the blurred ellipse's image by waves of its outline, r -> r (1 + a cos k t + b sin k t): g (., S, S).

    By Green's theorem as the derivatives of `disc_model`: the integral of K_i(u) K_j(v) (u_a dv - v_a du).
    """
    size = g.shape[1]
    cx, cy, a, b, d, sigma = p[0] + size // 2, p[1] + size // 2, p[2], p[3], p[4], p[5]
    inv, reach, step = 1.0 / sigma, CUT * sigma + 0.5, 2.0 * math.pi / points
    cdf, pdf, kx, ky = table[0], table[1], table[2], table[3]
    g[:OUTLINE] = 0.0
    for n in range(points):
        t = n * step
        co, si = math.cos(t), math.sin(t)
        u, v = a * co + b * si, b * co + d * si
        area = step * (u * (d * co - b * si) - v * (b * co - a * si))
        u, v = u + cx, v + cy
        i0, i1 = max(0, int(math.ceil(u - reach))), min(size, int(math.floor(u + reach)) + 1)
        j0, j1 = max(0, int(math.ceil(v - reach))), min(size, int(math.floor(v + reach)) + 1)
        ni, nj = min(whole(max(i1 - i0, 0)), max(size - i0, 0)), max(j1 - j0, 0)
        normal_edges((i0 - 0.5 - u) * inv, inv, whole(ni + 1), cdf, pdf)
        for i in range(ni):
            kx[i] = cdf[i + 1] - cdf[i]
        normal_edges((j0 - 0.5 - v) * inv, inv, whole(nj + 1), cdf, pdf)
        for j in range(nj):
            ky[j] = cdf[j + 1] - cdf[j]
        left, many = np.uint64(i0), np.uint64(ni)
        for m in range(OUTLINE):
            wave = WAVES[m // 2] * t
            share = area * (math.cos(wave) if m % 2 == 0 else math.sin(wave))
            for j in range(nj):
                row, strength = np.uint64(j0 + j), share * ky[j]
                for i in range(many):
                    g[m, row, left + i] += strength * kx[i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _normal(
    patch: Any, weight: Any, fitted: Any, p: Any, multiplicative: float, table: Any, jac: Any, res: Any, waves: Any,
    rows: Any, matrix: Any, rhs: Any,
) -> tuple[float, int]:  # fmt: skip
    """Normal equations of template `p` and deviations; squared residuals and number of pixels: the fitted one's.

    `rows` (COUNT + 1, S S) is scratch: a column for each pixel.
    """
    size, half, points = res.shape[0], res.shape[0] // 2, points_needed(p)
    evaluate(patch, weight, p, points, True, 0.0, multiplicative, table, jac, res)
    _waves(p, points, table, waves)
    det, around, squares, pixels = p[2] * p[4] - p[3] * p[3], fitted[2] * fitted[4] - fitted[3] * fitted[3], 0.0, 0
    step, reach = max(1, int(math.sqrt(around) / SAMPLES)), REACH_PX + REACH_BLURS * fitted[5]
    matrix[:], rhs[:] = 0.0, 0.0
    for j in range(half % step, size, step):
        for i in range(half % step, size, step):
            x, y = i - half - fitted[0], j - half - fitted[1]
            if weight[j, i] == 0.0 or rim_distance(x, y, fitted, around) > reach:
                continue
            x, y = i - half - p[0], j - half - p[1]
            for m in range(FIT):
                rows[m, pixels] = jac[m, j, i]
            light = 1.0 + multiplicative * (p[8] * (i - half) + p[9] * (j - half))
            for m in range(OUTLINE):
                rows[FIT + m, pixels] = -p[6] * light * waves[m, j, i]
            u, v, inside = (p[4] * x - p[3] * y) / det, (p[2] * y - p[3] * x) / det, p[6] * jac[6, j, i]
            rows[COUNT - 3, pixels], rows[COUNT - 2, pixels] = inside * u, inside * v
            rows[COUNT - 1, pixels], rows[COUNT, pixels] = inside * (u * u + v * v - 0.5), res[j, i]
            squares += res[j, i] * res[j, i]
            pixels += 1
    add_products(rows, pixels, matrix, rhs)
    return squares, pixels


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _unexplained(
    matrix: Any, rhs: Any, squares: float, part: Any, rest: Any, root: Any, solved: Any, free: Any
) -> float:  # fmt: skip
    """Squared residuals that the deviations alone leave, the template as it is; NaN where they are not determined.

    `part`, `rest`, `root`, `solved`, `free` are scratch for them.
    """
    for m in range(EXTRA):
        rest[m] = rhs[FIT + m]
        for n in range(m + 1):
            part[m, n] = matrix[FIT + m, FIT + n]
    if not factor(part, DAMPING, free, root):
        return math.nan
    substitute(root, rest, free, solved)
    for m in range(EXTRA):
        squares -= rest[m] * solved[m]
    return squares


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _is_like(p: Any, start: Any) -> bool:
    """Whether a template is still about the fitted one; beyond this deviations stand for something else."""
    mean, before = math.sqrt(max(p[2] * p[4] - p[3] * p[3], 0.0)), math.sqrt(start[2] * start[4] - start[3] * start[3])
    grown, blurred = mean / before, p[5] / start[5]
    away = math.hypot(p[0] - start[0], p[1] - start[1])
    return 1.0 / MOST < grown < MOST and 1.0 / MOST < blurred < MOST and away < (MOST - 1.0) * before and p[2] > 0.0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _told(solved: Any, root: Any, value: Any, weight: Any) -> None:
    """The deviations, and the inverse of their covariance: the factor's last block is what the template leaves open."""
    for m in range(EXTRA):
        value[m] = solved[FIT + m]
        for n in range(EXTRA):
            weight[m, n] = 0.0
            for q in range(min(m, n) + 1):
                weight[m, n] += root[FIT + m, FIT + q] * root[FIT + n, FIT + q]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def deviations(
    patches: Any, weights: Any, params: Any, noise2: Any, multiplicative: float, value: Any, weight: Any, left: Any
) -> None:
    """How the discs of M patches (M, S, S) deviate from an ellipse's template, by least squares of both together.

    Unknowns: those of the template; waves of the outline relative to the radius; change of the depth relative to it,
    along both axes of the unit disc, and of its middle against its edge. The fitted template has taken up what it can
    of another thing's shape (its blur grows over the corners of a square), so that the template is moved to where it
    leaves, together with the deviations, the least: by Gauss and Newton's steps, halved where they leave more
    (variable projection, Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973), as long as it stays about the fitted one
    and as a step promises more than noise would: beside noise alone it would wander along the valley between size and
    blur, and what its derivatives say of it at the fitted one is as good.
    A small ring, whose hole such a template would fill by its blur, shows at the fitted one.

    Parameters
    ----------
    patches, weights : as of `template.fit.cut_patches`
    params : (M, 10) as in `template._kernels.model`
    noise2 : (M,) variance of one pixel
    value : (M, 2, EXTRA) deviations from the fitted and from the moved template, NaN where the pixels do not determine
        them
    weight : (M, 2, EXTRA, EXTRA) inverses of their covariances in noise of variance 1, the template left open
    left : (M, 2) variance of what is then left
    """
    size = patches.shape[1]
    jac, res, table = np.empty((10, size, size)), np.empty((size, size)), np.empty((8, size + 6))
    waves, matrix = np.empty((OUTLINE, size, size)), np.empty((COUNT, COUNT))
    rows = np.empty((COUNT + 1, size * size))
    rhs, root, solved = np.empty(COUNT), np.empty((COUNT, COUNT)), np.empty(COUNT)
    part, rest, half = np.empty((EXTRA, EXTRA)), np.empty(EXTRA), np.empty((EXTRA, EXTRA))
    some, none, free = np.empty(EXTRA), np.zeros(EXTRA, np.bool_), np.zeros(COUNT, np.bool_)
    good, p, step = np.empty(FIT), np.empty(FIT), np.empty(FIT)
    for k in range(patches.shape[0]):
        value[k], weight[k], left[k] = math.nan, math.nan, math.nan
        good[:], p[:], step[:], least, first = params[k], params[k], 0.0, math.inf, 0
        for _ in range(TRIALS):
            squares, pixels = _normal(
                patches[k], weights[k], params[k], p, multiplicative, table, jac, res, waves, rows, matrix, rhs
            )
            if pixels <= COUNT:
                break
            now = _unexplained(matrix, rhs, squares, part, rest, half, some, none)
            if now < least and factor(matrix, DAMPING, free, root):
                good[:], found, least = p, now < least * (1.0 - STILL), now
                substitute(root, rhs, free, solved)
                for m in range(COUNT):
                    squares -= rhs[m] * solved[m]
                for m in range(first, 2):
                    left[k, m] = max(squares, 0.0) / (pixels - COUNT)
                    _told(solved, root, value[k, m], weight[k, m])
                step[:], first = solved[:FIT], 1
                if not found or not squares < now - max(STILL * now, CHANCE * noise2[k]):  # nor would the next step
                    break
            else:
                step *= 0.5
            if math.isinf(least):
                break
            p[:] = good + step
            for _ in range(TRIALS):
                if _is_like(p, params[k]):
                    break
                step *= 0.5
                p[:] = good + step


@nb.njit(cache=True, nogil=True, error_model="numpy")
def hide(weights: Any, which: Any, params: Any) -> None:
    """Weight 0 in patch which[n] (of M, S, S) for the pixels of ellipse n: x, y from its middle, L_xx, L_xy, L_yy."""
    half = weights.shape[1] // 2
    for n in range(len(which)):
        x0, y0, a, b, d = params[n, 0], params[n, 1], params[n, 2], params[n, 3], params[n, 4]
        det, weight = a * d - b * b, weights[which[n]]
        for j in range(weight.shape[0]):
            y = j - half - y0
            for i in range(weight.shape[0]):
                x = i - half - x0
                u, v = (d * x - b * y) / det, (a * y - b * x) / det
                if u * u + v * v <= 1.0:
                    weight[j, i] = 0.0
