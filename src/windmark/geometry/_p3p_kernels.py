"""The perspective-three-point kernel: private to windmark, `p3p.py` has the verbs.

`_p3p_pencil` finds the depths but for rounding; here they are polished on the long edge, the foot of the height
on it and the height itself, which keeps flat triangles accurate (error eps / height, not eps / height^2 as with
the three edges), and turned into poses.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._p3p_pencil import (
    Vec3,
    adjugate,
    axpy,
    conics,
    cross,
    degenerate_conic,
    dot,
    line_conic,
    split,
    times,
)
from windmark.geometry.errors import COLLINEAR

Array = NDArray[np.float64]
Frame = tuple[Vec3, Vec3, Vec3]
Sight = tuple[Vec3, Vec3, Vec3, Vec3]  # rays 1 and 2, chords (ray 1 - ray 3) and (ray 2 - ray 3)

_RESIDUAL = 1e-11  # relative error of the three lengths up to which a solution is one
_NOISE = 1e-14  # the same for rounding of the rays, in units of the depth


@nb.njit(cache=True, nogil=True, error_model="numpy")
def p3p_kernel(rays: Array, xyz: Array, rotation_out: Array, translation_out: Array) -> int:
    """All poses ``R xyz_i + t = depth_i ray_i``, depth_i > 0; returns their number (0 when degenerate).

    rays (3, 3) unit, xyz (3, 3), rows are points; rotation_out (4, 3, 3), translation_out (4, 3).
    """
    k1, k2, k3 = _order(xyz)
    e13, e23 = _difference(xyz, k1, k3), _difference(xyz, k2, k3)
    long2 = dot(e23, e23)
    foot = dot(e13, e23) / long2
    height = axpy(-foot, e23, e13)
    h = math.sqrt(dot(height, height) / long2)
    if not h > 2.0 * COLLINEAR:
        return 0
    y1, y2 = (rays[k1, 0], rays[k1, 1], rays[k1, 2]), (rays[k2, 0], rays[k2, 1], rays[k2, 2])
    sight = y1, y2, _difference(rays, k1, k3), _difference(rays, k2, k3)
    shape = math.sqrt(dot(e13, e13) / long2), foot, h
    f, g, unit = conics(sight[2], sight[3], shape[0], foot)
    if not unit > 0.0:
        return 0
    conic, regular = degenerate_conic(f, g)
    real, line1, line2 = split(conic)
    if not real:
        return 0
    model = _frame(e23, height)
    scale = math.sqrt(long2)
    count = 0
    for i in range(2):
        n, z1, z2 = line_conic(line1 if i == 0 else line2, regular)
        for k in range(n):
            z = z1 if k == 0 else z2
            found, u, v, w = _scale(shape[0] * z[0], z[1], z[2] * unit, dot(sight[3], sight[3]))
            if found:
                found, u, v, w = _polish(u, v, w, sight, shape)
            if found and count < 4:
                e, _, d = _edges(u, v, w, sight, foot)
                _write_rotation(_frame(e, d), model, rotation_out[count])
                d1, d2, d3 = scale * (w + u), scale * (w + v), scale * w
                _write_translation(rays, xyz, k1, k2, k3, d1, d2, d3, rotation_out[count], translation_out[count])
                count += 1
    return count


@nb.njit(cache=True, nogil=True)
def _difference(p: Array, i: int, j: int) -> Vec3:
    return p[i, 0] - p[j, 0], p[i, 1] - p[j, 1], p[i, 2] - p[j, 2]


@nb.njit(cache=True, nogil=True)
def _order(p: Array) -> tuple[int, int, int]:
    """Corners k1, k2, k3 with k2 k3 the longest and k1 k3 the shortest edge."""
    a, b, c = _difference(p, 0, 1), _difference(p, 0, 2), _difference(p, 1, 2)
    d01, d02, d12 = dot(a, a), dot(b, b), dot(c, c)
    if d12 >= d01 and d12 >= d02:
        return (0, 2, 1) if d01 <= d02 else (0, 1, 2)
    if d02 >= d01:
        return (1, 2, 0) if d01 <= d12 else (1, 0, 2)
    return (2, 1, 0) if d02 <= d12 else (2, 0, 1)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _scale(u: float, v: float, w: float, q23: float) -> tuple[bool, float, float, float]:
    """Scale a solution (u : v : w) so that edge 23 is one, and say whether all depths are positive."""
    k = 1.0 / math.sqrt(v * v + q23 * w * (w + v))
    k = math.copysign(k, w)
    u, v, w = k * u, k * v, k * w
    return w > 0.0 and w + u > 0.0 and w + v > 0.0, u, v, w


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _polish(u: float, v: float, w: float, sight: Sight, shape: Vec3) -> tuple[bool, float, float, float]:
    """Newton steps while they help, and whether the result solves the equations."""
    r, rows = _system(u, v, w, sight, shape)
    worst = last = max(abs(r[0]), abs(r[1]), abs(r[2]))
    best = u, v, w
    misses = 0
    for _ in range(16):
        if worst < 1e-15:
            break
        du, dv, dw = _newton(rows, r)
        u, v, w = u - du, v - dv, w - dw
        r, rows = _system(u, v, w, sight, shape)
        new = max(abs(r[0]), abs(r[1]), abs(r[2]))
        if new < worst:
            best, worst = (u, v, w), new
        if not new < last:  # once is allowed: beside a double root the first step may go too far
            misses += 1
            if misses == 2 or worst < 1e-13 or not new < 1e3:
                break
        last = new
    tolerance = _RESIDUAL + _NOISE * (1.0 + best[2]) / shape[2]
    if tolerance <= worst < 1e-6:
        best, worst = _settle(best, worst, sight, shape)
    u, v, w = best
    return worst < tolerance and w > 0.0 and w + u > 0.0 and w + v > 0.0, u, v, w


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _settle(start: Vec3, worst: float, sight: Sight, shape: Vec3) -> tuple[Vec3, float]:
    """Damped steps for a double solution, whose direction along which the two meet Newton cannot tell."""
    best = start
    u, v, w = start
    for _ in range(4):
        r, rows = _system(u, v, w, sight, shape)
        new = max(abs(r[0]), abs(r[1]), abs(r[2]))
        if new < worst:
            best, worst = (u, v, w), new
        du, dv, dw = _damped(rows, r)
        u, v, w = u - du, v - dv, w - dw
    return best, worst


@nb.njit(cache=True, nogil=True)
def _system(u: float, v: float, w: float, sight: Sight, shape: Vec3) -> tuple[Vec3, Frame]:
    """Errors and rows of their Jacobian by (u, v, w).

    With E the edge 23, G the edge 13 and D = G - foot E in the camera frame the equations are
    E.E = 1, E.G = foot, D.D = h^2, each scaled to a relative error.
    """
    y1, y2, c13, c23 = sight
    short, foot, h = shape
    k2, k3 = 1.0 / short, 1.0 / (h * h)
    e, g, d = _edges(u, v, w, sight, foot)
    errors = 0.5 * (dot(e, e) - 1.0), k2 * (dot(e, g) - foot), 0.5 * (k3 * dot(d, d) - 1.0)
    c = axpy(-foot, c23, c13)
    rows = (
        (0.0, dot(e, y2), dot(e, c23)),
        (k2 * dot(e, y1), k2 * dot(g, y2), k2 * (dot(e, c13) + dot(g, c23))),
        (k3 * dot(d, y1), -k3 * foot * dot(d, y2), k3 * dot(d, c)),
    )
    return errors, rows


@nb.njit(cache=True, nogil=True)
def _edges(u: float, v: float, w: float, sight: Sight, foot: float) -> Frame:
    """Edges 23 and 13 and the height in the camera frame: depth differences times rays, no cancellation."""
    y1, y2, c13, c23 = sight
    e = (w * c23[0] + v * y2[0], w * c23[1] + v * y2[1], w * c23[2] + v * y2[2])
    g = (w * c13[0] + u * y1[0], w * c13[1] + u * y1[1], w * c13[2] + u * y1[2])
    return e, g, axpy(-foot, e, g)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _newton(rows: Frame, r: Vec3) -> Vec3:
    """Solution of ``rows @ step = r`` by Cramer's rule."""
    a, b, c = cross(rows[1], rows[2]), cross(rows[2], rows[0]), cross(rows[0], rows[1])
    k = 1.0 / dot(rows[0], a)
    return (
        k * (r[0] * a[0] + r[1] * b[0] + r[2] * c[0]),
        k * (r[0] * a[1] + r[1] * b[1] + r[2] * c[1]),
        k * (r[0] * a[2] + r[1] * b[2] + r[2] * c[2]),
    )


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _damped(rows: Frame, r: Vec3) -> Vec3:
    """Marquardt step: the normal equations with their diagonal raised a little."""
    a, b, c = rows
    n = (
        1.00000001 * (a[0] * a[0] + b[0] * b[0] + c[0] * c[0]),
        a[0] * a[1] + b[0] * b[1] + c[0] * c[1],
        a[0] * a[2] + b[0] * b[2] + c[0] * c[2],
        1.00000001 * (a[1] * a[1] + b[1] * b[1] + c[1] * c[1]),
        a[1] * a[2] + b[1] * b[2] + c[1] * c[2],
        1.00000001 * (a[2] * a[2] + b[2] * b[2] + c[2] * c[2]),
    )
    gradient = axpy(r[0], a, axpy(r[1], b, (r[2] * c[0], r[2] * c[1], r[2] * c[2])))
    m = adjugate(n)
    k = 1.0 / (n[0] * m[0] + n[1] * m[1] + n[2] * m[2])
    step = times(m, gradient)
    return k * step[0], k * step[1], k * step[2]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _frame(a: Vec3, b: Vec3) -> Frame:
    """Orthonormal frame along a and the (almost perpendicular) b; made perpendicular once more after scaling."""
    ka, kb = 1.0 / math.sqrt(dot(a, a)), 1.0 / math.sqrt(dot(b, b))
    a = (ka * a[0], ka * a[1], ka * a[2])
    b = (kb * b[0], kb * b[1], kb * b[2])
    b = axpy(-dot(a, b), a, b)
    kb = 1.0 / math.sqrt(dot(b, b))
    b = (kb * b[0], kb * b[1], kb * b[2])
    return a, b, cross(a, b)


