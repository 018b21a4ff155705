"""Nearest neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]


def nearest(points: Array, k: int) -> tuple[NDArray[np.int32], Array]:
    """(N, k) indices of the k nearest other points, nearest first, and their distances."""
    if k < 1:
        return np.zeros((len(points), 0), np.int32), np.zeros((len(points), 0))
    distance, index = cKDTree(points).query(points, k=k + 1)
    # The point itself comes first, but for coincident points; where it is missing, the farthest goes.
    other = index != np.arange(len(points))[:, None]
    other[other.all(axis=1), -1] = False
    shape = (len(points), k)
    return np.ascontiguousarray(index[other].reshape(shape), dtype=np.int32), distance[other].reshape(shape)
