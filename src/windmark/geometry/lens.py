"""The lens: Brown-Conrady distortion, rational or fisheye, on normalised image points (z = 1), and the sensor's tilt.

All three are radial about the axis, ``q = radial(s) p``, s = |p|^2; Brown's and the rational one add decentring:

========  =============================================================================================
brown     radial = 1 + k1 s + k2 s^2 + k3 s^3
rational  that divided by 1 + k4 s + k5 s^2 + k6 s^3 (OpenCV's with eight coefficients)
fisheye   radial = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8) / |p|, tan(theta) = |p|: OpenCV's
          (Kannala and Brandt 2006). It goes on beyond 90 degrees, where there is no p: `project` takes points
========  =============================================================================================

The kernels' copy is `_lens_kernels` and, for Brown's, `_kernels`.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LENSES = ("brown", "rational", "fisheye")
"""Names of the lens models; their numbers in packed cameras."""
BROWN, RATIONAL, FISHEYE = 0, 1, 2
_AXIS = 1e-14
"""Squared radius below which a fisheye lens is as on its axis."""


class Lens(NamedTuple):
    """Coefficients, and the number of the model in `LENSES`."""

    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0
    kind: int = BROWN

    @property
    def none(self) -> bool:
        """Whether the lens is a pinhole's."""
        return self.kind != FISHEYE and not any(self[:8])


def range2(lens: Lens) -> float:
    """Squared ideal radius (of a fisheye lens: squared angle) up to which the radial part grows; inf if always.

    Beyond it two directions share one image point, so the model is no lens any more.
    """
    if lens.kind == FISHEYE:
        # The derivative of theta (1 + k1 theta^2 + ...); behind, at 180 degrees, every lens ends.
        return min(_first_root(1.0, 3 * lens.k1, 5 * lens.k2, 7 * lens.k3, 9 * lens.k4), pi * pi)
    if lens.kind == BROWN:
        return max_radius2(lens.k1, lens.k2, lens.k3)
    above = np.array([lens.k3, lens.k2, lens.k1, 1.0])
    below = np.array([lens.k6, lens.k5, lens.k4, 1.0])
    # (r N / D)' = (M D - 2 s N D') / D^2 with M = N + 2 s N'; where D vanishes the model ends, too.
    grows = np.polysub(
        np.polymul(above * [7, 5, 3, 1], below), 2 * np.polymul([1.0, 0.0], np.polymul(above, np.polyder(below)))
    )
    return min(_first_root(*grows[::-1]), _first_root(*below[::-1]))


def _first_root(*ascending: float) -> float:
    """Smallest positive root of a polynomial in s that is 1 at 0, lowest power first; inf without one."""
    # In 1/s it is monic, so coefficients however small do no harm.
    roots = np.roots(np.array(ascending))
    real = roots.real[np.abs(roots.imag) <= 1e-9 * np.abs(roots)]
    largest = float(real.max(initial=0.0))
    return 1 / largest if largest > 1e-300 else float("inf")


def max_radius2(k1: float, k2: float, k3: float) -> float:
    """Squared ideal radius up to which ``r (1 + k1 r^2 + k2 r^4 + k3 r^6)`` grows; inf if always."""
    # The derivative 1 + 3 k1 s + 5 k2 s^2 + 7 k3 s^3 is a cubic in s = r^2; its smallest positive root ends the useful
    # range.
    if k3 != 0.0:
        return _first_root(1.0, 3 * k1, 5 * k2, 7 * k3)
    root = 2.25 * k1 * k1 - 5 * k2
    largest = -1.5 * k1 + sqrt(root) if root >= 0 else 0.0
    if k1 > 0 and root >= 0:
        # The same without the difference of nearly equal numbers.
        largest = -5 * k2 / (1.5 * k1 + sqrt(root))
    return 1 / largest if largest > 1e-300 else float("inf")


