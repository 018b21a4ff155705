"""A quick test of four pairs before P3P, as numba kernels; twin: tests/registration/test_quads.py."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def sight_of(p: Array, a: int, b: int, c: int, d: int, f: float) -> tuple[float, float, float, float, float, float]:
    """Directions of b, c, d in the frame of a camera of unit focal length turned towards a."""
    h = 1.0 / math.sqrt(p[a, 0] ** 2 + p[a, 1] ** 2 + f * f)
    zx, zy, zz = h * p[a, 0], h * p[a, 1], h * f
    g = 1.0 / math.sqrt(zx * zx + zz * zz)
    # x = (zz, 0, -zx) g is perpendicular to z; y = z cross x.
    yx, yy, yz = -zy * zx * g, (zz * zz + zx * zx) * g, -zy * zz * g
    kb = 1.0 / (zx * p[b, 0] + zy * p[b, 1] + zz * f)
    kc = 1.0 / (zx * p[c, 0] + zy * p[c, 1] + zz * f)
    kd = 1.0 / (zx * p[d, 0] + zy * p[d, 1] + zz * f)
    return (
        (zz * p[b, 0] - zx * f) * g * kb, (yx * p[b, 0] + yy * p[b, 1] + yz * f) * kb,
        (zz * p[c, 0] - zx * f) * g * kc, (yx * p[c, 0] + yy * p[c, 1] + yz * f) * kc,
        (zz * p[d, 0] - zx * f) * g * kd, (yx * p[d, 0] + yy * p[d, 1] + yz * f) * kd,
    )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fits(
    xyz: Array, i: int, j: int, k: int, m: int, sight: tuple[float, float, float, float, float, float], slack: float
) -> bool:
    """Whether four markers can be seen like this, to first order in the perspective; ten times cheaper than P3P.

    Three points seen from afar leave one scale and two mirrored orientations (Huttenlocher and Ullman 1990). The
    depths that follow correct the perspective; the anchor must then be where the camera looks.
    """
    bx, by, cx, cy, dx, dy = sight
    ox, oy, oz = xyz[j, 0], xyz[j, 1], xyz[j, 2]
    e1x, e1y, e1z = xyz[k, 0] - ox, xyz[k, 1] - oy, xyz[k, 2] - oz
    e2x, e2y, e2z = xyz[m, 0] - ox, xyz[m, 1] - oy, xyz[m, 2] - oz
    e3x, e3y, e3z = xyz[i, 0] - ox, xyz[i, 1] - oy, xyz[i, 2] - oz
    g11, g12 = e1x * e1x + e1y * e1y + e1z * e1z, e1x * e2x + e1y * e2y + e1z * e2z
    g22 = e2x * e2x + e2y * e2y + e2z * e2z
    h1, h2 = e1x * e3x + e1y * e3y + e1z * e3z, e2x * e3x + e2y * e3y + e2z * e3z
    det = g11 * g22 - g12 * g12
    per = 1.0 / det  # divisions are half of the time that this takes
    # The anchor is alpha e1 + gamma e2 + height (e1 cross e2) from b.
    alpha, gamma = (h1 * g22 - h2 * g12) * per, (h2 * g11 - h1 * g12) * per
    height = ((e1y * e2z - e1z * e2y) * e3x + (e1z * e2x - e1x * e2z) * e3y + (e1x * e2y - e1y * e2x) * e3z) * per
    ux, uy, vx, vy = cx - bx, cy - by, dx - bx, dy - by
    u2, v2, uv = ux * ux + uy * uy, vx * vx + vy * vy, ux * vx + uy * vy
    half = 0.5 * (u2 * g22 + v2 * g11 - 2.0 * uv * g12)
    s2 = (half + math.sqrt(max(half * half - det * (u2 * v2 - uv * uv), 0.0))) * per
    w1, w2 = math.sqrt(max(s2 * g11 - u2, 0.0)), math.sqrt(max(s2 * g22 - v2, 0.0))
    if s2 * g12 < uv:
        w2 = -w2
    # The camera's depth axis points away from the viewer, so (u, v, w) is right-handed with y down.
    lift = height / math.sqrt(s2)
    flat = lift * (ux * vy - uy * vx)
    ax, ay = bx + alpha * ux + gamma * vx, by + alpha * uy + gamma * vy
    for sign in (1.0, -1.0):
        p1, p2 = sign * w1, sign * w2
        wb = -(alpha * p1 + gamma * p2 + flat)
        wc, wd = wb + p1, wb + p2
        beta = 1.0 - alpha - gamma
        x = lift * (uy * p2 - p1 * vy) + ax
        y = lift * (p1 * vx - ux * p2) + ay
        sx = beta * wb * bx + alpha * wc * cx + gamma * wd * dx
        sy = beta * wb * by + alpha * wc * cy + gamma * wd * dy
        room = slack + 0.5 * (abs(sx) + abs(sy))
        x, y = x + sx, y + sy
        if x * x + y * y < room * room:
            return True
    return False
