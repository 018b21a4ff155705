"""Numba building blocks shared by the kernels of several rooms: private to windmark.

Scalars in, scalars out, no allocation, so they inline into the callers' loops. The readable
twins are `Camera.project` and `Pose.apply`; `tests/geometry/test_kernels.py` holds them together.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._lens_kernels import fisheye_point, wide_radial
from windmark.geometry.lens import BROWN, FISHEYE

Array = NDArray[np.float64]


@nb.njit(cache=True, nogil=True, inline="always")
def to_camera(r: Array, t: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """R x + t for one point."""
    return (
        r[0, 0] * x + r[0, 1] * y + r[0, 2] * z + t[0],
        r[1, 0] * x + r[1, 1] * y + r[1, 2] * z + t[1],
        r[2, 0] * x + r[2, 1] * y + r[2, 2] * z + t[2],
    )


@nb.njit(cache=True, nogil=True)
def project_point(c: Array, x: float, y: float, z: float) -> tuple[float, float, bool]:
    """Project one camera-frame point with ``c = Camera.packed()``; (NaN, NaN, False) where not valid."""
    if c[15] == FISHEYE:
        _, _, ud, vd, valid, _, _, _, _, _, _, _, _ = fisheye_point(coefficients(c), c[11], x, y, z)
        if not valid > 0.0:
            return math.nan, math.nan, False
    else:
        if not z > 0.0:
            return math.nan, math.nan, False
        u = x / z
        v = y / z
        s = u * u + v * v
        if not s < c[11]:
            return math.nan, math.nan, False
        ud, vd, jxx, jxy, jyy = _lens(c, u, v, s)
        if not jxx * jyy - jxy * jxy > 0.0:
            return math.nan, math.nan, False
    if c[9] != 0.0 or c[10] != 0.0:
        ud, vd, seen = _tilt_point(c[9], c[10], ud, vd)
        if not seen:
            return math.nan, math.nan, False
    return c[0] * (ud + c[16] * vd) + c[2], c[0] * c[1] * vd + c[3], True


@nb.njit(cache=True, nogil=True, inline="always")
def coefficients(c: Array) -> tuple[float, float, float, float, float, float]:
    """k1 to k6 of a packed camera."""
    return c[4], c[5], c[8], c[12], c[13], c[14]


@nb.njit(cache=True, nogil=True)
def _lens(c: Array, u: float, v: float, s: float) -> tuple[float, float, float, float, float]:
    """Distorted point, and its derivative xx, xy, yy by the ideal one; ``s`` is the squared ideal radius."""
    k1, k2, p1, p2, k3 = c[4], c[5], c[6], c[7], c[8]
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    slope2 = 2.0 * (k1 + s * (2.0 * k2 + s * 3.0 * k3))
    if c[15] != BROWN:
        radial, slope2 = wide_radial(coefficients(c), c[15], s)
    xx = radial + slope2 * u * u + 2.0 * p1 * v + 6.0 * p2 * u
    yy = radial + slope2 * v * v + 6.0 * p1 * v + 2.0 * p2 * u
    xy = slope2 * u * v + 2.0 * p1 * u + 2.0 * p2 * v
    ud = u * radial + 2.0 * p1 * u * v + p2 * (s + 2.0 * u * u)
    vd = v * radial + p1 * (s + 2.0 * v * v) + 2.0 * p2 * u * v
    return ud, vd, xx, xy, yy


@nb.njit(cache=True, nogil=True)
def _tilt_point(tilt_x: float, tilt_y: float, u: float, v: float) -> tuple[float, float, bool]:
    """`lens.tilt_homography` on one point, written out; False beyond the horizon of the tilted sensor."""
    cx, sx, cy, sy = math.cos(tilt_x), math.sin(tilt_x), math.cos(tilt_y), math.sin(tilt_y)
    a = cy * u + sy * sx * v - sy * cx
    b = cx * v + sx
    w = sy * u - cy * sx * v + cy * cx
    r22, r02, r12 = cy * cx, -sy * cx, sx
    if not w > 0.0:
        return math.nan, math.nan, False
    return (r22 * a - r02 * w) / w, (r22 * b - r12 * w) / w, True


@nb.njit(cache=True, nogil=True)
def project_with_slopes(
    c: Array, x: float, y: float, z: float
) -> tuple[float, float, bool, float, float, float, float, float, float]:
    """`project_point`, and the derivatives of both pixel coordinates by x, y and z; 0 where not valid."""
    px, py, seen = project_point(c, x, y, z)
    if not seen:
        return px, py, False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if c[15] == FISHEYE:
        return _fisheye_slopes(c, px, py, x, y, z)
    u, v = x / z, y / z
    ud, vd, xx, xy, yy = _lens(c, u, v, u * u + v * v)
    yx = xy
    if c[9] != 0.0 or c[10] != 0.0:
        xx, xy, yx, yy = _tilted_slopes(c[9], c[10], ud, vd, xx, xy, yy)
    fx, fy = c[0] / z, c[0] * c[1] / z
    xx, xy, yx, yy = fx * (xx + c[16] * yx), fx * (xy + c[16] * yy), fy * yx, fy * yy
    return px, py, True, xx, xy, -(xx * u + xy * v), yx, yy, -(yx * u + yy * v)


@nb.njit(cache=True, nogil=True)
def _fisheye_slopes(
    c: Array, px: float, py: float, x: float, y: float, z: float
) -> tuple[float, float, bool, float, float, float, float, float, float]:
    """`project_with_slopes` of a fisheye lens that sees the point at (px, py)."""
    _, _, ud, vd, _, xx, xy, yy, xz, yz, length, _, _ = fisheye_point(coefficients(c), c[11], x, y, z)
    yx = xy
    if c[9] != 0.0 or c[10] != 0.0:
        aa, ab, ba, bb = _tilted_slopes(c[9], c[10], ud, vd, 1.0, 0.0, 1.0)
        xz, yz = aa * xz + ab * yz, ba * xz + bb * yz
        xx, xy, yx, yy = aa * xx + ab * xy, aa * xy + ab * yy, ba * xx + bb * xy, ba * xy + bb * yy
    fx, fy = c[0] / length, c[0] * c[1] / length
    xx, xy, xz = xx + c[16] * yx, xy + c[16] * yy, xz + c[16] * yz
    return px, py, True, fx * xx, fx * xy, fx * xz, fy * yx, fy * yy, fy * yz


@nb.njit(cache=True, nogil=True)
def _tilted_slopes(
    tilt_x: float, tilt_y: float, u: float, v: float, xx: float, xy: float, yy: float
) -> tuple[float, float, float, float]:
    """Derivative of `_tilt_point` times a symmetric matrix."""
    cx, sx, cy, sy = math.cos(tilt_x), math.sin(tilt_x), math.cos(tilt_y), math.sin(tilt_y)
    a = cy * u + sy * sx * v - sy * cx
    b = cx * v + sx
    w = sy * u - cy * sx * v + cy * cx
    f = cy * cx / (w * w)
    au, av = f * (cy * w - a * sy), f * (sy * sx * w + a * cy * sx)
    bu, bv = -f * b * sy, f * (cx * w + b * cy * sx)
    return au * xx + av * xy, au * xy + av * yy, bu * xx + bv * xy, bu * xy + bv * yy
