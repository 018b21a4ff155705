"""Nearest neighbours, of few points with a numba kernel. Twin: tests/registration/test_parts.py."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.geometry._jit import nb
from windmark.geometry.errors import DegenerateGeometry

Array = NDArray[np.float64]

FEW = 300
"""So many points are compared with each other faster than a tree is built."""


def nearest(points: Array, k: int) -> tuple[NDArray[np.int32], Array]:
    """(N, k) indices of the k nearest other points, nearest first, and their distances.

    Raises
    ------
    DegenerateGeometry
        For distances that are no finite numbers: what is not nearer than that is no neighbour, and is not set.
    """
    if k < 1:
        return np.zeros((len(points), 0), np.int32), np.zeros((len(points), 0))
    if len(points) <= FEW:
        found: tuple[NDArray[np.int32], Array] = nearest_kernel(np.ascontiguousarray(points), k)
        if not np.isfinite(found[1]).all():
            raise DegenerateGeometry("markers: they are all at one place, or too far apart to be compared")
        return found
    distance, index = cKDTree(points).query(points, k=k + 1)
    # The point itself comes first, but for coincident points; where it is missing, the farthest goes.
    other = index != np.arange(len(points))[:, None]
    other[other.all(axis=1), -1] = False
    shape = (len(points), k)
    return np.ascontiguousarray(index[other].reshape(shape), dtype=np.int32), distance[other].reshape(shape)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def nearest_kernel(points: Array, k: int) -> tuple[NDArray[np.int32], Array]:
    """(N, k) indices of the k < N nearest other points (N, d), nearest first, and their distances.

    The points are looked at in order of their first coordinate, both ways from each until that alone is too far.
    """
    n = points.shape[0]
    index, distance = np.empty((n, k), np.int32), np.full((n, k), np.inf)
    order = np.argsort(points[:, 0], kind="mergesort")
    sorted_ = points[order]
    for at in range(n):
        a = order[at]
        mine, found = distance[a], index[a]
        for way in (-1, 1):
            other = at + way
            while 0 <= other < n:
                d = (sorted_[at, 0] - sorted_[other, 0]) ** 2
                if not d < mine[k - 1]:
                    break
                for axis in range(1, points.shape[1]):
                    d += (sorted_[at, axis] - sorted_[other, axis]) ** 2
                if d < mine[k - 1]:
                    place = k - 1
                    while place > 0 and d < mine[place - 1]:
                        mine[place], found[place] = mine[place - 1], found[place - 1]
                        place -= 1
                    mine[place], found[place] = d, order[other]
                other += way
    return index, np.sqrt(distance)


@nb.njit(cache=True, nogil=True)
def first_from(ascending: Array, value: float) -> int:
    """The first place in ascending numbers whose number is ``value`` or larger; their count where that is no number."""
    low, high = 0, ascending.shape[0]
    while low < high:
        middle = (low + high) // 2
        if ascending[middle] >= value:
            high = middle
        else:
            low = middle + 1
    return low
