"""One mark: its image, and the whitened derivatives by everything that may be free. Private to the adjust room.

Numbers in, numbers out: they stay in registers, while handing on arrays costs atomic reference counts for every mark.
As `geometry.camera_jacobian.project_jacobian`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network._arrays import Scene
from windmark.geometry._jit import nb
from windmark.geometry._lens_kernels import fisheye_point, wide_radial
from windmark.geometry.lens import BROWN, FISHEYE

Array = NDArray[np.float64]
Numbers = tuple[float, ...]

FAST = {"contract", "arcp", "nsz"}
"""Fused multiply-add and the like; NaN and infinity keep their meaning."""


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def view_of(scene: Scene, i: int) -> tuple[Numbers, bool, Numbers, Numbers, Numbers, float]:
    """What a view's marks share, as numbers; the camera has its own principal point, its focal length is a factor."""
    c, a = scene.view_camera[i], scene.view_offset[i]
    frame = _numbers(scene.frame_r, scene.frame_t, scene.view_frame[i])
    offset = frame if a < 0 else _numbers(scene.offset_r, scene.offset_t, a)
    k, h, own = scene.camera, scene.tilt, scene.change
    camera = (
        k[c, 0], k[c, 1], k[c, 2] + own[i, 1], k[c, 3] + own[i, 2], k[c, 4], k[c, 5], k[c, 6], k[c, 7], k[c, 8],
        k[c, 9], k[c, 10], k[c, 11], k[c, 12], k[c, 13], k[c, 14], k[c, 15], k[c, 16],
    )  # fmt: skip
    sensor = (
        h[c, 0, 0, 0], h[c, 0, 0, 1], h[c, 0, 0, 2], h[c, 0, 1, 0], h[c, 0, 1, 1], h[c, 0, 1, 2],
        h[c, 0, 2, 0], h[c, 0, 2, 1], h[c, 0, 2, 2],
    )  # fmt: skip
    return frame, a >= 0, offset, camera, sensor, own[i, 0]


@nb.njit(cache=True, nogil=True)
def _numbers(r: Array, t: Array, n: int) -> Numbers:
    """Rotation by rows, then translation."""
    return (
        r[n, 0, 0], r[n, 0, 1], r[n, 0, 2], r[n, 1, 0], r[n, 1, 1], r[n, 1, 2], r[n, 2, 0], r[n, 2, 1], r[n, 2, 2],
        t[n, 0], t[n, 1], t[n, 2],
    )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def interior_rows(
    camera: Numbers, factor: float, seen: Numbers, white: Numbers, dc: Array
) -> tuple[float, float, float, float]:
    """Whitened derivatives by the interior parameters (tilts aside) into dc (2, 15); those by the distorted point.

    ``seen``: direction, how the coefficients move the point along it (both as `lens` has them), sensor point, and the
    sensor point's derivative by the distorted one.
    """
    u, v, along, t, sx, sy, taa, tab, tba, tbb = seen
    w0, w1, w2 = white
    fx = camera[0] * factor
    shear, a0, a1, b1 = camera[16], w0 * fx, w1 * fx, w2 * fx * camera[1]
    taa, tab = taa + shear * tba, tab + shear * tbb
    t00, t01, t10, t11 = a0 * taa, a0 * tab, a1 * taa + b1 * tba, a1 * tab + b1 * tbb
    s, uv = u * u + v * v, 2.0 * u * v
    across = sx + shear * sy
    dc[0, 0], dc[1, 0] = w0 * factor * across, (w1 * across + w2 * camera[1] * sy) * factor
    dc[0, 14], dc[1, 14] = a0 * sy, a1 * sy
    dc[0, 1], dc[1, 1] = 0.0, w2 * fx * sy
    dc[0, 2], dc[1, 2] = w0, w1
    dc[0, 3], dc[1, 3] = 0.0, w2
    g0, g1 = (t00 * u + t01 * v) * t, (t10 * u + t11 * v) * t
    if camera[15] != BROWN:
        g0, g1 = g0 * along, g1 * along
        _wide_rows(camera, g0, g1, t, dc)
    dc[0, 4], dc[1, 4] = g0, g1
    dc[0, 5], dc[1, 5] = g0 * t, g1 * t
    dc[0, 6], dc[1, 6] = t00 * uv + t01 * (s + 2.0 * v * v), t10 * uv + t11 * (s + 2.0 * v * v)
    dc[0, 7], dc[1, 7] = t00 * (s + 2.0 * u * u) + t01 * uv, t10 * (s + 2.0 * u * u) + t11 * uv
    dc[0, 8], dc[1, 8] = g0 * t * t, g1 * t * t
    return t00, t01, t10, t11


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _wide_rows(camera: Numbers, g0: float, g1: float, t: float, dc: Array) -> None:
    """The same by k4, k5, k6, from those by k1."""
    if camera[15] == FISHEYE:
        cube = t * t * t
        dc[0, 11], dc[1, 11] = g0 * cube, g1 * cube
        dc[0, 12], dc[1, 12], dc[0, 13], dc[1, 13] = 0.0, 0.0, 0.0, 0.0
        return
    less = -wide_radial(coefficients(camera), camera[15], t)[0]
    for n in range(11, 14):
        dc[0, n], dc[1, n] = less * g0, less * g1
        less *= t


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def pose_row(d: Numbers, x: Numbers, pivot: Numbers) -> Numbers:
    """Turn about the pivot and shift: d . (w x e) = w . (e x d)."""
    ex, ey, ez, scale = x[0] - pivot[0], x[1] - pivot[1], x[2] - pivot[2], pivot[3]
    return (
        ey * d[2] - ez * d[1], ez * d[0] - ex * d[2], ex * d[1] - ey * d[0],
        scale * d[0], scale * d[1], scale * d[2],
    )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def turned(r: Numbers, d: Numbers) -> Numbers:
    """Row vector times R."""
    x, y, z = d
    return (x * r[0] + y * r[3] + z * r[6], x * r[1] + y * r[4] + z * r[7], x * r[2] + y * r[5] + z * r[8])


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def moved(r: Numbers, x: float, y: float, z: float) -> Numbers:
    return (
        r[0] * x + r[1] * y + r[2] * z + r[9],
        r[3] * x + r[4] * y + r[5] * z + r[10],
        r[6] * x + r[7] * y + r[8] * z + r[11],
    )


