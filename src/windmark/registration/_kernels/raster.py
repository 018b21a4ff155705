"""The raster of the search plane as a numba kernel.

Private to the registration room; see `search.plane`. Readable twin: tests/registration/test_kernels.py.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point
from windmark.registration._kernels.hypothesis import EMPTY, OUT

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

COARSE = 4
"""Raster cells along each side of a cell of the image mask."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def raster_kernel(
    camera: Array, size: Array, p: Array, low: Array, cell: float, columns: int, rows: int, reach: float, radius: float
) -> Ints:
    """(rows, columns) nearest spot of every cell within ``reach``, else EMPTY where a spot is whole and OUT elsewhere.

    Parameters
    ----------
    camera, size : packed camera and (width, height)
    p : (M, 2) spots in the plane
    radius : of a spot, in pixels
    low, cell : the raster's corner and the side of a cell
    """
    raster = np.full((rows, columns), OUT, np.int32)
    # EMPTY are the coarse cells where a spot is wholly in the image (all four corners).
    above, least = np.zeros(columns // COARSE + 2, np.bool_), radius - 0.5
    for i in range(rows // COARSE + 2):
        left_above, left = False, False
        for j in range(columns // COARSE + 2):
            u, v = (low[0] + j * COARSE * cell) / camera[0], (low[1] + i * COARSE * cell) / camera[0]
            x, y, valid = project_point(camera, u, v, 1.0)
            here = valid and least <= x <= size[0] - 1.0 - least and least <= y <= size[1] - 1.0 - least
            if here and left and above[j] and left_above and i > 0 and j > 0:
                raster[(i - 1) * COARSE : i * COARSE, (j - 1) * COARSE : j * COARSE] = EMPTY
            left_above, left, above[j] = above[j], here, here
    for j in range(p.shape[0]):
        u, v = (p[j, 0] - low[0]) / cell, (p[j, 1] - low[1]) / cell
        n = reach / cell
        for row in range(max(int(v - n), 0), min(int(v + n) + 1, rows)):
            for column in range(max(int(u - n), 0), min(int(u + n) + 1, columns)):
                x, y, k = low[0] + cell * (column + 0.5), low[1] + cell * (row + 0.5), raster[row, column]
                # The distance of the spot that is there is computed again: a second array would cost more.
                least2 = reach * reach if k < 0 else (p[k, 0] - x) ** 2 + (p[k, 1] - y) ** 2
                if (p[j, 0] - x) ** 2 + (p[j, 1] - y) ** 2 < least2:
                    raster[row, column] = j
    return raster