@nb.njit(cache=True, nogil=True)
def _write_rotation(c: Frame, m: Frame, out: Array) -> None:
    for i in range(3):
        for j in range(3):
            out[i, j] = c[0][i] * m[0][j] + c[1][i] * m[1][j] + c[2][i] * m[2][j]


@nb.njit(cache=True, nogil=True)
def _write_translation(
    y: Array, x: Array, k1: int, k2: int, k3: int, d1: float, d2: float, d3: float, r: Array, out: Array
) -> None:
    """From the centroids, which spreads the rounding."""
    for i in range(3):
        total = d1 * y[k1, i] + d2 * y[k2, i] + d3 * y[k3, i]
        for j in range(3):
            total -= r[i, j] * (x[0, j] + x[1, j] + x[2, j])
        out[i] = total / 3.0


@nb.njit(cache=True, nogil=True)
def p3p_batch_kernel(
    rays: Array, xyz: Array, rotation_out: Array, translation_out: Array, count: NDArray[np.int64]
) -> None:
    """`p3p_kernel` for (B, 3, 3) problems; outputs (B, 4, 3, 3), (B, 4, 3), NaN where unused, and (B)."""
    for i in range(rays.shape[0]):
        n = p3p_kernel(rays[i], xyz[i], rotation_out[i], translation_out[i])
        rotation_out[i, n:] = math.nan
        translation_out[i, n:] = math.nan
        count[i] = n
