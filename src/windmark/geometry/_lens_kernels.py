"""The wide lenses, as numba building blocks: numbers in, numbers out. Private to windmark.

The readable twin is `lens`; Brown's lens stands in the loops that are fast by it (`_kernels`, and the adjust room's).
"""

from __future__ import annotations

import math

from windmark.geometry._jit import nb
from windmark.geometry.lens import FISHEYE

Numbers = tuple[float, ...]

_AXIS = 1e-14


@nb.njit(cache=True, nogil=True, error_model="numpy")
def wide_radial(c: Numbers, kind: float, s: float) -> tuple[float, float]:
    """`lens.radial` of a rational or fisheye lens; ``c`` holds k1, k2, k3, k4, k5, k6."""
    if kind == FISHEYE:
        if s < _AXIS:
            return 1.0, 2.0 * (c[0] - 1.0 / 3.0)
        r = math.sqrt(s)
        angle = math.atan(r)
        t = angle * angle
        factor = angle * (1.0 + t * (c[0] + t * (c[1] + t * (c[2] + t * c[3])))) / r
        grows = 1.0 + t * (3.0 * c[0] + t * (5.0 * c[1] + t * (7.0 * c[2] + t * 9.0 * c[3])))
        return factor, (grows / (1.0 + s) - factor) / s
    below = 1.0 / (1.0 + s * (c[3] + s * (c[4] + s * c[5])))
    factor = (1.0 + s * (c[0] + s * (c[1] + s * c[2]))) * below
    by_s = c[0] + s * (2.0 * c[1] + s * 3.0 * c[2]) - factor * (c[3] + s * (2.0 * c[4] + s * 3.0 * c[5]))
    return factor, 2.0 * by_s * below


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fisheye_point(c: Numbers, limit: float, x: float, y: float, z: float) -> Numbers:
    """A point under a fisheye lens, in front of the camera or behind; ``limit`` is `lens.range2`.

    Returns
    -------
    u, v : first two of the unit direction
    image point (2); 1 where it has one, else 0
    xx, xy, yy, xz, yz : derivative of the image point by the point, times the distance
    distance
    along, t : a change of k_n moves the image point by (u, v) along t^n
    """
    length = math.sqrt(x * x + y * y + z * z)
    u, v, w = x / length, y / length, z / length
    s = u * u + v * v
    angle = math.atan2(math.sqrt(s), w)
    t = angle * angle
    q = 1.0 + t * (c[0] + t * (c[1] + t * (c[2] + t * c[3])))
    grows = 1.0 + t * (3.0 * c[0] + t * (5.0 * c[1] + t * (7.0 * c[2] + t * 9.0 * c[3])))
    along, bend = 1.0, 2.0 * c[0] - 2.0 / 3.0
    if s > _AXIS or w < 0.0:
        along = angle / math.sqrt(s)
        bend = (grows * w - along * q) / s
    factor = along * q
    seen = 1.0 if t < limit and grows > 0.0 and math.isfinite(length) else 0.0
    return (
        u, v, u * factor, v * factor, seen, factor + bend * u * u, bend * u * v, factor + bend * v * v,
        -u * grows, -v * grows, length, along, t,
    )  # fmt: skip
