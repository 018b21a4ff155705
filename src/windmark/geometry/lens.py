"""Lens distortion (Brown-Conrady) and sensor tilt on normalised image points (z = 1)."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_MAX_STEPS = 60


def max_radius2(k1: float, k2: float, k3: float) -> float:
    """Squared ideal radius up to which ``r (1 + k1 r^2 + k2 r^4 + k3 r^6)`` grows; inf if always.

    Beyond it two ideal points share one image point, so the model is no lens any more.
    """
    # The derivative 1 + 3 k1 s + 5 k2 s^2 + 7 k3 s^3 is a cubic in s = r^2; its smallest positive root ends the useful
    # range. In 1/s it is monic, so coefficients however small do no harm.
    if k3 == 0.0:
        root = 2.25 * k1 * k1 - 5 * k2
        largest = -1.5 * k1 + sqrt(root) if root >= 0 else 0.0
        if k1 > 0 and root >= 0:
            # The same without the difference of nearly equal numbers.
            largest = -5 * k2 / (1.5 * k1 + sqrt(root))
    else:
        roots = np.roots(np.array([1.0, 3 * k1, 5 * k2, 7 * k3]))
        real = roots.real[np.abs(roots.imag) <= 1e-9 * np.abs(roots)]
        largest = float(real.max(initial=0.0))
    return 1 / largest if largest > 1e-300 else float("inf")


def distort(p: Array, k1: float, k2: float, p1: float, p2: float, k3: float) -> tuple[Array, Mask]:
    """Ideal -> distorted normalised points (..., 2), and where the map is one to one (...)."""
    q, valid, _ = distort_both(p, k1, k2, p1, p2, k3)
    return q, valid


def distort_both(p: Array, k1: float, k2: float, p1: float, p2: float, k3: float) -> tuple[Array, Mask, Array]:
    """`distort` and `distort_jacobian` at once."""
    x, y = p[..., 0], p[..., 1]
    s = x * x + y * y
    radial = 1 + s * (k1 + s * (k2 + s * k3))
    q = np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x),
            y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )
    j = distort_jacobian(p, k1, k2, p1, p2, k3)
    det = j[..., 0, 0] * j[..., 1, 1] - j[..., 0, 1] * j[..., 1, 0]
    return q, (s < max_radius2(k1, k2, k3)) & (det > 0), j


def distort_jacobian(p: Array, k1: float, k2: float, p1: float, p2: float, k3: float) -> Array:
    """Derivative of the distorted with respect to the ideal point, (..., 2) -> (..., 2, 2); symmetric."""
    x, y = p[..., 0], p[..., 1]
    s = x * x + y * y
    radial = 1 + s * (k1 + s * (k2 + s * k3))
    slope2 = 2 * (k1 + s * (2 * k2 + s * 3 * k3))  # d radial / d(x) = slope2 * x
    xx = radial + slope2 * x * x + 2 * p1 * y + 6 * p2 * x
    yy = radial + slope2 * y * y + 6 * p1 * y + 2 * p2 * x
    xy = slope2 * x * y + 2 * p1 * x + 2 * p2 * y
    return np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)


def undistort(q: Array, k1: float, k2: float, p1: float, p2: float, k3: float) -> Array:
    """Distorted -> ideal normalised points (..., 2); NaN where the distortion has no inverse."""
    if not (k1 or k2 or p1 or p2 or k3):
        return q.copy()
    shape = q.shape
    q = q.reshape(-1, 2)
    p = _undistort_radial(q, k1, k2, k3)
    if not (p1 or p2):
        return p.reshape(shape)
    return _newton(p, q, k1, k2, p1, p2, k3).reshape(shape)


def _undistort_radial(q: Array, k1: float, k2: float, k3: float) -> Array:
    """Scalar inverse of the radial polynomial: Newton kept inside a bracket, so it cannot leave the branch."""
    target = np.hypot(q[:, 0], q[:, 1])
    low, high = np.zeros_like(target), _upper_bound(target, k1, k2, k3)
    solvable = _radial(high, k1, k2, k3) >= target
    r = np.minimum(target, high)
    for _ in range(_MAX_STEPS):
        s = r * r
        error = r * (1 + s * (k1 + s * (k2 + s * k3))) - target
        low, high = np.where(error < 0, r, low), np.where(error > 0, r, high)
        slope = 1 + s * (3 * k1 + s * (5 * k2 + s * 7 * k3))
        step = r - error / slope
        r_new = np.where((step > low) & (step < high), step, 0.5 * (low + high))
        r_new = np.where(error == 0, r, r_new)
        moved = np.where(solvable, np.abs(r_new - r) - 4e-16 * np.maximum(r_new, 1e-3), -1.0)
        done = np.nanmax(moved, initial=-1.0) <= 0
        r = r_new
        if done:
            break
    scale = np.where(target > 0, r / np.where(target > 0, target, 1.0), 1.0)
    return np.where(solvable[:, None], q * scale[:, None], np.nan)


def _radial(r: Array, k1: float, k2: float, k3: float) -> Array:
    s = r * r
    return r * (1 + s * (k1 + s * (k2 + s * k3)))


def _upper_bound(target: Array, k1: float, k2: float, k3: float) -> Array:
    """Radii whose images reach the target, within a factor two, or the radius at which the lens folds."""
    fold = np.sqrt(max_radius2(k1, k2, k3))
    high = np.minimum(np.maximum(target, 1e-3), fold)
    for _ in range(_MAX_STEPS):
        short = (_radial(high, k1, k2, k3) < target) & (high < fold)
        if not short.any():
            break
        high = np.where(short, np.minimum(2 * high, fold), high)
    # From far outside Newton would come down r^7 by only a seventh per step.
    for _ in range(4 * _MAX_STEPS):
        far = (target > 0) & (_radial(0.5 * high, k1, k2, k3) >= target)
        if not far.any():
            break
        high = np.where(far, 0.5 * high, high)
    return high


def _newton(p: Array, q: Array, k1: float, k2: float, p1: float, p2: float, k3: float) -> Array:
    """Polish with the decentring terms; NaN where it does not reach the observed point."""
    # Points whose radial part alone has no inverse may still have one: start them on the last good radius.
    s_max = max_radius2(k1, k2, k3)
    lost = np.isnan(p[:, 0]) & np.isfinite(q[:, 0])
    if lost.any():
        p = p.copy()
        p[lost] = q[lost] * (0.99 * np.sqrt(s_max) / np.hypot(q[lost, 0], q[lost, 1]))[:, None]
    for _ in range(_MAX_STEPS):
        error = distort(p, k1, k2, p1, p2, k3)[0] - q
        j = distort_jacobian(p, k1, k2, p1, p2, k3)
        det = j[:, 0, 0] * j[:, 1, 1] - j[:, 0, 1] * j[:, 1, 0]
        step = np.stack(
            [
                (j[:, 1, 1] * error[:, 0] - j[:, 0, 1] * error[:, 1]) / det,
                (j[:, 0, 0] * error[:, 1] - j[:, 1, 0] * error[:, 0]) / det,
            ],
            axis=-1,
        )
        p = p - step
        if not (np.nan_to_num(np.abs(step)).max(initial=0.0) > 1e-15):
            break
    reached, one_to_one = distort(p, k1, k2, p1, p2, k3)
    good = one_to_one & (np.abs(reached - q).max(axis=-1) < 1e-11)
    return np.where(good[:, None], p, np.nan)


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
