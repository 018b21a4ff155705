"""The perspective-three-point kernel: private to windmark, `p3p.py` has the verbs.

Unknown are the three depths along unit rays. Written with differences (base depth w, the other two
w + u and w + v) and with the squared chords ``q_ij = |ray_i - ray_j|^2`` in place of the cosines, the
distance equations read

    u^2 + q13 w (w + u) = a13,   v^2 + q23 w (w + v) = a23,   (u - v)^2 + q12 (w + u)(w + v) = a12

and lose nothing when the rays are nearly parallel (a long lens), where ``1 - cos`` would. Eliminating the
scale leaves two conics in (u : v : w). Their pencil holds a degenerate conic, a pair of lines, at a root of
a cubic; each line meets a conic in at most two points. This is the route of Persson & Nordberg (Lambda
Twist, ECCV 2018) and Ding et al. (Revisiting the P3P problem, CVPR 2023). What is done differently here:
the chord variables, a chart of the pencil whose infinity is far from every root, the *most isolated* root
(the other two meet at double solutions, this one never does unless three solutions meet), and double roots
approached from both sides.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from windmark.geometry.p3p import COLLINEAR

Array = NDArray[np.float64]
Vec3 = tuple[float, float, float]
Sym3 = tuple[float, float, float, float, float, float]  # (11, 12, 13, 22, 23, 33)

_TANGENT = 1e-6  # a discriminant this far below zero may be a double root in rounding; the residual decides
_RESIDUAL = 1e-12  # relative residual of the distance equations below which a solution is one


@nb.njit(cache=True, nogil=True, error_model="numpy")
def p3p_kernel(rays: Array, xyz: Array, rotation_out: Array, translation_out: Array) -> int:
    """All poses ``R xyz_i + t = depth_i ray_i``, depth_i > 0; returns their number (0 when degenerate).

    rays (3, 3) unit, xyz (3, 3), rows are points; rotation_out (4, 3, 3), translation_out (4, 3).
    """
    k1, k2, k3 = _order(xyz)
    a23 = _distance2(xyz, k2, k3)
    if not _area2(xyz) > (COLLINEAR * a23) ** 2:
        return 0
    a12 = _distance2(xyz, k1, k2) / a23
    a13 = _distance2(xyz, k1, k3) / a23
    q12 = _distance2(rays, k1, k2)
    q13 = _distance2(rays, k1, k3)
    q23 = _distance2(rays, k2, k3)
    s = math.sqrt(max(q12, q13, q23))
    # The two conics, with w scaled by the largest chord so that all entries are of one size.
    h12, h13, h23 = 0.5 * q12 / s, 0.5 * q13 / s, 0.5 * q23 / s
    i2 = 1.0 / (s * s)
    f = (1.0, 0.0, h13, -a13, -a13 * h23, (q13 - a13 * q23) * i2)
    g = (1.0, 0.5 * q12 - 1.0, h12, 1.0 - a12, h12 - a12 * h23, (q12 - a12 * q23) * i2)
    e, p = _degenerate_conic(f, g)
    real, line1, line2 = _split(e)
    if not real:
        return 0
    scale = math.sqrt(a23)
    count = 0
    for half in range(2):
        line = line1 if half == 0 else line2
        n, z1, z2 = _line_conic(line, p)
        for k in range(n):
            z = z1 if k == 0 else z2
            found, u, v, w = _depths(z, s, a12, a13, q12, q13, q23)
            if found and count < 4:
                _pose(
                    rays, xyz, k1, k2, k3, scale * u, scale * v, scale * w, rotation_out[count], translation_out[count]
                )
                count += 1
    return count


@nb.njit(cache=True, nogil=True)
def _distance2(p: Array, i: int, j: int) -> float:
    x, y, z = p[i, 0] - p[j, 0], p[i, 1] - p[j, 1], p[i, 2] - p[j, 2]
    return x * x + y * y + z * z


@nb.njit(cache=True, nogil=True)
def _cross(a: Vec3, b: Vec3) -> Vec3:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@nb.njit(cache=True, nogil=True)
def _area2(p: Array) -> float:
    """Squared area of the triangle."""
    n = _cross(
        (p[1, 0] - p[0, 0], p[1, 1] - p[0, 1], p[1, 2] - p[0, 2]),
        (p[2, 0] - p[0, 0], p[2, 1] - p[0, 1], p[2, 2] - p[0, 2]),
    )
    return 0.25 * (n[0] * n[0] + n[1] * n[1] + n[2] * n[2])


@nb.njit(cache=True, nogil=True)
def _order(p: Array) -> tuple[int, int, int]:
    """Corner opposite to the longest edge first: with another edge as common one the pencil can collapse."""
    d01, d02, d12 = _distance2(p, 0, 1), _distance2(p, 0, 2), _distance2(p, 1, 2)
    if d12 >= d01 and d12 >= d02:
        return 0, 1, 2
    if d02 >= d01:
        return 1, 2, 0
    return 2, 0, 1


@nb.njit(cache=True, nogil=True)
def _adjugate(m: Sym3) -> Sym3:
    return (
        m[3] * m[5] - m[4] * m[4],
        m[2] * m[4] - m[1] * m[5],
        m[1] * m[4] - m[2] * m[3],
        m[0] * m[5] - m[2] * m[2],
        m[1] * m[2] - m[0] * m[4],
        m[0] * m[3] - m[1] * m[1],
    )


@nb.njit(cache=True, nogil=True)
def _trace_product(a: Sym3, b: Sym3) -> float:
    return a[0] * b[0] + a[3] * b[3] + a[5] * b[5] + 2.0 * (a[1] * b[1] + a[2] * b[2] + a[4] * b[4])


@nb.njit(cache=True, nogil=True)
def _combine(x: float, a: Sym3, y: float, b: Sym3) -> Sym3:
    return (
        x * a[0] + y * b[0],
        x * a[1] + y * b[1],
        x * a[2] + y * b[2],
        x * a[3] + y * b[3],
        x * a[4] + y * b[4],
        x * a[5] + y * b[5],
    )


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _degenerate_conic(f: Sym3, g: Sym3) -> tuple[Sym3, Sym3]:
    """The best determined degenerate conic of the pencil, and a regular one to intersect its lines with."""
    adj_f, adj_g = _adjugate(f), _adjugate(g)
    c3, c2 = _trace_product(adj_f, f) / 3.0, _trace_product(adj_f, g)
    c1, c0 = _trace_product(adj_g, f), _trace_product(adj_g, g) / 3.0
    # Values of the binary cubic at f, g, f + g, f - g: the largest is farthest from the roots and becomes infinity.
    plus, minus = 0.35355339059327373 * (c3 + c2 + c1 + c0), 0.35355339059327373 * (c3 - c2 + c1 - c0)
    big = max(abs(c3), abs(c0), abs(plus), abs(minus))
    if abs(c3) == big:
        s = _isolated_root(c3, c2, c1, c0)
        return _combine(s, f, 1.0, g), f
    if abs(c0) == big:
        s = _isolated_root(c0, c1, c2, c3)
        return _combine(1.0, f, s, g), g
    # det((s + 1) f + (s - 1) g), or with the signs of g exchanged
    if abs(plus) == big:
        s = _isolated_root(c3 + c2 + c1 + c0, 3 * c3 + c2 - c1 - 3 * c0, 3 * c3 - c2 - c1 + 3 * c0, c3 - c2 + c1 - c0)
        return _combine(s + 1.0, f, s - 1.0, g), _combine(1.0, f, 1.0, g)
    s = _isolated_root(c3 - c2 + c1 - c0, 3 * c3 - c2 - c1 + 3 * c0, 3 * c3 + c2 - c1 - 3 * c0, c3 + c2 + c1 + c0)
    return _combine(s + 1.0, f, 1.0 - s, g), _combine(1.0, f, -1.0, g)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _isolated_root(c3: float, c2: float, c1: float, c0: float) -> float:
    """The real root farthest from the mean of the three roots: simple unless all three coincide."""
    b, c, d = c2 / c3, c1 / c3, c0 / c3
    shift = b / 3.0
    p = c - b * shift
    q = d - shift * (c - 2.0 * shift * shift)
    # Depressed t^3 + p t + q; with t > 0 for |q|: the largest root.
    sign = 1.0 if q < 0.0 else -1.0
    q = abs(q)
    t = 0.0
    if p < 0.0:
        m = 2.0 * math.sqrt(-p / 3.0)
        x = 4.0 * q / (m * m * m)  # t = m y, 4 y^3 - 3 y = x
        if x <= 1.0:
            t = m * (0.8660254037844386 + x * (0.1666666666666667 - 0.0326920704511053 * x))
    if t == 0.0:
        a = 0.5 * q + math.sqrt(max(0.25 * q * q + p * p * p / 27.0, 0.0))
        a = a**0.3333333333333333
        t = a - p / (3.0 * a) if a > 0.0 else 0.0
    for _ in range(2):
        slope = 3.0 * t * t + p
        if slope > 0.0:
            t -= (t * (t * t + p) - q) / slope
    s = sign * t - shift
    slope = c + s * (2.0 * b + 3.0 * s)
    if slope > 0.0:
        s -= (d + s * (c + s * (b + s))) / slope
    return s


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _split(e: Sym3) -> tuple[bool, Vec3, Vec3]:
    """The two lines l, m of a degenerate conic ``l m' + m l'``, and whether they are real."""
    adj = _adjugate(e)
    # adj = -(l x m)(l x m)': the largest diagonal entry gives l x m without cancellation.
    low = min(adj[0], adj[3], adj[5])
    if not low < 0.0:
        # Both lines coincide (rank one) or are complex: only the former has real points.
        low = 0.0
    if low == 0.0:
        x, y, z = 0.0, 0.0, 0.0
        size = abs(e[0]) + abs(e[3]) + abs(e[5])
        if max(adj[0], adj[3], adj[5]) > 1e-10 * size * size:
            return False, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    elif low == adj[0]:
        r = 1.0 / math.sqrt(-low)
        x, y, z = adj[0] * r, adj[1] * r, adj[2] * r
    elif low == adj[3]:
        r = 1.0 / math.sqrt(-low)
        x, y, z = adj[1] * r, adj[3] * r, adj[4] * r
    else:
        r = 1.0 / math.sqrt(-low)
        x, y, z = adj[2] * r, adj[4] * r, adj[5] * r
    # e + [l x m] has rank one: its rows are one line, its columns the other.
    r1, r2, r3 = (e[0], e[1] - z, e[2] + y), (e[1] + z, e[3], e[4] - x), (e[2] - y, e[4] + x, e[5])
    return True, _largest(r1, r2, r3), _largest((r1[0], r2[0], r3[0]), (r1[1], r2[1], r3[1]), (r1[2], r2[2], r3[2]))


@nb.njit(cache=True, nogil=True)
def _largest(a: Vec3, b: Vec3, c: Vec3) -> Vec3:
    na = a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
    nb_ = b[0] * b[0] + b[1] * b[1] + b[2] * b[2]
    nc = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
    if na >= nb_ and na >= nc:
        return a
    return b if nb_ >= nc else c


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _line_conic(line: Vec3, p: Sym3) -> tuple[int, Vec3, Vec3]:
    """Up to two points of a line on a conic; a discriminant lost in rounding counts as a double point."""
    l1, l2, l3 = line
    # Two points that span the line, made with its largest component.
    if abs(l1) >= abs(l2) and abs(l1) >= abs(l3):
        a, b = (-l2, l1, 0.0), (-l3, 0.0, l1)
    elif abs(l2) >= abs(l3):
        a, b = (l2, -l1, 0.0), (0.0, -l3, l2)
    else:
        a, b = (l3, 0.0, -l1), (0.0, l3, -l2)
    pa, pb = _times(p, a), _times(p, b)
    aa = a[0] * pa[0] + a[1] * pa[1] + a[2] * pa[2]
    ab = a[0] * pb[0] + a[1] * pb[1] + a[2] * pb[2]
    bb = b[0] * pb[0] + b[1] * pb[1] + b[2] * pb[2]
    d = ab * ab - aa * bb
    if d < 0.0:
        if d < -_TANGENT * (ab * ab + abs(aa * bb)):
            return 0, a, b
        d = -d  # two starts on either side of the double point
    root = -(ab + math.copysign(math.sqrt(d), ab))
    # aa x^2 + 2 ab x y + bb y^2 = 0 for the point x a + y b: (root : aa) and (bb : root)
    return (
        2,
        (root * a[0] + aa * b[0], root * a[1] + aa * b[1], root * a[2] + aa * b[2]),
        (bb * a[0] + root * b[0], bb * a[1] + root * b[1], bb * a[2] + root * b[2]),
    )


@nb.njit(cache=True, nogil=True)
def _times(m: Sym3, x: Vec3) -> Vec3:
    return (
        m[0] * x[0] + m[1] * x[1] + m[2] * x[2],
        m[1] * x[0] + m[3] * x[1] + m[4] * x[2],
        m[2] * x[0] + m[4] * x[1] + m[5] * x[2],
    )


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _depths(
    point: Vec3, s: float, a12: float, a13: float, q12: float, q13: float, q23: float
) -> tuple[bool, float, float, float]:
    """Scale a solution (u : v : w s), polish it with Newton steps, and say whether it is one in front."""
    u, v, w = point[0], point[1], point[2] / s
    k = 1.0 / math.sqrt(v * v + q23 * w * (w + v))
    if w < 0.0:
        k = -k
    u, v, w = k * u, k * v, k * w
    if not (w > 0.0 and w + u > 0.0 and w + v > 0.0):
        return False, u, v, w
    r1, r2, r3 = _residuals(u, v, w, a12, a13, q12, q13, q23)
    worst = max(abs(r1), abs(r2), abs(r3))
    for _ in range(6):
        # Jacobian rows of (r1, r2, r3) by (u, v, w)
        j11, j13 = 2.0 * u + q13 * w, q13 * (2.0 * w + u)
        j22, j23 = 2.0 * v + q23 * w, q23 * (2.0 * w + v)
        j31, j32 = 2.0 * (u - v) + q12 * (w + v), 2.0 * (v - u) + q12 * (w + u)
        j33 = q12 * (2.0 * w + u + v)
        c1, c2, c3 = -j22 * j31, -j11 * j32, j11 * j22
        inverse = 1.0 / (j13 * c1 + j23 * c2 + j33 * c3)
        dw = (c1 * r1 + c2 * r2 + c3 * r3) * inverse
        du = ((j22 * j33 - j23 * j32) * r1 + j13 * j32 * r2 - j13 * j22 * r3) * inverse
        dv = (j23 * j31 * r1 + (j11 * j33 - j13 * j31) * r2 - j11 * j23 * r3) * inverse
        n1, n2, n3 = _residuals(u - du, v - dv, w - dw, a12, a13, q12, q13, q23)
        new = max(abs(n1), abs(n2), abs(n3))
        if not new < worst:
            break
        u, v, w, r1, r2, r3 = u - du, v - dv, w - dw, n1, n2, n3
        done = worst < 1e-9  # the step just made squared this
        worst = new
        if done:
            break
    return worst < _RESIDUAL and w > 0.0 and w + u > 0.0 and w + v > 0.0, u, v, w


@nb.njit(cache=True, nogil=True)
def _residuals(u: float, v: float, w: float, a12: float, a13: float, q12: float, q13: float, q23: float) -> Vec3:
    """Errors of the squared edges 13, 23 and 12, in units of the longest edge squared."""
    return (
        u * u + q13 * w * (w + u) - a13,
        v * v + q23 * w * (w + v) - 1.0,
        (u - v) * (u - v) + q12 * (w + u) * (w + v) - a12,
    )


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _pose(y: Array, x: Array, k1: int, k2: int, k3: int, u: float, v: float, w: float, r: Array, t: Array) -> None:
    """Pose of the triangle with depths (w + u, w + v, w) at corners k1, k2, k3: an orthonormal frame on each side."""
    e, n, b = _frame(
        (x[k3, 0] - x[k2, 0], x[k3, 1] - x[k2, 1], x[k3, 2] - x[k2, 2]),
        (x[k1, 0] - x[k2, 0], x[k1, 1] - x[k2, 1], x[k1, 2] - x[k2, 2]),
    )
    # Edges in the camera frame as depth difference and ray difference: no cancellation of the depth.
    c, m, d = _frame(
        (
            w * (y[k3, 0] - y[k2, 0]) - v * y[k2, 0],
            w * (y[k3, 1] - y[k2, 1]) - v * y[k2, 1],
            w * (y[k3, 2] - y[k2, 2]) - v * y[k2, 2],
        ),
        (
            (w + u) * (y[k1, 0] - y[k2, 0]) + (u - v) * y[k2, 0],
            (w + u) * (y[k1, 1] - y[k2, 1]) + (u - v) * y[k2, 1],
            (w + u) * (y[k1, 2] - y[k2, 2]) + (u - v) * y[k2, 2],
        ),
    )
    for i in range(3):
        for j in range(3):
            r[i, j] = c[i] * e[j] + m[i] * n[j] + d[i] * b[j]
    for i in range(3):
        sum_ = (w + u) * y[k1, i] + (w + v) * y[k2, i] + w * y[k3, i]
        for j in range(3):
            sum_ -= r[i, j] * (x[0, j] + x[1, j] + x[2, j])
        t[i] = sum_ / 3.0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _frame(a: Vec3, b: Vec3) -> tuple[Vec3, Vec3, Vec3]:
    """Orthonormal frame: along a, normal of a and b, and the third (a x normal)."""
    n = _cross(a, b)
    ka = 1.0 / math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    kn = 1.0 / math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    e = (ka * a[0], ka * a[1], ka * a[2])
    m = (kn * n[0], kn * n[1], kn * n[2])
    return e, m, _cross(e, m)


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