def radial(s: Array, lens: Lens) -> tuple[Array, Array]:
    """The radial factor at squared ideal radii, and ``slope2`` with d radial / d(x) = slope2 x."""
    k1, k2, k3 = lens.k1, lens.k2, lens.k3
    if lens.kind == FISHEYE:
        angle = np.arctan(np.sqrt(s))
        t = angle * angle
        q, grows = by_angle(t, lens)
        near = s < _AXIS
        r2 = np.where(near, 1.0, s)
        factor = np.where(near, 1.0, angle * q / np.sqrt(r2))
        return factor, np.where(near, 2 * (k1 - 1 / 3), (grows / (1 + r2) - factor) / r2)
    above = 1 + s * (k1 + s * (k2 + s * k3))
    slope = k1 + s * (2 * k2 + s * 3 * k3)
    if lens.kind == BROWN:
        return above, 2 * slope
    below = 1 + s * (lens.k4 + s * (lens.k5 + s * lens.k6))
    factor = above / below
    return factor, 2 * (slope - factor * (lens.k4 + s * (2 * lens.k5 + s * 3 * lens.k6))) / below


def by_angle(t: Array, lens: Lens) -> tuple[Array, Array]:
    """Of a fisheye lens at squared angles: image radius by angle, and the derivative of the image radius."""
    k1, k2, k3, k4 = lens.k1, lens.k2, lens.k3, lens.k4
    return (
        1 + t * (k1 + t * (k2 + t * (k3 + t * k4))),
        1 + t * (3 * k1 + t * (5 * k2 + t * (7 * k3 + t * 9 * k4))),
    )


def project(xyz: Array, lens: Lens) -> tuple[Array, Mask]:
    """Points (..., 3) of the camera's frame -> distorted (..., 2), and where they have one image (...).

    In front of the camera and where the model is one to one; of a fisheye lens by the angle alone, behind too.
    """
    if lens.kind == FISHEYE:
        q, valid, _ = _fisheye(xyz, lens)
        return q, valid
    q, valid = distort(xyz[..., :2] / xyz[..., 2:], lens)
    return q, valid & (xyz[..., 2] > 0)


def project_with_slopes(xyz: Array, lens: Lens) -> tuple[Array, Mask, Array]:
    """`project`, and the derivative of the distorted point by the point (..., 2, 3)."""
    if lens.kind == FISHEYE:
        return _fisheye(xyz, lens)
    depth = xyz[..., 2:]
    p = xyz[..., :2] / depth
    q, valid = distort(p, lens)
    by = np.empty((*q.shape, 3))
    by[..., :2] = distort_jacobian(p, lens) / depth[..., None]
    by[..., 2] = -(by[..., :2] * p[..., None, :]).sum(axis=-1)
    return q, valid & (depth[..., 0] > 0), by


def _fisheye(xyz: Array, lens: Lens) -> tuple[Array, Mask, Array]:
    """`project_with_slopes` of a fisheye lens, by the unit direction (u, v, w)."""
    # Divided by the largest first: no overflow, whatever the point.
    size = np.abs(xyz).max(axis=-1, keepdims=True)
    unit = xyz / size
    length = np.linalg.norm(unit, axis=-1, keepdims=True)
    unit, length = unit / length, length[..., 0] * size[..., 0]
    u, v, w = np.moveaxis(unit, -1, 0)
    s = u * u + v * v
    angle = np.arctan2(np.sqrt(s), w)
    q, grows = by_angle(angle * angle, lens)
    near = (s < _AXIS) & (w > 0)
    sine2 = np.where(near, 1.0, s)
    factor = np.where(near, 1.0, angle * q / np.sqrt(sine2))
    bend = np.where(near, 2 * lens.k1 - 2 / 3, (grows * w - factor) / sine2)
    out = np.stack([u * factor, v * factor], axis=-1)
    by = np.empty((*s.shape, 2, 3))
    by[..., 0, 0], by[..., 1, 1] = factor + bend * u * u, factor + bend * v * v
    by[..., 0, 1] = by[..., 1, 0] = bend * u * v
    by[..., 0, 2], by[..., 1, 2] = -u * grows, -v * grows
    valid = (angle * angle < range2(lens)) & (grows > 0) & np.isfinite(length)
    return out, valid, by / length[..., None, None]


