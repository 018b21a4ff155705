"""Whether the edge of a fitted disc is there all the way round: what tells a marker from a piece of something else."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.disc_model import PIXEL_VARIANCE, shape_matrix
from windmark.detection.template.fit import BATCH_PIXELS, cut_patches
from windmark.detection.template.request import Scene
from windmark.detection.template.result import TemplateFits

Array = NDArray[np.float64]

REACH_BLURS = 3.0  # beyond the ellipse there is no rim


def rim_support(scene: Scene, fits: TemplateFits, variance: Array) -> Array:
    """Share of the edge that is explained in the worst and in the median of eight sectors: (K, 2).

    From -1 (another edge) to 1 (all of it). A disc that a line crosses keeps most of its edge; a letter's stroke or a
    part of a ring has none where it goes on, a square nearly nowhere. NaN where the fit failed or no sector can be
    judged.

    Parameters
    ----------
    scene : the image as the fits saw it
    fits : (K,) fitted markers
    variance : (K,) of one pixel's noise
    """
    out = np.full((len(fits), 2), np.nan)
    good = np.isfinite(fits.cov).all(axis=(1, 2)) & (fits.blur_px > 0.0)
    half = np.ceil(fits.axes_px[:, 0] + REACH_BLURS * fits.blur_px + 1.0)
    good &= half < 0.5 * max(scene.image.shape)
    for size in np.unique(half[good]):
        mine = np.flatnonzero(good & (half == size))
        count = -(-mine.size * (2 * int(size) + 1) ** 2 // BATCH_PIXELS)
        for index in np.array_split(mine, count):
            out[index] = _support(scene, fits.take(index), variance[index], int(size))
    return out


def _support(scene: Scene, fits: TemplateFits, variance: Array, half: int) -> Array:
    from windmark.detection.template._kernels.rim import SECTORS, rim_shares

    pixel = np.rint(fits.xy).astype(np.int64)
    patches, weights = cut_patches(scene, pixel, half)
    shares = np.empty((len(fits), SECTORS))
    rim_shares(patches, weights, model_parameters(scene, fits, pixel), variance, float(scene.multiplicative), shares)
    shares = np.sort(np.clip(shares, -1.0, 1.0), axis=1)  # NaN last
    known, row = SECTORS - np.isnan(shares).sum(axis=1), np.arange(len(fits))
    middle = 0.5 * (shares[row, np.maximum(known - 1, 0) // 2] + shares[row, np.minimum(known // 2, SECTORS - 1)])
    return np.column_stack([shares[:, 0], np.where(known > 0, middle, np.nan)])


def model_parameters(scene: Scene, fits: TemplateFits, pixel: NDArray[np.int64]) -> Array:
    """Parameters (K, 10) of the model on patches round the pixels: the inverse of `template_result.columns`."""
    p, offset = np.empty((len(fits), 10)), fits.xy - pixel
    shape = shape_matrix(fits.axes_px, fits.angle)
    slope = fits.slope if scene.multiplicative else scene.sign * fits.slope
    here = 1.0 - (slope * offset).sum(axis=1) if scene.multiplicative else np.ones(len(fits))
    shift = (fits.blur_px**2 + PIXEL_VARIANCE)[:, None] * slope if scene.multiplicative else 0.0
    p[:, :2] = offset - shift
    p[:, 2], p[:, 3], p[:, 4], p[:, 5] = shape[:, 0, 0], shape[:, 0, 1], shape[:, 1, 1], fits.blur_px
    p[:, 6], p[:, 7] = fits.depth * here, scene.sign * fits.background * here
    if not scene.multiplicative:
        p[:, 7] -= (slope * offset).sum(axis=1)
    p[:, 8:] = slope / here[:, None]
    return p
