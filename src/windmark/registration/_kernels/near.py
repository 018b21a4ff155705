"""Nearest neighbours, of few points with a numba kernel. Twin: tests/registration/test_parts.py."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.geometry._jit import nb

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


@nb.njit(cache=True, nogil=True, error_model="numpy")
def nearest_kernel(points: Array, k: int) -> tuple[NDArray[np.int32], Array]:
    """(N, k) indices of the k < N nearest other points (N, d), nearest first, and their distances."""
    n = points.shape[0]
    index, distance = np.empty((n, k), np.int32), np.full((n, k), np.inf)
    for a in range(n):
        for b in range(n):
            if a == b:
                continue
            d = 0.0
            for axis in range(points.shape[1]):
                d += (points[a, axis] - points[b, axis]) ** 2
            if not d < distance[a, k - 1]:
                continue
            place = k - 1
            while place > 0 and d < distance[a, place - 1]:
                distance[a, place], index[a, place] = distance[a, place - 1], index[a, place - 1]
                place -= 1
            distance[a, place], index[a, place] = d, b
    return index, np.sqrt(distance)
