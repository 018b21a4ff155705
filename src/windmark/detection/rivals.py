"""Is it a disc, or another thing of its size? Squares, crosses and rings are compared with it on the same pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.detection.image import Pixels
from windmark.detection.template.result import TemplateFits

Array = NDArray[np.float64]

PIXEL = 0.29  # px, standard deviation of a pixel's box
LEAST_PX = 3.5  # smaller half axis; below, straight edges sampled at pixels are too coarse a model to judge by


def rival_evidence(g: Pixels, fits: TemplateFits, variance: Array) -> Array:
    """Nats (K,) by which the best other shape explains the pixels better than the disc; NaN where none can be judged.

    All shapes have the fitted ellipse's place, size and tilt and the fitted blur; depth and plane are fitted to each.
    What neither explains is no noise of single pixels: the misfit of the better one counts as such.

    Parameters
    ----------
    g : (H, W) the prepared image
    fits : (K,) fitted discs
    variance : (K,) of one pixel's noise
    """
    from windmark.detection._kernels.rivals import SHAPES, misfits

    out = np.full(len(fits), np.nan)
    index = np.flatnonzero(np.isfinite(fits.axes_px).all(axis=1) & (fits.axes_px[:, 1] >= LEAST_PX))
    if not index.size:
        return out
    c, s = np.cos(fits.angle[index]), np.sin(fits.angle[index])
    a, b = fits.axes_px[index].T
    shape = np.column_stack([a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c])
    edges, left = np.sqrt(12.0) * np.hypot(fits.blur_px[index], PIXEL), np.empty((index.size, SHAPES + 1))
    misfits(g, np.ascontiguousarray(fits.xy[index]), shape, edges, left)
    best, pixels = left[:, 1:SHAPES].min(axis=1), left[:, SHAPES]
    with np.errstate(invalid="ignore", divide="ignore"):
        out[index] = 0.5 * (left[:, 0] - best) / np.maximum(best / pixels, variance[index])
    return out
