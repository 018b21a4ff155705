"""The inverse of the lens: distorted -> ideal normalised points, to rounding."""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.lens import BROWN, FISHEYE, RATIONAL, Lens, by_angle, distort, distort_both, radial, range2

Array = NDArray[np.float64]

_MAX_STEPS = 60


def undistort(q: Array, lens: Lens) -> Array:
    """Distorted -> ideal normalised points (..., 2); NaN where there is none."""
    if lens.none:
        return q.copy()
    if lens.kind == FISHEYE:
        angle = fisheye_angles(q, lens)
        size = np.linalg.norm(q, axis=-1)
        scale = np.where(size > 0, np.tan(angle) / np.where(size > 0, size, 1.0), 1.0)
        return np.where((angle < pi / 2)[..., None], q * scale[..., None], np.nan)
    shape = q.shape
    q = q.reshape(-1, 2)
    target = np.hypot(q[:, 0], q[:, 1])
    r = _inverse(target, lens)
    p = q * np.where(target > 0, r / np.where(target > 0, target, 1.0), 1.0)[:, None]
    if not (lens.p1 or lens.p2):
        return p.reshape(shape)
    return _newton(p, q, lens).reshape(shape)


def fisheye_angles(q: Array, lens: Lens) -> Array:
    """Angle (...) from the axis of distorted points (..., 2) of a fisheye lens; NaN beyond its range."""
    target = np.linalg.norm(q, axis=-1)
    return _inverse(target.ravel(), lens).reshape(target.shape)


def _growth(r: Array, lens: Lens) -> tuple[Array, Array]:
    """Image radius of ideal radii (of a fisheye lens: of angles), and its derivative."""
    s = r * r
    if lens.kind == FISHEYE:
        q, grows = by_angle(s, lens)
        return r * q, grows
    if lens.kind == BROWN:
        k1, k2, k3 = lens.k1, lens.k2, lens.k3
        return r * (1 + s * (k1 + s * (k2 + s * k3))), 1 + s * (3 * k1 + s * (5 * k2 + s * 7 * k3))
    factor, slope2 = radial(s, lens)
    return r * factor, factor + slope2 * s


def _inverse(target: Array, lens: Lens) -> Array:
    """(N,) inverse of `_growth`: Newton kept inside a bracket, so it cannot leave the branch; NaN without one."""
    low, high = np.zeros_like(target), _upper_bound(target, lens)
    solvable = _growth(high, lens)[0] >= target
    r, last = np.minimum(target, high), np.full_like(target, np.inf)
    for _ in range(2 * _MAX_STEPS):
        reached, slope = _growth(r, lens)
        error = reached - target
        # Newton comes away from a pole by halves only: there the bracket is halved instead.
        slow = (np.abs(error) > 0.5 * last) & (np.abs(error) > 1e-9 * (target + 1e-3))
        last = np.abs(error)
        low, high = np.where(error < 0, r, low), np.where(error > 0, r, high)
        step = r - error / slope
        r_new = np.where((step > low) & (step < high) & ~slow, step, 0.5 * (low + high))
        r_new = np.where(error == 0, r, r_new)
        moved = np.where(solvable, np.abs(r_new - r) - 4e-16 * np.maximum(r_new, 1e-3), -1.0)
        done = np.nanmax(moved, initial=-1.0) <= 0
        r = r_new
        if done:
            break
    return np.where(solvable, r, np.nan)


def _upper_bound(target: Array, lens: Lens) -> Array:
    """Radii whose images reach the target, within a factor two, or the radius at which the lens folds."""
    fold = np.sqrt(range2(lens))
    if lens.kind == RATIONAL:
        fold *= 1 - 1e-12  # the model may end at a pole
    high = np.minimum(np.maximum(target, 1e-3), fold)
    for _ in range(_MAX_STEPS):
        short = (_growth(high, lens)[0] < target) & (high < fold)
        if not short.any():
            break
        high = np.where(short, np.minimum(2 * high, fold), high)
    # From far outside Newton would come down r^7 by only a seventh per step.
    for _ in range(4 * _MAX_STEPS):
        far = (target > 0) & (_growth(0.5 * high, lens)[0] >= target)
        if not far.any():
            break
        high = np.where(far, 0.5 * high, high)
    return high


def _newton(p: Array, q: Array, lens: Lens) -> Array:
    """Polish with the decentring terms; NaN where it does not reach the observed point."""
    # Points whose radial part alone has no inverse may still have one: start them on the last good radius.
    s_max = range2(lens)
    lost = np.isnan(p[:, 0]) & np.isfinite(q[:, 0])
    if lost.any():
        p = p.copy()
        p[lost] = q[lost] * (0.99 * np.sqrt(s_max) / np.hypot(q[lost, 0], q[lost, 1]))[:, None]
    reached, within, j = distort_both(p, lens)
    error = reached - q
    size, part = np.abs(error).max(axis=-1), np.ones(len(p))
    for _ in range(_MAX_STEPS):
        det = j[:, 0, 0] * j[:, 1, 1] - j[:, 0, 1] * j[:, 1, 0]
        step = np.stack(
            [
                (j[:, 1, 1] * error[:, 0] - j[:, 0, 1] * error[:, 1]) / det,
                (j[:, 0, 0] * error[:, 1] - j[:, 1, 0] * error[:, 0]) / det,
            ],
            axis=-1,
        )
        trial = p - part[:, None] * step
        reached, inside, by = distort_both(trial, lens)
        trial_size = np.abs(reached - q).max(axis=-1)
        # Shorter steps where a whole one leads away, or out of where the lens is one to one.
        better = ((inside | ~within) & (trial_size < size)) | (size < 1e-14)
        within = np.where(better, inside, within)
        part = np.where(better, 1.0, 0.25 * part)
        p, j = np.where(better[:, None], trial, p), np.where(better[:, None, None], by, j)
        error, size = np.where(better[:, None], reached - q, error), np.where(better, trial_size, size)
        if not (np.nan_to_num(np.abs(step)).max(initial=0.0) > 1e-15):
            break
    reached, one_to_one = distort(p, lens)
    good = one_to_one & (np.abs(reached - q).max(axis=-1) < 1e-11)
    return np.where(good[:, None], p, np.nan)