@nb.njit(cache=True, nogil=True, inline="always")
def coefficients(c: Numbers) -> Numbers:
    """k1 to k6 of a packed camera."""
    return c[4], c[5], c[8], c[12], c[13], c[14]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def lens(c: Numbers, x: float, y: float, z: float) -> Numbers:
    """A point under the lens.

    Returns
    -------
    u, v, scale : ideal point, 1 / z; of a fisheye lens unit direction, 1 / distance
    distorted point (2)
    xx, xy, yy, xz, yz : derivative of the distorted point by the point, over the scale
    along, t : a change of k_n moves the distorted point by (u, v) along t^n
    1 where the point has an image, else 0
    """
    if c[15] == FISHEYE:
        u, v, ud, vd, seen, jxx, jxy, jyy, jxz, jyz, length, along, t = fisheye_point(coefficients(c), c[11], x, y, z)
        return u, v, 1.0 / length, ud, vd, jxx, jxy, jyy, jxz, jyz, along, t, seen
    iz = 1.0 / z
    u, v = x * iz, y * iz
    s = u * u + v * v
    k1, k2, p1, p2, k3 = c[4], c[5], c[6], c[7], c[8]
    along, radial = 1.0, 1.0 + s * (k1 + s * (k2 + s * k3))
    slope2 = 2.0 * (k1 + s * (2.0 * k2 + s * 3.0 * k3))
    if c[15] != BROWN:
        radial, slope2 = wide_radial(coefficients(c), c[15], s)
        along = 1.0 / (1.0 + s * (c[12] + s * (c[13] + s * c[14])))
    jxx = radial + slope2 * u * u + 2.0 * p1 * v + 6.0 * p2 * u
    jyy = radial + slope2 * v * v + 6.0 * p1 * v + 2.0 * p2 * u
    jxy = slope2 * u * v + 2.0 * p1 * u + 2.0 * p2 * v
    ud = u * radial + 2.0 * p1 * u * v + p2 * (s + 2.0 * u * u)
    vd = v * radial + p1 * (s + 2.0 * v * v) + 2.0 * p2 * u * v
    seen = 1.0 if z > 0.0 and s < c[11] and jxx * jyy - jxy * jxy > 0.0 else 0.0
    return u, v, iz, ud, vd, jxx, jxy, jyy, -(jxx * u + jxy * v), -(jxy * u + jyy * v), along, s, seen


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def tilted_sensor(h: Numbers, u: float, v: float) -> Numbers:
    """Point on the tilted sensor, its derivative by the distorted point, and the homography's third coordinate."""
    w = h[6] * u + h[7] * v + h[8]
    i = 1.0 / w
    a, b = (h[0] * u + h[1] * v + h[2]) * i, (h[3] * u + h[4] * v + h[5]) * i
    return a, b, (h[0] - a * h[6]) * i, (h[1] - a * h[7]) * i, (h[3] - b * h[6]) * i, (h[4] - b * h[7]) * i, w


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def tilt_rows(h: Array, c: int, camera: Numbers, factor: float, seen: Numbers, white: Numbers, dc: Array) -> None:
    """The same by the two tilts; ``seen``: sensor point, distorted point, third coordinate of the homography."""
    sx, sy, u, v, w = seen
    for m in range(1, 3):
        gw = h[c, m, 2, 0] * u + h[c, m, 2, 1] * v + h[c, m, 2, 2]
        ga = (h[c, m, 0, 0] * u + h[c, m, 0, 1] * v + h[c, m, 0, 2] - sx * gw) / w
        gb = (h[c, m, 1, 0] * u + h[c, m, 1, 1] * v + h[c, m, 1, 2] - sy * gw) / w
        ga, gb = camera[0] * factor * (ga + camera[16] * gb), camera[0] * factor * camera[1] * gb
        dc[0, 8 + m], dc[1, 8 + m] = white[0] * ga, white[1] * ga + white[2] * gb


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def put_rows(table: Array, start: int, k: int, row: Numbers, next_row: Numbers) -> None:
    """Six columns of two rows of the Jacobian; the table has them as rows."""
    for b in range(6):
        table[start + b, k], table[start + b, k + 1] = row[b], next_row[b]
