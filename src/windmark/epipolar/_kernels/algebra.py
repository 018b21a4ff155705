"""Small steps of the growing of points; scalars and 3 x 3 arrays, no allocation."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]


@nb.njit(cache=True, nogil=True)
def pose_noise(cov: Array, u: float, v: float, depth: float, out: Array) -> None:
    """Covariance (xx, xy, yy) of the ideal image (u, v) of a point at a depth, from the pose's (6, 6)."""
    w = 1.0 / depth
    a = (-u * v, 1.0 + u * u, -v, w, 0.0, -u * w)
    b = (-1.0 - v * v, u * v, u, 0.0, w, -v * w)
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(6):
        p, q = 0.0, 0.0
        for k in range(6):
            p += cov[i, k] * a[k]
            q += cov[i, k] * b[k]
        xx += a[i] * p
        xy += a[i] * q
        yy += b[i] * q
    out[0], out[1], out[2] = xx, xy, yy


@nb.njit(cache=True, nogil=True)
def image_of(r: Array, t: Array, x: Array, j: Array) -> tuple[float, float, float]:
    """Ideal image (u, v) and depth of a model point, and its derivative ``j`` (2, 3); depth <= 0 is behind."""
    z = r[2, 0] * x[0] + r[2, 1] * x[1] + r[2, 2] * x[2] + t[2]
    if not z > 0.0:
        return 0.0, 0.0, -1.0
    u = (r[0, 0] * x[0] + r[0, 1] * x[1] + r[0, 2] * x[2] + t[0]) / z
    v = (r[1, 0] * x[0] + r[1, 1] * x[1] + r[1, 2] * x[2] + t[1]) / z
    for k in range(3):
        j[0, k] = (r[0, k] - u * r[2, k]) / z
        j[1, k] = (r[1, k] - v * r[2, k]) / z
    return u, v, z


@nb.njit(cache=True, nogil=True)
def spread(c: Array, j: Array, noise: Array, out: Array) -> float:
    """``out`` = J C J' + noise as (xx, xy, yy); its determinant."""
    xx, xy, yy = noise[0], noise[1], noise[2]
    for i in range(3):
        p, q = 0.0, 0.0
        for k in range(3):
            p += c[i, k] * j[0, k]
            q += c[i, k] * j[1, k]
        xx += j[0, i] * p
        xy += j[0, i] * q
        yy += j[1, i] * q
    out[0], out[1], out[2] = xx, xy, yy
    return xx * yy - xy * xy


@nb.njit(cache=True, nogil=True)
def distance2(p: Array, determinant: float, du: float, dv: float) -> float:
    """Squared Mahalanobis distance for the covariance (xx, xy, yy)."""
    return (p[2] * du * du - 2.0 * p[1] * du * dv + p[0] * dv * dv) / determinant


@nb.njit(cache=True, nogil=True)
def kalman_step(x: Array, c: Array, j: Array, p: Array, determinant: float, du: float, dv: float) -> None:
    """Take one observation, (du, dv) from its prediction, into the point and its covariance."""
    k = np.empty((3, 2))
    for i in range(3):
        a, b = 0.0, 0.0
        for n in range(3):
            a += c[i, n] * j[0, n]
            b += c[i, n] * j[1, n]
        k[i, 0] = (a * p[2] - b * p[1]) / determinant
        k[i, 1] = (b * p[0] - a * p[1]) / determinant
    row = np.empty((2, 3))
    for m in range(2):
        for n in range(3):
            row[m, n] = j[m, 0] * c[0, n] + j[m, 1] * c[1, n] + j[m, 2] * c[2, n]
    for i in range(3):
        x[i] += k[i, 0] * du + k[i, 1] * dv
        for n in range(3):
            c[i, n] -= k[i, 0] * row[0, n] + k[i, 1] * row[1, n]


@nb.njit(cache=True, nogil=True)
def inverse3(h: Array, out: Array) -> bool:
    """Inverse of a symmetric positive definite 3 x 3 matrix; False where it has none."""
    a = h[1, 1] * h[2, 2] - h[1, 2] * h[1, 2]
    b = h[0, 2] * h[1, 2] - h[0, 1] * h[2, 2]
    c = h[0, 1] * h[1, 2] - h[0, 2] * h[1, 1]
    determinant = h[0, 0] * a + h[0, 1] * b + h[0, 2] * c
    if not determinant > 1e-14 * h[0, 0] * h[1, 1] * h[2, 2]:
        return False
    out[0, 0], out[0, 1], out[0, 2] = a / determinant, b / determinant, c / determinant
    out[1, 1] = (h[0, 0] * h[2, 2] - h[0, 2] * h[0, 2]) / determinant
    out[1, 2] = (h[0, 1] * h[0, 2] - h[0, 0] * h[1, 2]) / determinant
    out[2, 2] = (h[0, 0] * h[1, 1] - h[0, 1] * h[0, 1]) / determinant
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]
    return True


@nb.njit(cache=True, nogil=True)
def between_rays(
    r1: Array, c1: Array, u1: float, v1: float, r2: Array, c2: Array, u2: float, v2: float, x: Array
) -> bool:
    """The point midway between two rays where they come closest; False where they are parallel."""
    d, e, w = np.empty(3), np.empty(3), np.empty(3)
    dd, de, ee, dw, ew = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        d[k] = r1[0, k] * u1 + r1[1, k] * v1 + r1[2, k]
        e[k] = r2[0, k] * u2 + r2[1, k] * v2 + r2[2, k]
        w[k] = c1[k] - c2[k]
        dd += d[k] * d[k]
        de += d[k] * e[k]
        ee += e[k] * e[k]
        dw += d[k] * w[k]
        ew += e[k] * w[k]
    across = dd * ee - de * de
    if not across > 1e-14 * dd * ee:
        return False
    s, t = (de * ew - ee * dw) / across, (dd * ew - de * dw) / across
    if not (math.isfinite(s) and math.isfinite(t)):
        return False
    for k in range(3):
        x[k] = 0.5 * (c1[k] + s * d[k] + c2[k] + t * e[k])
    return True
