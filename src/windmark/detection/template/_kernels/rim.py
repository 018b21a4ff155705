"""How much of a fitted disc's edge is really there, sector by sector. Private to the decision about markers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection.template._kernels.cut import sector_of
from windmark.detection.template._kernels.model import evaluate, points_needed
from windmark.geometry._jit import nb

SECTORS = 8
RIM_PX, RIM_BLURS = 1.0, 1.5  # the rim reaches so far to both sides of the edge: half of it is light, half dark
LEAST_PIXELS = 4  # of a sector on average; small discs have fewer sectors


@nb.njit(cache=True, nogil=True, error_model="numpy")
def rim_distance(x: float, y: float, p: Any, det: float) -> float:
    """Distance of a place, relative to the centre, from the ellipse: first order, positive outside."""
    u, v = (p[4] * x - p[3] * y) / det, (p[2] * y - p[3] * x) / det
    q2 = u * u + v * v
    a, b = p[4] * u - p[3] * v, p[2] * v - p[3] * u
    w = math.sqrt(a * a + b * b) / det
    return (q2 - math.sqrt(q2)) / w if w > 0.0 else -math.inf


@nb.njit(cache=True, nogil=True, error_model="numpy")
def rim_shares(patches: Any, weights: Any, params: Any, noise2: Any, multiplicative: float, out: Any) -> None:
    """Share of the edge that the model explains in each sector of M patches (M, S, S): out (M, SECTORS).

    1 - (squared residuals less the noise's and two standard deviations of that) / (squared variation of the model) over
    the rim's pixels of a sector; NaN where too few of them can be used. Sectors are of equal angle where the ellipse is
    a circle. `params` (M, 10) as in `_kernels.model`; `noise2` (M,) variance of one pixel.
    """
    size = patches.shape[1]
    half = size // 2
    jac, res, table = np.empty((10, size, size)), np.empty((size, size)), np.empty((8, size + 6))
    sums, away = np.empty((SECTORS, 4)), np.empty((size, size))
    for k in range(patches.shape[0]):
        p = params[k]
        evaluate(patches[k], weights[k], p, points_needed(p), False, 0.0, multiplicative, table, jac, res)
        reach, det, rim = RIM_PX + RIM_BLURS * p[5], p[2] * p[4] - p[3] * p[3], 0
        for j in range(size):
            for i in range(size):
                away[j, i] = math.inf
                if weights[k, j, i] > 0.0 and (jac[0, j, i] != 0.0 or jac[1, j, i] != 0.0):  # the blurred rim is wider
                    away[j, i] = abs(rim_distance(i - half - p[0], j - half - p[1], p, det))
                rim += away[j, i] < reach
        sectors = min(max(rim // LEAST_PIXELS, 1), SECTORS)
        sums[:] = 0.0
        for j in range(size):
            for i in range(size):
                if not away[j, i] < reach:
                    continue
                x, y = i - half - p[0], j - half - p[1]
                u, v = (p[4] * x - p[3] * y) / det, (p[2] * y - p[3] * x) / det
                if sectors == SECTORS:
                    s = sector_of(u, v)
                else:
                    s = int((math.atan2(v, u) / (2.0 * math.pi) + 1.0) * sectors) % sectors
                model = patches[k, j, i] - res[j, i]
                sums[s, 0] += 1.0
                sums[s, 1] += model
                sums[s, 2] += model * model
                sums[s, 3] += res[j, i] * res[j, i]
        for s in range(SECTORS):
            n = sums[s, 0]
            varies = sums[s, 2] - sums[s, 1] ** 2 / max(n, 1.0)
            left = max(sums[s, 3] - (n + 2.0 * math.sqrt(2.0 * n)) * noise2[k], 0.0)
            out[k, s] = 1.0 - left / varies if n > 2 and varies > 0.0 else math.nan
