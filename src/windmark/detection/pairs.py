"""Points that are near each other. A tree pays only where there are many."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

FEW = 300  # up to so many points all distances are faster


def close_pairs(xy: Array, distance: float) -> Ints:
    """Pairs (L, 2), i < j, of points (K, 2) that are no farther from each other than a distance."""
    if len(xy) > FEW:
        from scipy.spatial import cKDTree

        return np.asarray(cKDTree(xy).query_pairs(distance, output_type="ndarray"), dtype=np.int64)
    x, y = xy[:, 0], xy[:, 1]
    near = np.square(x[:, None] - x) + np.square(y[:, None] - y) <= distance * distance
    i, j = np.divmod(np.flatnonzero(near), len(xy))
    return np.array([i, j]).T[i < j]


def nearest(xy: Array) -> float:
    """Smallest distance between two of the points (K, 2); inf where there is only one."""
    if len(xy) < 2:
        return np.inf
    if len(xy) > FEW:
        from scipy.spatial import cKDTree

        return float(cKDTree(xy).query(xy, k=2)[0][:, 1].min())
    x, y = xy[:, 0], xy[:, 1]
    square = np.square(x[:, None] - x) + np.square(y[:, None] - y)
    np.fill_diagonal(square, np.inf)
    return float(np.sqrt(square.min()))
