"""Numba kernels that interpolate images. float32 in, float32 out, weights in double precision."""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.float32]

# A point this near to a pixel centre takes the pixel's value as it is: projecting a pixel's own
# surface point comes back to within rounding, and must not smear a neighbour's NaN.
_SNAP_PX = 1e-6


@nb.njit(cache=True, nogil=True)
def sample(image: Image, xy: Array, method: int, out: Image) -> None:
    """Values of an image (H, W, C) at points (N, 2), out (N, C).

    ``method``: 0 nearest, 1 linear, 2 cubic (Catmull-Rom; Keys, IEEE ASSP 29, 1981, a = -1/2). All
    give the pixel's own value at its centre. NaN outside the image and where a pixel that carries
    weight is NaN; cubic falls back to linear where one of its outer pixels is missing or NaN.
    """
    height, width = image.shape[0], image.shape[1]
    wx, wy = np.empty(4), np.empty(4)
    for n in range(xy.shape[0]):
        x, y = xy[n, 0], xy[n, 1]
        if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
            out[n, :] = math.nan
            continue
        i, fx = _split(x, width, method)
        j, fy = _split(y, height, method)
        wide = method == 2 and _has_taps(i, fx, width) and _has_taps(j, fy, height)
        if wide:
            _catmull_rom(fx, wx)
            _catmull_rom(fy, wy)
        for c in range(image.shape[2]):
            value = math.nan
            if wide:
                value = _weighted(image, i, j, c, wx, wy)
            if math.isnan(value):
                value = _linear(image, i, j, c, fx, fy)
            out[n, c] = value


@nb.njit(cache=True, nogil=True)
def _split(x: float, size: int, method: int) -> tuple[int, float]:
    """Pixel to the left and fraction, 0 at a centre; the outer half of a border pixel counts as its centre."""
    x = min(max(x, 0.0), size - 1.0)
    nearest = math.floor(x + 0.5)
    if method == 0 or abs(x - nearest) < _SNAP_PX:
        return int(nearest), 0.0
    left = math.floor(x)
    return int(left), x - left


@nb.njit(cache=True, nogil=True)
def _has_taps(i: int, f: float, size: int) -> bool:
    return f == 0.0 or (i >= 1 and i + 2 < size)


@nb.njit(cache=True, nogil=True)
def _catmull_rom(f: float, w: Array) -> None:
    g = 1.0 - f
    w[0] = -0.5 * f * g * g
    w[1] = 1.0 + f * f * (1.5 * f - 2.5)
    w[2] = 1.0 + g * g * (1.5 * g - 2.5)
    w[3] = -0.5 * g * f * f


@nb.njit(cache=True, nogil=True)
def _weighted(image: Image, i: int, j: int, c: int, wx: Array, wy: Array) -> float:
    """Sum over 4 x 4 pixels; those without weight are not looked at (they may be NaN or outside)."""
    value = 0.0
    for b in range(4):
        if wy[b] != 0.0:
            for a in range(4):
                if wx[a] != 0.0:
                    value += wy[b] * wx[a] * image[j + b - 1, i + a - 1, c]
    return value


@nb.njit(cache=True, nogil=True)
def _linear(image: Image, i: int, j: int, c: int, fx: float, fy: float) -> float:
    value = (1.0 - fx) * (1.0 - fy) * image[j, i, c]
    if fx > 0.0:
        value += fx * (1.0 - fy) * image[j, i + 1, c]
    if fy > 0.0:
        value += (1.0 - fx) * fy * image[j + 1, i, c]
        if fx > 0.0:
            value += fx * fy * image[j + 1, i + 1, c]
    return value
