"""How blurred a picture is, by the rims of its spots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.refine import refine_template
from windmark.scene import Detections

MOST = 40
"""Spots that tell the blur."""


def spot_blur(image: NDArray[np.generic], spots: Detections, polarity: str) -> tuple[float, float]:
    """Median blur of an image's spots (1 sigma of a Gaussian) and their median radius, in pixels.

    The blur is NaN where no fit of theirs tells it, both are without spots.

    Parameters
    ----------
    image : (H, W) grey levels
    spots : best first
    polarity : theirs; what is neither "dark" nor "bright" is taken as dark
    """
    if not len(spots):
        return float("nan"), float("nan")
    radius = np.where(spots.radius_px > 0, spots.radius_px, np.nanmedian(spots.radius_px))[:MOST]
    kind = polarity if polarity in ("dark", "bright") else "dark"
    additive = kind == "bright" or image.min(initial=0) < 0
    fits = refine_template(
        image, spots.xy[:MOST], radius, polarity=kind, photometry="additive" if additive else "multiplicative",
        robust=False,
    )  # fmt: skip
    sure = fits.converged & np.isfinite(fits.blur_px) & (fits.flags == 0)
    if not sure.any():
        return float("nan"), float(np.median(radius))
    return float(np.median(fits.blur_px[sure])), float(np.median(np.sqrt(fits.axes_px[sure].prod(axis=1))))
