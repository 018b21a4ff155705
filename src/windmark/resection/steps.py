"""Steps in a picture, as the rims of markers: two pictures lay their pixels over them differently.

A pixel is a mean over its own part of the surface. Where the surface's values change evenly that is the value at its
centre. Beside a step it is not, and the pixels of a second picture, larger or more oblique, have other parts of both
sides. What a picture cannot tell there is in no sigma of its noise or pose.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.resection.sources import Prepared, pixel_variance
from windmark.resection.visibility import NodeView

Array = NDArray[np.float64]

BEYOND_NOISE = 4.0
"""A second difference of more than so many of its sigmas is a step."""


def step_variance(source: Prepared, view: NodeView) -> Array:
    """(V,) variance of the values at nodes beside a step; 0 elsewhere, and where a node has no place.

    The value is anywhere within half of the second difference of neighbouring pixels either way, the largest one
    within a pixel: that of a row or a column, less what noise makes of it.
    """
    from scipy.ndimage import maximum_filter

    pixels = np.asarray(source.pixels, dtype=float)
    bend = np.zeros(pixels.shape)
    bend[:, 1:-1] = np.abs(np.nan_to_num(np.diff(pixels, 2, axis=1)))
    bend[1:-1] = np.maximum(bend[1:-1], np.abs(np.nan_to_num(np.diff(pixels, 2, axis=0))))
    bend = maximum_filter(bend, size=3, mode="nearest")
    out, there = np.zeros(len(view.xy)), np.isfinite(view.xy).all(axis=1)
    column, row = np.rint(view.xy[there]).astype(int).T
    height, width = pixels.shape
    inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
    at = np.flatnonzero(there)[inside]
    here = row[inside], column[inside]
    noise = pixel_variance(source, np.nan_to_num(pixels[here]), view.xy[at])
    out[at] = np.maximum(bend[here] ** 2 - BEYOND_NOISE**2 * 6.0 * noise, 0.0) / 12  # 1 + 4 + 1 of pixels' variance
    return out
