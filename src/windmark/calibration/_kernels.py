"""Numba kernel that redraws an image for another camera. float32 in, float32 out, weights in double precision."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point

Array = NDArray[np.float64]
Image = NDArray[np.float32]
Floats4 = tuple[float, float, float, float]
Ints4 = tuple[np.uint64, np.uint64, np.uint64, np.uint64]


@nb.njit(cache=True, nogil=True)
def redraw_rows(spline: Image, unknown: NDArray[np.uint8], camera: Array, rays: Array, out: Image) -> None:
    """Values of a cubic B-spline where ``camera`` (`Camera.packed`) sees the rays of some rows of pixels.

    ``spline`` (H, W, C) holds the coefficients, continued by mirroring at the outer pixel centres; ``rays``
    (rows, width, 2), NaN for none; ``out`` (rows, width, C). NaN where the camera does not see the ray, outside
    its image, and where one of the sixteen pixels is ``unknown`` (H, W; empty: none is).
    """
    height, width, channels = spline.shape
    for r in range(rays.shape[0]):
        for k in range(rays.shape[1]):
            x, y, seen = project_point(camera, rays[r, k, 0], rays[r, k, 1], 1.0)
            seen = seen and x >= -0.5 and y >= -0.5 and x <= width - 0.5 and y <= height - 0.5
            if not seen:
                out[r, k, :] = math.nan
                continue
            i, j = math.floor(x), math.floor(y)
            wx, wy = _weights(x - i), _weights(y - j)
            columns, rows = _four(i, width), _four(j, height)
            if unknown.size and _any_unknown(unknown, rows, columns):
                out[r, k, :] = math.nan
                continue
            for c in range(channels):
                value = 0.0
                for b in range(4):
                    line = wx[0] * spline[rows[b], columns[0], c] + wx[1] * spline[rows[b], columns[1], c]
                    line += wx[2] * spline[rows[b], columns[2], c] + wx[3] * spline[rows[b], columns[3], c]
                    value += wy[b] * line
                out[r, k, c] = value


@nb.njit(cache=True, nogil=True, inline="always")
def _weights(f: float) -> Floats4:
    """Values of the cubic B-spline at distances 1 + f, f, 1 - f, 2 - f."""
    g = 1.0 - f
    return (
        g * g * g / 6.0,
        (4.0 + f * f * (3.0 * f - 6.0)) / 6.0,
        (4.0 + g * g * (3.0 * g - 6.0)) / 6.0,
        f * f * f / 6.0,
    )


@nb.njit(cache=True, nogil=True, inline="always")
def _four(i: int, size: int) -> Ints4:
    """The pixels i - 1 to i + 2; unsigned, which spares the test for indices from the end."""
    if i >= 1 and i + 2 < size:
        return np.uint64(i - 1), np.uint64(i), np.uint64(i + 1), np.uint64(i + 2)
    return _mirrored(i - 1, size), _mirrored(i, size), _mirrored(i + 1, size), _mirrored(i + 2, size)


@nb.njit(cache=True, nogil=True)
def _mirrored(i: int, size: int) -> np.uint64:
    """The index within the image; an image of one pixel is that pixel everywhere."""
    last = size - 1
    if i < 0:
        i = -i
    if i > last:
        i = 2 * last - i
    return np.uint64(min(max(i, 0), last))


@nb.njit(cache=True, nogil=True)
def _any_unknown(unknown: NDArray[np.uint8], rows: Ints4, columns: Ints4) -> bool:
    for j in rows:
        for i in columns:
            if unknown[j, i]:
                return True
    return False