def by_coefficients(xyz: Array, lens: Lens) -> Array:
    """Derivative of the distorted point by k1, k2, p1, p2, k3, k4, k5, k6: (..., 2, 8); 0 by those the model lacks."""
    out = np.zeros((*xyz.shape[:-1], 2, 8))
    if lens.kind == FISHEYE:
        across = np.hypot(xyz[..., 0], xyz[..., 1])
        angle = np.arctan2(across, xyz[..., 2])
        # On the axis the image does not move.
        along = xyz[..., :2] * (angle / np.where(across > 0, across, 1.0))[..., None]
        for column, power in zip((0, 1, 4, 5), (1, 2, 3, 4), strict=True):
            out[..., column] = along * (angle ** (2 * power))[..., None]
        return out
    p = xyz[..., :2] / xyz[..., 2:]
    x, y = p[..., 0], p[..., 1]
    s = x * x + y * y
    along = p
    if lens.kind == RATIONAL:
        below = 1 + s * (lens.k4 + s * (lens.k5 + s * lens.k6))
        along = p / below[..., None]
        less = -along * radial(s, lens)[0][..., None]
        for n in range(3):
            out[..., 5 + n] = less * (s ** (n + 1))[..., None]
    for column, power in zip((0, 1, 4), (1, 2, 3), strict=True):
        out[..., column] = along * (s**power)[..., None]
    out[..., 0, 2], out[..., 1, 2] = 2 * x * y, s + 2 * y * y
    out[..., 0, 3], out[..., 1, 3] = s + 2 * x * x, 2 * x * y
    return out


def distort(p: Array, lens: Lens) -> tuple[Array, Mask]:
    """Ideal -> distorted normalised points (..., 2), and where the map is one to one (...)."""
    q, valid, _ = distort_both(p, lens)
    return q, valid


def distort_both(p: Array, lens: Lens) -> tuple[Array, Mask, Array]:
    """`distort` and `distort_jacobian` at once."""
    x, y = p[..., 0], p[..., 1]
    s = x * x + y * y
    factor, slope2 = radial(s, lens)
    p1, p2 = lens.p1, lens.p2
    q = np.stack(
        [
            x * factor + 2 * p1 * x * y + p2 * (s + 2 * x * x),
            y * factor + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )
    xx = factor + slope2 * x * x + 2 * p1 * y + 6 * p2 * x
    yy = factor + slope2 * y * y + 6 * p1 * y + 2 * p2 * x
    xy = slope2 * x * y + 2 * p1 * x + 2 * p2 * y
    j = np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)
    at = s if lens.kind != FISHEYE else np.arctan(np.sqrt(s)) ** 2
    return q, (at < range2(lens)) & (xx * yy - xy * xy > 0), j


def distort_jacobian(p: Array, lens: Lens) -> Array:
    """Derivative of the distorted with respect to the ideal point, (..., 2) -> (..., 2, 2); symmetric."""
    return distort_both(p, lens)[2]


def tilt_homography(tilt_x: float, tilt_y: float) -> Array:
    """3x3 homography of a tilted sensor on distorted normalised points (OpenCV's tilted model)."""
    cx, sx, cy, sy = np.cos(tilt_x), np.sin(tilt_x), np.cos(tilt_y), np.sin(tilt_y)
    r = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]) @ np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    return np.array([[r[2, 2], 0, -r[0, 2]], [0, r[2, 2], -r[1, 2]], [0, 0, 1]]) @ r


def tilt_homography_derivatives(tilt_x: float, tilt_y: float) -> tuple[Array, Array]:
    """Derivatives of `tilt_homography` with respect to tilt_x and tilt_y."""
    cx, sx, cy, sy = np.cos(tilt_x), np.sin(tilt_x), np.cos(tilt_y), np.sin(tilt_y)
    ry = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    rx = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    d_ry = np.array([[-sy, 0, -cy], [0, 0, 0], [cy, 0, -sy]])
    d_rx = np.array([[0, 0, 0], [0, -sx, cx], [0, -cx, -sx]])

    def shift(r: Array, last: float) -> Array:
        return np.array([[r[2, 2], 0, -r[0, 2]], [0, r[2, 2], -r[1, 2]], [0, 0, last]])

    r = ry @ rx
    dx, dy = ry @ d_rx, d_ry @ rx
    return shift(dx, 0.0) @ r + shift(r, 1.0) @ dx, shift(dy, 0.0) @ r + shift(r, 1.0) @ dy
