"""The template's part in `detect`: fit the candidates of SPOT, decide again with what the fits say."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.detection.decide import RADIUS_RATIO
from windmark.detection.image import Prepared
from windmark.detection.options import Options
from windmark.detection.rejected import ACCEPTED, BLURRED, FAINT, LARGE, MISFIT, PALE, SAME, SHALLOW, SMALL, UNCERTAIN
from windmark.detection.shape import Shapes
from windmark.detection.spots import Spots, distinct
from windmark.scene import Detections

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

FIT_SLACK = 0.3  # a tilted or contaminated disc may suit no trial radius: beyond the limit of the merit the fit decides
QUALITY_SHARE = 0.5  # of the least quality of `detect`: fainter spots are not fitted
CORRELATION_MIN = 0.93, 0.975  # of disc and window but for noise: of spots that SPOT takes, and of weaker ones
ROUND_MIN = 0.3, 0.45  # ratio of the axes, 72 and 63 deg of tilt: for the same two
BLUR_SIGMAS = 4.0  # a marker's blur may differ from the frame's by so many standard deviations
SMALL_BLURS = 5.0  # discs below so many blurs may be confused with blurred specks
CLEAN = 5  # markers that say what a frame's contrast is
CONTRAST_SHARE = 0.5  # of the frame's median contrast: markers are of one paint


def worth_fitting(value: Array, spots: Spots, bowl: Ints, options: Options) -> Ints:
    """Indices of the spots to be fitted, best first: those that SPOT takes, then weaker ones at other places."""
    weak = (value >= QUALITY_SHARE * options.min_quality) & (spots.merit <= options.merit_max + FIT_SLACK)
    weak[bowl] = False
    rest = np.flatnonzero(weak)
    rest = rest[distinct(spots.take(rest))]
    if len(bowl) and len(rest):
        from scipy.spatial import cKDTree

        away, nearest = cKDTree(spots.xy[bowl]).query(spots.xy[rest])
        rest = rest[away >= 0.75 * (spots.r0[rest] + spots.r0[bowl[nearest]])]
    return np.concatenate([bowl, rest[np.argsort(-value[rest], kind="stable")]])


def refined(
    image: NDArray[np.generic],
    prepared: Prepared,
    spots: Spots,
    found: Shapes,
    radii: Sequence[float],
    taken: int,
    options: Options,
) -> tuple[Detections, Ints]:
    """Fit the template to the spots (K, best first), the first `taken` of which SPOT takes by itself.

    Returns
    -------
    markers : the accepted ones, in the order of the spots
    reason : (K,) what decided, ACCEPTED or a code of `rejected.REASONS`
    """
    from windmark.detection.template import refine_template

    usable = np.isfinite(prepared.g) if prepared.missing else None
    radius = np.clip(np.nan_to_num(found.radius, nan=0.0), 0.75 * spots.r0, 1.3 * spots.r0)
    fits = refine_template(
        image, spots.xy, radius, polarity=options.polarity, photometry=options.light, mask=usable
    )  # fmt: skip
    reason = judge_fits(fits, spots, radii, taken, options)
    good = np.flatnonzero(reason == ACCEPTED)
    moved = Spots(fits.xy[good], spots.merit[good], spots.depth[good], spots.settled[good], spots.r0[good],
                  spots.noise[good])  # fmt: skip
    once = np.sort(good[distinct(moved)])
    reason[np.setdiff1d(good, once)] = SAME
    fits = fits.take(once)
    return Detections(
        xy=fits.xy, cov=fits.cov, merit=spots.merit[once], radius_px=fits.radius_px, axes_px=fits.axes_px,
        angle=fits.angle, depth=fits.depth, flags=fits.flags,
    ), reason  # fmt: skip


def judge_fits(fits: Any, spots: Spots, radii: Sequence[float], taken: int, options: Options) -> Ints:
    """What decides about each of the `TemplateFits` (K,): ACCEPTED or a code of `rejected.REASONS`.

    Weak spots, from `taken` on, must be better discs. Where paint scales the light all markers of a frame have about
    the same contrast, whatever the light: stains and shadows have less.

    What a blurred disc shows is r^2 / 4 + blur^2: an error e of the blur is one of 4 blur e / r of the radius, which is
    allowed for. Discs much larger than the blur cannot be confused with blurred specks; for them the blur says nothing.
    """
    reason = np.full(len(fits), ACCEPTED, dtype=np.int64)
    weak = (np.arange(len(fits)) >= taken).astype(int)
    with np.errstate(invalid="ignore", divide="ignore"):
        spread = np.hypot(fits.blur_sigma_px, fits.frame.blur_spread_px)
        away = np.hypot(*(fits.xy - spots.xy).T)
        if options.min_depth is not None:
            reason[~(fits.depth >= options.min_depth)] = SHALLOW
        reason[~(shape_correlation(fits) >= np.array(CORRELATION_MIN)[weak])] = MISFIT
        reason[~(fits.axes_px[:, 1] >= np.array(ROUND_MIN)[weak] * fits.axes_px[:, 0])] = MISFIT
        odd = np.abs(fits.blur_px - fits.frame.blur_px) > BLUR_SIGMAS * spread
        reason[odd & (fits.radius_px < SMALL_BLURS * fits.blur_px)] = BLURRED
        reason[~(fits.depth > 0.0)] = FAINT
        doubt = 4.0 * fits.blur_px * fits.blur_sigma_px / np.maximum(fits.radius_px, 0.5)
        reason[fits.radius_px - doubt > RADIUS_RATIO[1] * max(radii)] = LARGE
        reason[fits.radius_px + doubt < RADIUS_RATIO[0] * min(radii)] = SMALL
        reason[~fits.converged | ~np.isfinite(fits.cov).all(axis=(1, 2)) | (away > spots.r0)] = UNCERTAIN
        clean = (reason == ACCEPTED) & (fits.flags == 0)
        if options.light == "multiplicative" and clean.sum() >= CLEAN:
            reason[(reason == ACCEPTED) & (fits.contrast < CONTRAST_SHARE * np.median(fits.contrast[clean]))] = PALE
    return reason


def shape_correlation(fits: Any) -> Array:
    """Correlation (K,) of disc and window that would be left without the frame's noise.

    1 - rho^2 is the share of the window's variance that the disc does not explain; 1 / chi2 of it is the frame's noise.
    """
    share = np.where(np.isfinite(fits.chi2), np.clip(1.0 - 1.0 / fits.chi2, 0.0, 1.0), 1.0)
    return np.sqrt(1.0 - share * (1.0 - np.clip(fits.correlation, 0.0, 1.0) ** 2)) * np.sign(fits.correlation)
