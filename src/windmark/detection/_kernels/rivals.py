"""How a fitted disc's outline and inside differ from an even ellipse's. Private; arrays in, arrays out."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection.template._kernels.algebra import factor, substitute
from windmark.detection.template._kernels.model import CUT, evaluate, normal_edges, points_needed
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
SAMPLES = 4.0  # of the window's pixels per half axis are enough


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _waves(p: Any, points: int, table: Any, g: Any) -> None:
    """Change of the blurred ellipse's image by waves of its outline, r -> r (1 + a cos k t + b sin k t): g (., S, S).

    By Green's theorem as the derivatives of `disc_model`: the integral of K_i(u) K_j(v) (u_a dv - v_a du).
    """
    size = g.shape[1]
    cx, cy, a, b, d, sigma = p[0] + size // 2, p[1] + size // 2, p[2], p[3], p[4], p[5]
    inv, reach, step = 1.0 / sigma, CUT * sigma + 0.5, 2.0 * math.pi / points
    cdf, pdf, kx = table[0], table[1], table[2]
    g[:OUTLINE] = 0.0
    for n in range(points):
        t = n * step
        co, si = math.cos(t), math.sin(t)
        u, v = a * co + b * si, b * co + d * si
        area = step * (u * (d * co - b * si) - v * (b * co - a * si))
        u, v = u + cx, v + cy
        i0, i1 = max(0, int(math.ceil(u - reach))), min(size, int(math.floor(u + reach)) + 1)
        j0, j1 = max(0, int(math.ceil(v - reach))), min(size, int(math.floor(v + reach)) + 1)
        ni, nj = max(i1 - i0, 0), max(j1 - j0, 0)
        normal_edges((i0 - 0.5 - u) * inv, inv, ni + 1, cdf, pdf)
        for i in range(ni):
            kx[i] = cdf[i + 1] - cdf[i]
        normal_edges((j0 - 0.5 - v) * inv, inv, nj + 1, cdf, pdf)
        for m in range(OUTLINE):
            wave = WAVES[m // 2] * t
            share = area * (math.cos(wave) if m % 2 == 0 else math.sin(wave))
            for j in range(nj):
                row = share * (cdf[j + 1] - cdf[j])
                for i in range(ni):
                    g[m, j0 + j, i0 + i] += row * kx[i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _normal(
    patch: Any, weight: Any, p: Any, multiplicative: float, table: Any, jac: Any, res: Any, waves: Any, row: Any,
    matrix: Any, rhs: Any,
) -> tuple[float, float]:  # fmt: skip
    """Normal equations of template and deviations together; squared residuals and number of the pixels used."""
    size, half, points = res.shape[0], res.shape[0] // 2, points_needed(p)
    evaluate(patch, weight, p, points, True, 0.0, multiplicative, table, jac, res)
    _waves(p, points, table, waves)
    det, squares, pixels = p[2] * p[4] - p[3] * p[3], 0.0, 0.0
    step, reach = max(1, int(math.sqrt(det) / SAMPLES)), REACH_PX + REACH_BLURS * p[5]
    matrix[:], rhs[:] = 0.0, 0.0
    for j in range(half % step, size, step):
        for i in range(half % step, size, step):
            x, y = i - half - p[0], j - half - p[1]
            if weight[j, i] == 0.0 or rim_distance(x, y, p, det) > reach:
                continue
            for m in range(FIT):
                row[m] = jac[m, j, i]
            light = 1.0 + multiplicative * (p[8] * (i - half) + p[9] * (j - half))
            for m in range(OUTLINE):
                row[FIT + m] = -p[6] * light * waves[m, j, i]
            u, v, inside = (p[4] * x - p[3] * y) / det, (p[2] * y - p[3] * x) / det, p[6] * jac[6, j, i]
            row[COUNT - 3], row[COUNT - 2], row[COUNT - 1] = inside * u, inside * v, inside * (u * u + v * v - 0.5)
            for m in range(COUNT):
                rhs[m] += row[m] * res[j, i]
                for n in range(m + 1):
                    matrix[m, n] += row[m] * row[n]
            squares += res[j, i] * res[j, i]
            pixels += 1.0
    return squares, pixels


@nb.njit(cache=True, nogil=True, error_model="numpy")
def deviations(
    patches: Any, weights: Any, params: Any, multiplicative: float, value: Any, weight: Any, left: Any
) -> None:
    """How the discs of M patches (M, S, S) deviate from the fitted template, by one step of least squares.

    Unknowns: those of the template; waves of the outline relative to the radius; change of the depth relative to it,
    along both axes of the unit disc, and of its middle against its edge.

    Parameters
    ----------
    patches, weights : as of `template.fit.cut_patches`
    params : (M, 10) as in `template._kernels.model`
    value : (M, EXTRA) deviations, NaN where the pixels do not determine them
    weight : (M, EXTRA, EXTRA) inverse of their covariance in noise of variance 1, the template's unknowns left open
    left : (M,) variance of what is then left
    """
    size = patches.shape[1]
    jac, res, table = np.empty((10, size, size)), np.empty((size, size)), np.empty((8, size + 6))
    waves, row, matrix = np.empty((OUTLINE, size, size)), np.empty(COUNT), np.empty((COUNT, COUNT))
    rhs, root, solved = np.empty(COUNT), np.empty((COUNT, COUNT)), np.empty(COUNT)
    free = np.zeros(COUNT, np.bool_)
    for k in range(patches.shape[0]):
        squares, pixels = _normal(
            patches[k], weights[k], params[k], multiplicative, table, jac, res, waves, row, matrix, rhs
        )
        value[k], weight[k], left[k] = math.nan, math.nan, math.nan
        if pixels <= COUNT or not factor(matrix, DAMPING, free, root):
            continue
        substitute(root, rhs, free, solved)
        for m in range(COUNT):
            squares -= rhs[m] * solved[m]
        left[k] = max(squares, 0.0) / (pixels - COUNT)
        for m in range(EXTRA):
            value[k, m] = solved[FIT + m]
            for n in range(EXTRA):  # the factor's last block is that of what the template leaves open
                total = 0.0
                for q in range(min(m, n) + 1):
                    total += root[FIT + m, FIT + q] * root[FIT + n, FIT + q]
                weight[k, m, n] = total
