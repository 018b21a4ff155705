"""A grid of cells by which markers are found, as a numba kernel; twin: tests/registration/test_layout.py."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

CELLS_PER_MARKER = 4
"""Cells at most for each marker."""


class Cells(NamedTuple):
    """Markers by the cell of a grid: those of cell c are ``member[first[c]:first[c + 1]]``."""

    first: Ints
    member: Ints
    low: Array  # (3,) the grid's corner
    per_unit: float  # cells per unit of length
    size: Ints  # (3,) cells along each axis


@nb.njit(cache=True, nogil=True, error_model="numpy")
def celled(xyz: Array) -> Cells:
    """Markers by cell: a scan along one axis would meet a whole column of a regular layout."""
    n = xyz.shape[0]
    low, high, size = np.empty(3), np.empty(3), np.empty(3, np.int32)
    for axis in range(3):
        low[axis], high[axis] = xyz[:, axis].min(), xyz[:, axis].max()
    side = max((high - low).max() / 256.0, 1e-12)
    while True:
        total = 1
        for axis in range(3):
            size[axis] = int((high[axis] - low[axis]) / side) + 1
            total *= size[axis]
        if total <= CELLS_PER_MARKER * n + 8:
            break
        side *= 1.25
    cell, first = np.empty(n, np.int32), np.zeros(total + 1, np.int32)
    for m in range(n):
        at = 0
        for axis in range(3):
            at = at * size[axis] + min(int((xyz[m, axis] - low[axis]) / side), size[axis] - 1)
        cell[m] = at
        first[at + 1] += 1
    for c in range(total):
        first[c + 1] += first[c]
    return Cells(first, np.argsort(cell, kind="mergesort").astype(np.int32), low, 1.0 / side, size)
