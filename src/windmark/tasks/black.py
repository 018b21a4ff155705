"""Pixels of the model that are clipped at black: noise ends there at the picture's lowest level."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]

WINDOW_PX = 9
"""Pixels across round one, of which is counted how many are at the lowest level."""
PART, NEARLY_ALL = 0.2, 0.9
"""Part of those: what is left has a mean that is 0.11 of its noise too high, more where it is more. Where nearly all
are, single ones above tell nothing of noise."""
BY_TURNS, LEAST = 0.3, 200
"""Part of what noise alone makes of pixels that are at the level with both neighbours above it, or the other way round:
of the rims of dots it is far less. So many pixels on the model are enough."""
STEPS = 2.0
"""Steps of the grey levels that a tenth of the single ones is above it at least: less is how numbers are rounded."""


def black_pixels(image: NDArray[np.generic], shown: Mask) -> Mask | None:
    """(H, W) pixels of an image that are clipped at black; None where none is.

    A picture from which a dark one was taken, and what was below zero put to zero, has a mean that is too high where
    there is little light, and a noise that is too small.

    Parameters
    ----------
    image : (H, W)
    shown : (H, W) those that show the model: what is behind it may be at the lowest level as it likes
    """
    known = shown & np.isfinite(image)
    if image.dtype.kind not in "uif" or not known.any():
        return None
    lowest = image[known].min()
    low = known & (image == lowest)
    if low.sum() < LEAST:
        return None
    from scipy.ndimage import binary_erosion, binary_propagation, uniform_filter

    inner = known[:, :-2] & known[:, 1:-1] & known[:, 2:]
    single = np.zeros((2, *low.shape), bool)  # at the level between two above it, and above it between two at it
    single[0, :, 1:-1] = inner & low[:, 1:-1] & ~low[:, :-2] & ~low[:, 2:]
    single[1, :, 1:-1] = inner & ~low[:, 1:-1] & low[:, :-2] & low[:, 2:]
    triples = np.zeros(low.shape, bool)
    triples[:, 1:-1] = inner
    of, part, turns, tripled = (
        uniform_filter(mask.astype(np.float32), WINDOW_PX, mode="constant")
        for mask in (known, low, single.any(axis=0), triples)
    )
    share = part / np.maximum(of, 1e-6)
    noisy = known & (share > PART) & (turns > BY_TURNS * share * (1 - share) * tripled) & (share < NEARLY_ALL)
    above = (image[single[1] & noisy]).astype(float) - float(lowest)
    if noisy.sum() < LEAST or not len(above) or not (top := float(np.quantile(above, 0.9))) >= STEPS * _step(image):
        return None
    out = (noisy & (image.astype(float) - float(lowest) <= 2 * top)) | (known & low & (share >= NEARLY_ALL))
    # Where grid or pose is off by some pixels a rim shows what is behind the model, which may be at the lowest level:
    # what is clipped of the model has to reach farther in.
    deep = binary_erosion(shown, iterations=WINDOW_PX, border_value=1)
    out = binary_propagation(out & deep, mask=out)
    return out if out.sum() >= LEAST else None


def beside_black(image: NDArray[np.generic]) -> Mask:
    """(H, W) pixels round which more than `PART` are at the picture's lowest level, clipped or not: what they scatter
    is less than noise, also beside an outline where a background is all at that level.
    """
    from scipy.ndimage import uniform_filter

    low = image == image[np.isfinite(image)].min()
    return np.asarray(uniform_filter(low.astype(np.float32), WINDOW_PX, mode="nearest") > PART)


def _step(image: NDArray[Any]) -> float:
    """Of whole numbers at least 1; floats may lie on none."""
    return 1.0 if image.dtype.kind in "ui" else 0.0
