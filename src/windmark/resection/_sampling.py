"""Numba kernels that interpolate images. float32 in, float32 out, weights in double precision."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Image = NDArray[np.float32]
Floats4 = tuple[float, float, float, float]


# A point this near to a pixel centre takes the pixel's value as it is: projecting a pixel's own
# surface point comes back to within rounding, and must not smear a neighbour's NaN.
_SNAP_PX = 1e-6


@nb.njit(cache=True, nogil=True)
def sample_linear(image: Image, xy: Array, skip: NDArray[np.uint8], nearest: bool, out: Image) -> None:
    """Values of an image (H, W, C) at points (N, 2), out (N, C): bilinear, or the nearest pixel's.

    NaN outside the image, where ``skip`` (N,) is not 0, and where a pixel that carries weight is NaN.
    """
    height, width = image.shape[0], image.shape[1]
    for n in range(xy.shape[0]):
        x, y = xy[n, 0], xy[n, 1]
        if skip[n] != 0 or not _within(x, y, width, height):
            out[n, :] = math.nan
            continue
        i, fx = _split(x, width, nearest)
        j, fy = _split(y, height, nearest)
        for c in range(image.shape[2]):
            out[n, c] = _four(image, i, j, c, fx, fy)


@nb.njit(cache=True, nogil=True)
def sample_cubic(image: Image, xy: Array, skip: NDArray[np.uint8], out: Image) -> None:
    """As `sample_linear` with Catmull-Rom weights (Keys, IEEE ASSP 29, 1981, a = -1/2).

    Bilinear where one of the sixteen pixels is missing or NaN.
    """
    height, width = image.shape[0], image.shape[1]
    for n in range(xy.shape[0]):
        x, y = xy[n, 0], xy[n, 1]
        if skip[n] != 0 or not _within(x, y, width, height):
            out[n, :] = math.nan
            continue
        i, fx = _split(x, width, False)
        j, fy = _split(y, height, False)
        wide = i >= 1 and j >= 1 and i + 2 < width and j + 2 < height
        wx, wy = _catmull_rom(fx), _catmull_rom(fy)
        for c in range(image.shape[2]):
            value = math.nan
            if wide:
                value = _sixteen(image, i, j, c, wx, wy)
            if math.isnan(value):
                value = _four(image, i, j, c, fx, fy)
            out[n, c] = value


@nb.njit(cache=True, nogil=True)
def _within(x: float, y: float, width: int, height: int) -> bool:
    return x >= -0.5 and y >= -0.5 and x <= width - 0.5 and y <= height - 0.5


@nb.njit(cache=True, nogil=True)
def _split(x: float, size: int, nearest: bool) -> tuple[int, float]:
    """Pixel at or to the left of x and the fraction beyond its centre, 0 at a centre.

    The half of a border pixel that lies outside the outermost centres has that pixel's value.
    """
    x = min(max(x, 0.0), size - 1.0)
    i = int(x)
    f = x - i
    if nearest:
        return (i + 1, 0.0) if f >= 0.5 else (i, 0.0)
    if f < _SNAP_PX:
        return i, 0.0
    if f > 1.0 - _SNAP_PX:
        return i + 1, 0.0
    return i, f


@nb.njit(cache=True, nogil=True)
def _four(image: Image, i: int, j: int, c: int, fx: float, fy: float) -> float:
    # Unsigned numbers spare the test for indices from the end. Without weight the pixel beyond is not
    # looked at: it may be NaN, or outside.
    i0, j0 = np.uint64(i), np.uint64(j)
    i1, j1 = np.uint64(i + (fx > 0.0)), np.uint64(j + (fy > 0.0))
    upper = (1.0 - fx) * image[j0, i0, c] + fx * image[j0, i1, c]
    lower = (1.0 - fx) * image[j1, i0, c] + fx * image[j1, i1, c]
    return (1.0 - fy) * upper + fy * lower


@nb.njit(cache=True, nogil=True)
def _catmull_rom(f: float) -> tuple[float, float, float, float]:
    g = 1.0 - f
    return -0.5 * f * g * g, 1.0 + f * f * (1.5 * f - 2.5), 1.0 + g * g * (1.5 * g - 2.5), -0.5 * g * f * f


@nb.njit(cache=True, nogil=True)
def _sixteen(image: Image, i: int, j: int, c: int, wx: Floats4, wy: Floats4) -> float:
    i0, i1, i2, i3 = np.uint64(i - 1), np.uint64(i), np.uint64(i + 1), np.uint64(i + 2)
    value = 0.0
    for b in range(4):
        row = np.uint64(j - 1 + b)
        line = wx[0] * image[row, i0, c] + wx[1] * image[row, i1, c]
        value += wy[b] * (line + wx[2] * image[row, i2, c] + wx[3] * image[row, i3, c])
    return value
