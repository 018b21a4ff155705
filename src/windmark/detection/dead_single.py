"""Single pixels that do not measure and that only the noise of the picture tells: hot ones of ten noises and more."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.detection.sharpest import sharpest_line

Pixels = NDArray[np.float32]
Ints = NDArray[np.int64]

SURE = 10.0
"""Times the noise that a pixel is off what is around it: of white noise none of 10^20 is."""
LEAVES = 2.0
"""Times the range of its eight neighbours that it leaves this by at least; of noise alone that is 2.8 noises."""
SIGMAS, BLUR_OFF = 3.0, 1.05
"""By which the four pixels beside it have less light than the sharpest point that the optic has imaged has there;
factor by which the blur may be less than what edges tell.
"""
STEPS = 0.5
"""Of the grey levels that the noise is at least: less is what rounding or a compression has left of it."""


def dead_singles(
    g: Pixels, maybe: Ints, sigma: NDArray[np.floating], blur_px: float, step: float, ends: tuple[float, float]
) -> Ints:
    """(K, 2) pixels of g (H, W) that are off an even surrounding by `SURE` noises, while the four beside them are not.

    An optic of ``blur_px`` spreads a point of light so that these have at least `sharpest_line` of its pixel's light on
    average, wherever it lies: two opposite ones together have the least of it where it is in the middle.

    Parameters
    ----------
    maybe : (M, 2) row, column of pixels that leave their neighbours' range by `LEAVES` times it
    sigma : (M,) noise there
    step : between grey levels
    ends : of the picture's levels: pixels beside that are at these do not tell
    """
    rows, columns = g.shape
    inside = (maybe > 1).all(axis=1) & (maybe[:, 0] < rows - 2) & (maybe[:, 1] < columns - 2)
    told = inside & (sigma > STEPS * step)
    if not np.isfinite(blur_px) or not told.any():
        return np.empty((0, 2), np.int64)
    maybe, sigma = maybe[told], sigma[told].astype(float)
    window = np.lib.stride_tricks.sliding_window_view(g, (5, 5))[maybe[:, 0] - 2, maybe[:, 1] - 2].astype(float)
    ring = np.ones((5, 5), bool)
    ring[1:4, 1:4] = False
    around, beside = window[:, ring], window[:, [1, 2, 2, 3], [2, 1, 3, 2]]
    usual = np.median(around, axis=1)
    # An edge or a texture around it is more than noise, and scatters what is beside as well.
    sigma = np.maximum(sigma, np.sqrt(((around - usual[:, None]) ** 2).mean(axis=1)))
    off, light = window[:, 2, 2] - usual, beside.mean(axis=1) - usual
    scatter = sigma * np.sqrt(1 / beside.shape[1] + 1.57 / around.shape[1])  # of the mean, and of the median round it
    least = sharpest_line(blur_px / BLUR_OFF) * np.abs(off)
    shown = ((beside > ends[0]) & (beside < ends[1])).all(axis=1) & np.isfinite(window).all(axis=(1, 2))
    dead = shown & (np.abs(off) > SURE * sigma) & (np.abs(light) + SIGMAS * scatter + 0.5 * step < least)
    return np.asarray(maybe[dead])
