"""Nearest neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.registration._kernels.near import nearest_kernel

Array = NDArray[np.float64]

FEW = 300
"""So many points are compared with each other faster than a tree is built."""


def nearest(points: Array, k: int) -> tuple[NDArray[np.int32], Array]:
    """(N, k) indices of the k nearest other points, nearest first, and their distances."""
    if k < 1:
        return np.zeros((len(points), 0), np.int32), np.zeros((len(points), 0))
    if len(points) <= FEW:
        found: tuple[NDArray[np.int32], Array] = nearest_kernel(np.ascontiguousarray(points), k)
        return found
    distance, index = cKDTree(points).query(points, k=k + 1)
    # The point itself comes first, but for coincident points; where it is missing, the farthest goes.
    other = index != np.arange(len(points))[:, None]
    other[other.all(axis=1), -1] = False
    shape = (len(points), k)
    return np.ascontiguousarray(index[other].reshape(shape), dtype=np.int32), distance[other].reshape(shape)
