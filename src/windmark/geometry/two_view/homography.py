"""The map between a plane and its picture: normalised DLT, refined on the transfer error; robust if asked for.

Source: Hartley and Zisserman, Multiple View Geometry (2nd ed.), algorithms 4.2, 4.3 and 4.6.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FLAT = 1e-7  # ratio of singular values: the points lie on a line, or three of four do


def transfer(h: Array, p: Array) -> Array:
    """Points (N, 2) through a homography; NaN where they go through infinity (the other side of the horizon)."""
    q = p @ h[:, :2].T + h[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(q[:, :2] / np.where(q[:, 2:] > 0, q[:, 2:], np.nan))


def fit_homography(source: Array, target: Array, steps: int = 5) -> Array | None:
    """Homography (3, 3) from N >= 4 pairs of points (N, 2), least squares in the target; None where undetermined.

    Scaled so that the third coordinate is positive, and 1 in the middle of the points.
    """
    if len(source) < 4:
        return None
    s, t = _normaliser(source), _normaliser(target)
    if s is None or t is None:
        return None
    p, q = transfer(s, source), transfer(t, target)
    one, zero = np.ones(len(p)), np.zeros((len(p), 3))
    row = np.column_stack([p, one])
    design = np.concatenate([
        np.hstack([row, zero, -q[:, :1] * row]), np.hstack([zero, row, -q[:, 1:] * row])
    ])  # fmt: skip
    values, vectors = np.linalg.eigh(design.T @ design)
    if not values[1] > _FLAT**2 * values[-1]:
        return None
    h = vectors[:, 0].reshape(3, 3)
    h = h / h[2, 2] if abs(h[2, 2]) > 1e-12 else h  # (0, 0) is the middle of the points
    for _ in range(steps):
        h = _step(h, row, q)
    out = np.linalg.inv(t) @ h @ s
    depth = out[2] @ np.append(source.mean(axis=0), 1.0)
    return np.asarray(out / depth) if np.isfinite(out).all() and abs(depth) > 1e-12 else None


def robust_homography(
    source: Array, target: Array, gate: float, rng: np.random.Generator, trials: int = 200
) -> tuple[Array, Mask] | None:
    """Homography and the pairs within ``gate`` of it, by RANSAC on quadruples; None where none holds five pairs.

    Stops early once quadruples free of wrong pairs have been drawn with a probability of 1 - 1e-4.
    """
    n, best, within = len(source), 4, None
    trial = 0
    while trial < trials:
        trial += 1
        four = rng.choice(n, 4, replace=False) if n >= 4 else np.arange(n)
        h = fit_homography(source[four], target[four], steps=0)
        if h is None:
            continue
        near = _near(h, source, target, gate)
        if near.sum() > best:
            best, within = int(near.sum()), near
            trials = min(trials, int(np.ceil(np.log(1e-4) / np.log1p(-min((best / n) ** 4, 1 - 1e-9)))))
    if within is None:
        return None
    for _ in range(3):
        refined = fit_homography(source[within], target[within])
        if refined is None:
            return None
        within = _near(refined, source, target, gate)
        if within.sum() < 5:
            return None
    assert refined is not None
    return refined, within


def _near(h: Array, source: Array, target: Array, gate: float) -> Mask:
    with np.errstate(invalid="ignore"):
        return np.asarray(np.hypot(*(transfer(h, source) - target).T) < gate)


def _normaliser(p: Array) -> Array | None:
    middle = p.mean(axis=0)
    size = np.sqrt(((p - middle) ** 2).sum(axis=1).mean() / 2)
    if not (np.isfinite(size) and size > 0):
        return None
    return np.array([[1 / size, 0, -middle[0] / size], [0, 1 / size, -middle[1] / size], [0, 0, 1]])


def _step(h: Array, row: Array, target: Array) -> Array:
    """One Gauss-Newton step on the eight entries beside the last; the old values if it does not help."""
    q = row @ h.T
    depth = q[:, 2:]
    if not (np.abs(depth) > 1e-9).all():
        return h
    at = q[:, :2] / depth
    part, zero = row / depth, np.zeros_like(row)
    jacobian = np.concatenate([
        np.hstack([part, zero, -at[:, :1] * part]), np.hstack([zero, part, -at[:, 1:] * part])
    ])[:, :8]  # fmt: skip
    residual = (target - at).T.ravel()
    moved = h + np.append(np.linalg.lstsq(jacobian, residual, rcond=None)[0], 0.0).reshape(3, 3)
    new = row @ moved.T
    with np.errstate(divide="ignore", invalid="ignore"):
        error = ((new[:, :2] / new[:, 2:] - target) ** 2).sum()
    return moved if error < (residual**2).sum() else h
