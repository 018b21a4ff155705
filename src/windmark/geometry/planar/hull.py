"""The convex hull of marks: inside it a transformation interpolates, outside it extrapolates."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def hull_of(xy: ArrayLike) -> Array:
    """Corners (H, 2) of the convex hull of points (N, 2), in one direction round it; fewer than three where flat."""
    points = np.unique(np.asarray(xy, dtype=float).reshape(-1, 2), axis=0)
    if len(points) < 3:
        return points

    def half(ordered: Array) -> list[Array]:
        chain: list[Array] = []
        for p in ordered:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        return chain[:-1]

    return np.array(half(points) + half(points[::-1]))


def inside_hull(corners: Array, xy: ArrayLike, margin_px: float = 0.0) -> NDArray[np.bool_]:
    """Which places (..., 2) are inside a hull of `hull_of`, or at most ``margin_px`` outside its sides."""
    p = np.asarray(xy, dtype=float)
    if len(corners) < 3:
        return np.zeros(p.shape[:-1], dtype=bool)
    inside = np.ones(p.shape[:-1], dtype=bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        side = (b[0] - a[0]) * (p[..., 1] - a[1]) - (b[1] - a[1]) * (p[..., 0] - a[0])
        inside &= side >= -margin_px * np.hypot(*(b - a))
    return inside


def _turn(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
