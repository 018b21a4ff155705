"""The raster of the search plane and the lens' derivative at spots, as numba kernels.

Private to the registration room; see `_plane`. Readable twin: tests/registration/test_kernels.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point, to_camera
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
    _mask(raster, camera, size, low, cell, radius)
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


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _mask(raster: Ints, camera: Array, size: Array, low: Array, cell: float, radius: float) -> None:
    """EMPTY for the coarse cells where a spot is wholly in the image (all four corners)."""
    rows, columns = raster.shape
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


@nb.njit(cache=True, nogil=True, error_model="numpy")
def project_kernel(camera: Array, rotation: Array, translation: Array, xyz: Array) -> Array:
    """(K, 2) pixels of points (K, 3) of the model, NaN where they have no image."""
    out = np.full((xyz.shape[0], 2), np.nan)
    for k in range(xyz.shape[0]):
        x, y, z = to_camera(rotation, translation, xyz[k, 0], xyz[k, 1], xyz[k, 2])
        px, py, valid = project_point(camera, x, y, z)
        if valid:
            out[k, 0], out[k, 1] = px, py
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def plane_covariance_kernel(camera: Array, p: Array, cov: Array) -> Array:
    """(M, 3) xx, xy, yy of covariances (M, 2, 2) of image points, brought to the plane points (M, 2)."""
    out, f, h = np.empty((p.shape[0], 3)), camera[0], 0.5 / camera[0]
    for j in range(p.shape[0]):
        u, v = p[j, 0] / f, p[j, 1] / f
        x1, y1, _ = project_point(camera, u + h, v, 1.0)
        x0, y0, _ = project_point(camera, u - h, v, 1.0)
        x3, y3, _ = project_point(camera, u, v + h, 1.0)
        x2, y2, _ = project_point(camera, u, v - h, 1.0)
        a, b, c, d = x1 - x0, x3 - x2, y1 - y0, y3 - y2
        k = 1.0 / (a * d - b * c)
        a, b, c, d = k * d, -k * b, -k * c, k * a
        if not math.isfinite(k):
            # At the last point that the lens model can invert; spots are not blown up there.
            a, b, c, d = 1.0, 0.0, 0.0, 1.0
        xx, xy, yy = cov[j, 0, 0], cov[j, 0, 1], cov[j, 1, 1]
        out[j, 0] = a * a * xx + 2.0 * a * b * xy + b * b * yy
        out[j, 1] = a * c * xx + (a * d + b * c) * xy + b * d * yy
        out[j, 2] = c * c * xx + 2.0 * c * d * xy + d * d * yy
    return out
