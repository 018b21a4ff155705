"""Rotation matrices: exponential, logarithm, Euler angles of the PoV.

Formulas are the stable ones: series near zero angle, quaternion extraction near pi.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

SMALL = 1e-4
"""Squared angle below which a Taylor series is more exact than the quotients."""


def hat(v: ArrayLike) -> Array:
    """Cross-product matrix: ``hat(a) @ b == cross(a, b)``. (..., 3) -> (..., 3, 3)."""
    v = np.asarray(v, dtype=float)
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def _sinc_terms(theta2: Array) -> tuple[Array, Array, Array]:
    """sin(t)/t, (1-cos t)/t^2, (t-sin t)/t^3 for t^2 >= 0; Taylor series where t is small."""
    small = theta2 < SMALL
    t2 = np.where(small, 1.0, theta2)
    t = np.sqrt(t2)
    half = np.sin(0.5 * t)
    a, b, c = _taylor(theta2)
    return (
        np.where(small, a, np.sin(t) / t), np.where(small, b, 2 * half * half / t2),
        np.where(small, c, (t - np.sin(t)) / (t2 * t)),
    )  # fmt: skip


def _sinc_terms_of_one(theta2: float) -> tuple[float, float, float]:
    """`_sinc_terms` of one number; NaN where it is not finite."""
    if theta2 < SMALL:
        return _taylor(theta2)
    t = math.sqrt(theta2) if theta2 < math.inf else math.nan
    half = math.sin(0.5 * t)
    return math.sin(t) / t, 2 * half * half / theta2, (t - math.sin(t)) / (theta2 * t)


def _taylor(theta2: Any) -> tuple[Any, Any, Any]:
    """`_sinc_terms` of one number or many, all small."""
    return (
        1 - theta2 / 6 * (1 - theta2 / 20 * (1 - theta2 / 42)),
        0.5 * (1 - theta2 / 12 * (1 - theta2 / 30 * (1 - theta2 / 56))),
        (1 - theta2 / 20 * (1 - theta2 / 42 * (1 - theta2 / 72))) / 6,
    )


def _series(w: Array, first: int) -> Array:
    """1 + a hat(w) + b hat(w)^2 with two neighbours of `_sinc_terms`. (..., 3) -> (..., 3, 3)."""
    if w.ndim == 1:  # a single one, as in tracking: plain floats take a tenth of the time
        x, y, z = w.tolist()
        p, q = _sinc_terms_of_one(x * x + y * y + z * z)[first : first + 2]
        return np.array([
            [1 - q * (y * y + z * z), q * x * y - p * z, q * x * z + p * y],
            [q * x * y + p * z, 1 - q * (x * x + z * z), q * y * z - p * x],
            [q * x * z - p * y, q * y * z + p * x, 1 - q * (x * x + y * y)],
        ])  # fmt: skip
    a, b = _sinc_terms(np.sum(w * w, axis=-1))[first : first + 2]
    k = hat(w)
    return np.eye(3) + a[..., None, None] * k + b[..., None, None] * (k @ k)


def exp_so3(rotvec: ArrayLike) -> Array:
    """Rotation matrix of a rotation vector in radians (Rodrigues). (..., 3) -> (..., 3, 3)."""
    return _series(np.asarray(rotvec, dtype=float), 0)


def left_jacobian(rotvec: ArrayLike) -> Array:
    """V of the SE(3) exponential: translation = V(rotvec) @ v. (..., 3) -> (..., 3, 3)."""
    return _series(np.asarray(rotvec, dtype=float), 1)


def quaternion(rotation: ArrayLike) -> Array:
    """Unit quaternion (w, x, y, z) with w >= 0 of a rotation matrix. (..., 3, 3) -> (..., 4).

    The largest of the four squared components is taken as pivot (Shepperd 1978), so no
    component is found by dividing by a small number.
    """
    r = np.asarray(rotation, dtype=float)
    if r.ndim == 2:
        return np.array(_quaternion_of_one(r))
    xx, yy, zz = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    squared4 = np.stack([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz], axis=-1)
    wx, wy, wz = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    xy, xz, yz = r[..., 0, 1] + r[..., 1, 0], r[..., 0, 2] + r[..., 2, 0], r[..., 1, 2] + r[..., 2, 1]
    # Row k: four times q_k times the whole quaternion.
    rows = np.stack(
        [
            np.stack([squared4[..., 0], wx, wy, wz], axis=-1),
            np.stack([wx, squared4[..., 1], xy, xz], axis=-1),
            np.stack([wy, xy, squared4[..., 2], yz], axis=-1),
            np.stack([wz, xz, yz, squared4[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    pivot = np.argmax(squared4, axis=-1)
    q = np.take_along_axis(rows, pivot[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., :1] < 0, -q, q)


def _quaternion_of_one(rotation: Array) -> tuple[float, float, float, float]:
    """`quaternion` of one matrix (3, 3), in plain floats."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    squared4 = (1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz)
    wx, wy, wz, vxy, vxz, vyz = zy - yz, xz - zx, yx - xy, xy + yx, xz + zx, yz + zy
    rows = (
        (squared4[0], wx, wy, wz), (wx, squared4[1], vxy, vxz), (wy, vxy, squared4[2], vyz), (wz, vxz, vyz, squared4[3])
    )  # fmt: skip
    w, x, y, z = rows[squared4.index(max(squared4))]
    size = math.sqrt(w * w + x * x + y * y + z * z) * (-1.0 if w < 0 else 1.0)
    return w / size, x / size, y / size, z / size


