"""Exhaustive search for a disc of known shape round a predicted place. Private."""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np

from windmark.detection._kernels_template_model import disc_sums, points_needed

FOUND = ("x", "y", "correlation", "depth", "background")  # columns of `search_discs`


@nb.njit(cache=True, nogil=True, error_model="numpy")
def flat_template(p: Any, reach: float, table: Any, g: Any, inside: Any, template: Any) -> tuple[float, float, float]:
    """Disc image less its plane over a round window (S, S); returns its square sum, pixels and sum of x^2 of the
    window.
    """
    disc_sums(p, points_needed(p), False, table, g)
    half, n, xx, t0, tx, ty, tt = template.shape[0] // 2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(template.shape[0]):
        for i in range(template.shape[0]):
            x, y = float(i - half), float(j - half)
            w = 1.0 if x * x + y * y <= reach * reach else 0.0
            t = w * g[6, j, i]
            inside[j, i], n, xx = w, n + w, xx + w * x * x
            t0, tx, ty = t0 + t, tx + t * x, ty + t * y
    for j in range(template.shape[0]):
        for i in range(template.shape[0]):
            plane = t0 / n + (tx * (i - half) + ty * (j - half)) / xx
            template[j, i] = inside[j, i] * (g[6, j, i] - plane)
            tt += template[j, i] * template[j, i]
    return tt, n, xx


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def window_match(
    patch: Any, dx: int, dy: int, inside: Any, template: Any, n: float, xx: float
) -> tuple[float, float, float]:
    """Sum of template times window, square sum of the window without its plane, mean: window at (dx, dy) in the
    patch.
    """
    half, g0, gx, gy, gg, gt = template.shape[0] // 2, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(template.shape[0]):
        row, w, t = patch[dy + j, dx : dx + template.shape[0]], inside[j], template[j]
        r0 = rx = rr = rt = 0.0
        for i in range(template.shape[0]):
            v = w[i] * row[i]
            r0 += v
            rx += v * (i - half)
            rr += v * row[i]
            rt += t[i] * row[i]
        g0, gx, gy, gg, gt = g0 + r0, gx + rx, gy + r0 * (j - half), gg + rr, gt + rt
    return gt, gg - g0 * g0 / n - (gx * gx + gy * gy) / xx, g0 / n


@nb.njit(cache=True, nogil=True, error_model="numpy")
def search_discs(patches: Any, discs: Any, reach: Any, search: int, out: Any) -> None:
    """Best place of each disc within +-search pixels: rows of `FOUND`, relative to the middle of the patch.

    `patches` (M, P, P) with P = S + 2 search, holes on a mean of 0; `discs` (M, 6) as in `disc_sums`, within half a
    pixel of the
    middle. The best window has the largest correlation; a parabola through its neighbours places it within the pixel.
    """
    size, steps = patches.shape[1] - 2 * search, 2 * search + 1
    g, table = np.empty((10, size, size)), np.empty((8, size + 6))
    inside, template, rho = np.empty((size, size)), np.empty((size, size)), np.empty((steps, steps))
    for k in range(patches.shape[0]):
        tt, n, xx = flat_template(discs[k], reach[k], table, g, inside, template)
        best, bx, by = -2.0, 0, 0
        for j in range(steps):
            for i in range(steps):
                match, square, mean = window_match(patches[k], i, j, inside, template, n, xx)
                rho[j, i] = -match / math.sqrt(tt * square) if square > 0.0 else 0.0
                if rho[j, i] > best:
                    best, bx, by = rho[j, i], i, j
                    out[k, 3], out[k, 4] = -match / tt, mean
        out[k, 0], out[k, 1], out[k, 2] = bx - search + discs[k, 0], by - search + discs[k, 1], best
        if 0 < bx < steps - 1:
            bend = rho[by, bx - 1] - 2.0 * best + rho[by, bx + 1]
            out[k, 0] += 0.5 * (rho[by, bx - 1] - rho[by, bx + 1]) / bend if bend < 0.0 else 0.0
        if 0 < by < steps - 1:
            bend = rho[by - 1, bx] - 2.0 * best + rho[by + 1, bx]
            out[k, 1] += 0.5 * (rho[by - 1, bx] - rho[by + 1, bx]) / bend if bend < 0.0 else 0.0
