"""What a picture itself says: how blurred its markers are, and how much of it is at its highest level."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.crlb import bound_factor
from windmark.detection.template.refine import refine_template
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding
from windmark.scene import Detections

MOST = 40
"""Spots that tell the blur."""


@dataclass(frozen=True)
class PictureState:
    """State of a picture.

    Parameters
    ----------
    blur_px : median blur of its markers, 1 sigma of a Gaussian; NaN where there are none
    radius_px : their median radius
    costs : best possible sigma of their centres over that of the same discs in a sharp picture; NaN likewise
    saturated : part of its pixels at the highest level; 0 unless it is clipped there
    level : that level
    """

    blur_px: float
    radius_px: float
    costs: float
    saturated: float
    level: float


def picture_state(image: NDArray[np.generic], spots: Detections | None, polarity: str) -> PictureState:
    """Look at an image (H, W) of grey levels and its spots, best first; ``polarity`` is theirs."""
    grey = np.asarray(image)
    saturated, level = _saturated(grey)
    if spots is None or not len(spots):
        return PictureState(np.nan, np.nan, np.nan, saturated, level)
    radius = np.where(spots.radius_px > 0, spots.radius_px, np.nanmedian(spots.radius_px))[:MOST]
    kind = polarity if polarity in ("dark", "bright") else "dark"
    additive = kind == "bright" or grey.min(initial=0) < 0
    fits = refine_template(
        grey,
        spots.xy[:MOST],
        radius,
        polarity=kind,
        photometry="additive" if additive else "multiplicative",
        robust=False,
    )
    sure = fits.converged & np.isfinite(fits.blur_px) & (fits.flags == 0)
    if not sure.any():
        return PictureState(np.nan, float(np.median(radius)), np.nan, saturated, level)
    blur, size = float(np.median(fits.blur_px[sure])), float(np.median(np.sqrt(fits.axes_px[sure].prod(axis=1))))
    costs = bound_factor(size, 0.0, blur, samples=8) / bound_factor(size, 0.0, rules.SHARP_PX, samples=8)
    return PictureState(blur, size, float(costs), saturated, level)


def _saturated(grey: NDArray[np.generic]) -> tuple[float, float]:
    """Part of the pixels at the highest level and this level; 0 where the picture is not clipped there."""
    if grey.dtype.kind not in "ui" or not grey.size:
        return 0.0, np.nan
    top = int(grey.max())
    at, below = int((grey == top).sum()), int((grey == top - 1).sum())
    clipped = at > rules.PLATEAU * max(below, 1) and top > 0
    return (at / grey.size if clipped else 0.0), float(top)


def picture_findings(state: PictureState) -> list[Finding]:
    """Saturated and blurred pictures."""
    out = []
    if state.saturated > rules.SATURATED:
        out.append(
            Finding(
                DOUBTFUL,
                "saturated",
                f"{100 * state.saturated:.2g} % of the pixels are at the highest grey level, {state.level:.0f}",
                "expose shorter or dim the lamps; values there are lower bounds",
            )
        )
    if state.costs > rules.BLUR_COSTS:
        out.append(
            Finding(
                DOUBTFUL,
                "blurred",
                f"the picture is blurred by {state.blur_px:.2g} px (1 sigma) at markers of "
                f"{state.radius_px:.2g} px radius: "
                f"their centres are {state.costs:.2g} times less sure than in a sharp one",
                "focus, or expose shorter where the model moves; or paint larger markers",
            )
        )
    return out