def log_so3(rotation: ArrayLike) -> Array:
    """Rotation vector (angle in [0, pi]) of a rotation matrix. (..., 3, 3) -> (..., 3)."""
    r = np.asarray(rotation, dtype=float)
    if r.ndim == 2:
        w, *v = _quaternion_of_one(r)
        length = math.hypot(*v)
        return np.array(v) * (2.0 if length < 1e-12 else 2 * math.atan2(length, w) / length)
    q = quaternion(r)
    n = np.linalg.norm(q[..., 1:], axis=-1)
    angle = 2 * np.arctan2(n, q[..., 0])
    tiny = n < 1e-12
    scale = np.where(tiny, 2.0, angle / np.where(tiny, 1.0, n))
    return scale[..., None] * q[..., 1:]


def project_to_so3(matrix: ArrayLike) -> Array:
    """The rotation nearest to a 3x3 matrix (Frobenius; Kabsch). (..., 3, 3) -> (..., 3, 3)."""
    u, _, vt = np.linalg.svd(np.asarray(matrix, dtype=float))
    d = np.sign(np.linalg.det(u @ vt))
    u = u.copy()
    u[..., :, 2] *= d[..., None]
    return u @ vt


def from_xyz_angles(rx: ArrayLike, ry: ArrayLike, rz: ArrayLike) -> Array:
    """Rz(rz) Ry(ry) Rx(rx), angles in radians, any broadcastable shapes -> (..., 3, 3)."""
    rx, ry, rz = np.broadcast_arrays(*(np.asarray(a, dtype=float) for a in (rx, ry, rz)))
    cx, sx, cy, sy, cz, sz = np.cos(rx), np.sin(rx), np.cos(ry), np.sin(ry), np.cos(rz), np.sin(rz)
    rows = [
        np.stack([cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx], axis=-1),
        np.stack([sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx], axis=-1),
        np.stack([-sy, cy * sx, cy * cx], axis=-1),
    ]
    return np.stack(rows, axis=-2)


def to_xyz_angles(rotation: ArrayLike) -> tuple[Array, Array, Array]:
    """Angles (rx, ry, rz) in radians with ``from_xyz_angles(*angles) == rotation``.

    ry in [-pi/2, pi/2]. Sines and cosines are combined from several matrix terms, as in
    AIAA 2005-5007 section III.B, so the reconstruction is exact at and near ry = +-90
    degrees too, where rx and rz are not separately defined: there rx = 0.
    """
    r = np.asarray(rotation, dtype=float)
    cos_ry = np.hypot(r[..., 2, 1], r[..., 2, 2])
    ry = np.arctan2(-r[..., 2, 0], cos_ry)
    locked = cos_ry < 1e-14
    rx = np.where(locked, 0.0, np.arctan2(r[..., 2, 1], r[..., 2, 2]))
    # Rx(-rx) applied on the right leaves Rz Ry, whose middle column is (-sin rz, cos rz, 0).
    c, s = np.cos(rx), np.sin(rx)
    rz = np.arctan2(s * r[..., 0, 2] - c * r[..., 0, 1], c * r[..., 1, 1] - s * r[..., 1, 2])
    return rx, ry, rz
