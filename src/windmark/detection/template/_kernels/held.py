"""Image of an ellipse whose blur is held, with its derivatives by the centre: fast, for fits of a known shape. Private.

A point of the outline adds to the pixels round it what `model.disc_sums` adds, products of one number per column and
one per row. With one blur for all these numbers depend only on where between two pixels the point lies. They are
tabulated with two derivatives, and a point costs its few products instead of some thirty Gaussian integrals.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection.template._kernels.model import CUT, normal_edges
from windmark.geometry._jit import nb

NODES = 32  # of the table, per pixel: 4e-6 of the depth are left at a blur of 0.5 px
LANES = 8  # columns are added in groups of so many


@nb.njit(cache=True, nogil=True, error_model="numpy")
def pixel_table(sigma: float) -> Any:
    """What `held_sums` wants to know of a blur: table (NODES + 1, 4, W), H, scratch (3, W).

    The table is for points at n / NODES - 0.5 from the middle pixel of 2 H + 1; columns beyond these are 0. Its rows
    are the blurred edge's integral over each pixel and that integral's first three derivatives by the point's place.
    """
    half = int(math.floor(CUT * sigma + 1.0))
    many = 2 * half + 1
    out = np.zeros((NODES + 1, 4, -(-many // LANES) * LANES))
    cdf, pdf, inv = np.empty(many + 1), np.empty(many + 1), 1.0 / sigma
    rim = math.exp(-0.5 * CUT * CUT) / math.sqrt(2.0 * math.pi)
    slope = rim / (1.0 - math.erfc(CUT / math.sqrt(2.0)))
    for n in range(NODES + 1):
        start = (-half - 0.5 - (n / NODES - 0.5)) * inv
        normal_edges(start, inv, many + 1, cdf, pdf)
        for i in range(many):
            t = start + i * inv
            first, last = (pdf[i] + slope) * (abs(t) < CUT), (pdf[i + 1] + slope) * (abs(t + inv) < CUT)
            edge = pdf[i] - pdf[i + 1]
            out[n, 0, i] = sigma * (edge - t * (1.0 - cdf[i]) + (t + inv) * (1.0 - cdf[i + 1]))
            out[n, 1, i] = cdf[i + 1] - cdf[i]
            out[n, 2, i] = edge * inv
            out[n, 3, i] = (t * first - (t + inv) * last) * inv * inv
    return out, half, np.empty((3, out.shape[2]))


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def held_sums(p: Any, points: int, edges: Any, g: Any) -> None:
    """As `model.disc_sums` for `CENTRE`: g[0], g[1], g[6]; g[7] is scratch, the others are left.

    `edges` of `pixel_table` for the blur p[5].
    """
    table, half, scratch = edges
    size, wide = g.shape[1], table.shape[2]
    plane = size * size
    cx, cy, a, b, d = p[0] + size // 2, p[1] + size // 2, p[2], p[3], p[4]
    step = 2.0 * math.pi / points
    ax, kx, ky = scratch[0], scratch[1], scratch[2]
    flat = g.reshape(g.size)
    g[:2] = 0.0
    g[6:8] = 0.0
    ct, st, co, si = math.cos(step), math.sin(step), 1.0, 0.0
    for _ in range(points):
        u, v = cx + a * co + b * si, cy + b * co + d * si
        du, dv = step * (b * co - a * si), step * (d * co - b * si)
        iu, iv = math.floor(u + 0.5), math.floor(v + 0.5)
        rows_x, rows_y = (u - iu + 0.5) * NODES, (v - iv + 0.5) * NODES
        nx, ny = np.uint64(rows_x + 0.5), np.uint64(rows_y + 0.5)
        hx, hy = (rows_x - nx) / NODES, (rows_y - ny) / NODES
        near, up = table[nx], table[ny]
        for i in range(wide):
            kx[i] = near[1, i] + hx * (near[2, i] + 0.5 * hx * near[3, i])
            ax[i] = near[0, i] + hx * (near[1, i] + hx * (0.5 * near[2, i] + hx / 6.0 * near[3, i]))
            ky[i] = up[1, i] + hy * (up[2, i] + 0.5 * hy * up[3, i])
        left, top = int(iu) - half, int(iv) - half
        j0, j1 = max(0, -top), min(2 * half + 1, size - top)
        if left >= 0 and left + wide <= size:
            for j in range(j0, j1):
                qv, qu = ky[j] * dv, ky[j] * du
                at = np.uint64((top + j) * size + left)
                for i in range(wide):
                    flat[at + np.uint64(6 * plane + i)] += ax[i] * qv
                for i in range(wide):
                    flat[at + np.uint64(i)] += kx[i] * qv
                for i in range(wide):
                    flat[at + np.uint64(plane + i)] -= kx[i] * qu
        else:
            for j in range(j0, j1):
                qv, qu = ky[j] * dv, ky[j] * du
                for i in range(max(0, -left), min(2 * half + 1, size - left)):
                    g[6, top + j, left + i] += ax[i] * qv
                    g[0, top + j, left + i] += kx[i] * qv
                    g[1, top + j, left + i] -= kx[i] * qu
        if left > 0:
            for j in range(j0, j1):
                g[7, top + j, min(left, size) - 1] += ky[j] * dv
        co, si = co * ct - si * st, si * ct + co * st
    for j in range(size):
        inside = 0.0
        for i in range(size - 1, -1, -1):
            inside += g[7, j, i]
            g[6, j, i] += inside
