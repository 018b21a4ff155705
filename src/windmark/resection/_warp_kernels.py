"""Numba kernel that recomputes a picture through a smooth map, its places interpolated between nodes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.resection._sampling import _catmull_rom, _four, _sixteen, _split, _within

Array = NDArray[np.float64]
Image = NDArray[np.float32]


@nb.njit(cache=True, nogil=True)
def warp_rows(image: Image, nodes: Array, step: int, first_row: int, out: Image) -> None:
    """Rows of the recomputed picture: out[r, c] is the image's value where pixel (c, first_row + r) comes from.

    image (H, W, 1); nodes (J, I, 2) places at rows (j - 1) * step and columns (i - 1) * step, so that there is a node
    before the first pixel and two after the last; out (R, width). Places are cubic (Catmull-Rom) between the nodes,
    values as in `sample_cubic`. A place next to a node that is NaN is NaN.
    """
    height, width = image.shape[0], image.shape[1]
    across = nodes.shape[1]
    line = np.empty((across, 2))
    for r in range(out.shape[0]):
        y = first_row + r
        j = y // step
        wy = _catmull_rom((y - j * step) / step)
        for i in range(across):
            for k in range(2):
                line[i, k] = (
                    wy[0] * nodes[j, i, k] + wy[1] * nodes[j + 1, i, k]
                    + wy[2] * nodes[j + 2, i, k] + wy[3] * nodes[j + 3, i, k]
                )  # fmt: skip
        for i in range((out.shape[1] + step - 1) // step):
            # Cubic through the cell: p(t) = a + t (b + t (c + t d)), t from 0 to 1.
            ax, ay = line[i + 1, 0], line[i + 1, 1]
            bx, by = 0.5 * (line[i + 2, 0] - line[i, 0]), 0.5 * (line[i + 2, 1] - line[i, 1])
            cx = line[i, 0] - 2.5 * ax + 2.0 * line[i + 2, 0] - 0.5 * line[i + 3, 0]
            cy = line[i, 1] - 2.5 * ay + 2.0 * line[i + 2, 1] - 0.5 * line[i + 3, 1]
            dx = 1.5 * (ax - line[i + 2, 0]) + 0.5 * (line[i + 3, 0] - line[i, 0])
            dy = 1.5 * (ay - line[i + 2, 1]) + 0.5 * (line[i + 3, 1] - line[i, 1])
            for n in range(i * step, min((i + 1) * step, out.shape[1])):
                t = (n - i * step) / step
                px, py = ax + t * (bx + t * (cx + t * dx)), ay + t * (by + t * (cy + t * dy))
                value = math.nan
                if px >= 1.0 and py >= 1.0 and px < width - 2.0 and py < height - 2.0:
                    ix, iy = int(px), int(py)
                    value = _sixteen(image, ix, iy, 0, _catmull_rom(px - ix), _catmull_rom(py - iy))
                if math.isnan(value):
                    value = _careful(image, px, py, width, height)
                out[r, n] = value


@nb.njit(cache=True, nogil=True)
def _careful(image: Image, x: float, y: float, width: int, height: int) -> float:
    """The value next to the border, next to NaN pixels, or outside, as `sample_cubic` gives it."""
    if not _within(x, y, width, height):
        return math.nan
    i, fx = _split(x, width, False)
    j, fy = _split(y, height, False)
    value = math.nan
    if i >= 1 and j >= 1 and i + 2 < width and j + 2 < height:
        value = _sixteen(image, i, j, 0, _catmull_rom(fx), _catmull_rom(fy))
    if math.isnan(value):
        value = _four(image, i, j, 0, fx, fy)
    return value
