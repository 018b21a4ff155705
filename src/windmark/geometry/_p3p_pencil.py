"""The conics of the perspective-three-point problem and where they meet: private to windmark.

Corners are numbered so that 23 is the longest and 13 the shortest edge; lengths are in units of edge 23.
Unknown are the depth w of corner 3 and the differences u, v of the depths of corners 1 and 2 to it. With the
squared chords ``q_ij = |ray_i - ray_j|^2`` in place of the cosines of the rays, the distance equations read

    Q13 = u^2 + q13 w (w + u) = a13,   Q23 = v^2 + q23 w (w + v) = 1,   Q12 = (u - v)^2 + q12 (w + u)(w + v) = a12

and lose nothing when rays are nearly parallel (a long lens), where ``1 - cos`` would. Eliminating the scale
leaves two conics in (u : v : w). Their pencil holds a degenerate conic, a pair of lines, at a root of a cubic;
each line meets a conic in at most two points. This is the route of Persson & Nordberg (Lambda Twist, ECCV 2018)
and Ding et al. (Revisiting the P3P problem, CVPR 2023). What is done differently here, for triangles that are
nearly degenerate: the chord variables, scaled by the short edge; a chart of the pencil whose infinity is far
from every root; the *most isolated* root (the other two meet at double solutions, this one does so only where
three solutions meet); and double roots approached from both sides.
"""

from __future__ import annotations

import math

from windmark.geometry._jit import nb

Vec3 = tuple[float, float, float]
Sym3 = tuple[float, float, float, float, float, float]  # (11, 12, 13, 22, 23, 33)

_TANGENT = 1e-4  # a discriminant this far below zero may be a double root in rounding; the residual decides
_ROUNDING = 1e-15  # a discriminant below this is noise


@nb.njit(cache=True, nogil=True)
def dot(a: Vec3, b: Vec3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@nb.njit(cache=True, nogil=True)
def cross(a: Vec3, b: Vec3) -> Vec3:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@nb.njit(cache=True, nogil=True)
def axpy(x: float, a: Vec3, b: Vec3) -> Vec3:
    """X a + b."""
    return x * a[0] + b[0], x * a[1] + b[1], x * a[2] + b[2]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def conics(c13: Vec3, c23: Vec3, short: float, foot: float) -> tuple[Sym3, Sym3, float]:
    """``Q13 / a13 - Q23`` and ``(Q12 - a12 Q23) / short`` in (u / short, v, w / unit), and the unit.

    All entries are of order one however short the short edge is, and differences such as 1 - a12 are made
    from the vectors and not from rounded squares.
    """
    q13, q23 = dot(c13, c13), dot(c23, c23)
    c = dot(c13, c23)
    q12 = q13 + q23 - 2.0 * c
    ratio = q13 / (short * short)
    unit = 1.0 / math.sqrt(max(ratio, q23))
    da = 2.0 * foot / short - short  # (a23 - a12) / short
    mixed = ((q13 - 2.0 * c) / short + da * q23) * unit  # (q12 - a12 q23) / short
    f = (1.0, 0.0, 0.5 * ratio * short * unit, -1.0, -0.5 * q23 * unit, (ratio - q23) * unit * unit)
    g = (short, 0.5 * q12 - 1.0, 0.5 * q12 * unit, da, 0.5 * mixed, mixed * unit)
    return f, g, unit


@nb.njit(cache=True, nogil=True)
def adjugate(m: Sym3) -> Sym3:
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
def degenerate_conic(f: Sym3, g: Sym3) -> tuple[Sym3, Sym3]:
    """The best determined degenerate conic of the pencil, and a regular one to intersect its lines with."""
    adj_f, adj_g = adjugate(f), adjugate(g)
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
def split(e: Sym3) -> tuple[bool, Vec3, Vec3]:
    """The two lines l, m of a degenerate conic ``l m' + m l'``, and whether they are real."""
    adj = adjugate(e)
    # adj = -(l x m)(l x m)': the largest diagonal entry gives l x m without cancellation.
    low = min(adj[0], adj[3], adj[5])
    if not low < 0.0:
        # Both lines coincide (rank one) or are complex: only the former has real points.
        low = 0.0
    if low == 0.0:
        x, y, z = 0.0, 0.0, 0.0
        size = abs(e[0]) + abs(e[3]) + abs(e[5])
        if max(adj[0], adj[3], adj[5]) > 1e-7 * size * size:
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
def line_conic(line: Vec3, p: Sym3) -> tuple[int, Vec3, Vec3]:
    """Up to two points of a line on a conic; a discriminant lost in rounding counts as a double point."""
    l1, l2, l3 = line
    # Two points that span the line, made with its largest component.
    if abs(l1) >= abs(l2) and abs(l1) >= abs(l3):
        a, b = (-l2, l1, 0.0), (-l3, 0.0, l1)
    elif abs(l2) >= abs(l3):
        a, b = (l2, -l1, 0.0), (0.0, -l3, l2)
    else:
        a, b = (l3, 0.0, -l1), (0.0, l3, -l2)
    pa, pb = times(p, a), times(p, b)
    aa = a[0] * pa[0] + a[1] * pa[1] + a[2] * pa[2]
    ab = a[0] * pb[0] + a[1] * pb[1] + a[2] * pb[2]
    bb = b[0] * pb[0] + b[1] * pb[1] + b[2] * pb[2]
    d = ab * ab - aa * bb
    size = aa * aa + 2.0 * ab * ab + bb * bb
    if d < _ROUNDING * size:
        if d < -_TANGENT * size:
            return 0, a, b
        d = max(-d, _ROUNDING * size)  # two starts, on either side of the double point
    root = -(ab + math.copysign(math.sqrt(d), ab))
    # aa x^2 + 2 ab x y + bb y^2 = 0 for the point x a + y b: (root : aa) and (bb : root)
    return (
        2,
        (root * a[0] + aa * b[0], root * a[1] + aa * b[1], root * a[2] + aa * b[2]),
        (bb * a[0] + root * b[0], bb * a[1] + root * b[1], bb * a[2] + root * b[2]),
    )


@nb.njit(cache=True, nogil=True)
def times(m: Sym3, x: Vec3) -> Vec3:
    return (
        m[0] * x[0] + m[1] * x[1] + m[2] * x[2],
        m[1] * x[0] + m[3] * x[1] + m[4] * x[2],
        m[2] * x[0] + m[4] * x[1] + m[5] * x[2],
    )
