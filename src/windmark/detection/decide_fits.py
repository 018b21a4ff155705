"""Which fitted templates are markers: each by itself, then beside the image's other markers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.detection.company import are_others
from windmark.detection.family import (
    TYPICAL,
    at_grazing_angle,
    beside,
    face_on,
    like_points,
    relative_contrast,
    size_at_blur,
)
from windmark.detection.options import Options
from windmark.detection.quantile import weighted_quantile
from windmark.detection.rejected import (
    ACCEPTED,
    BLURRED,
    FAINT,
    LARGE,
    MISFIT,
    OTHER,
    PALE,
    PART,
    SHALLOW,
    SMALL,
    UNCERTAIN,
)
from windmark.detection.spots import Spots
from windmark.detection.template.crlb import window_radius
from windmark.detection.template.result import SATURATED, TemplateFits

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

EVIDENCE_MIN = 10.0  # of the matched filter: white noise reaches 5 in every picture, what is correlated twice as much
WHITE_EVIDENCE = 8.0  # of what is like the other markers, where they have shown that the noise is white
CORRELATION_MIN = 0.93, 0.975  # of disc and window but for noise: of spots that SPOT takes, and of weaker ones
SHARP_EDGE, WITH_SHARP_EDGE = 0.9, 0.8  # enough where most of the edge is beyond doubt: the rest is beside the marker
ROUND_MIN = 0.3, 0.45  # ratio of the axes, 72 and 63 deg of tilt: for the same two
RADIUS_RATIO = 0.7, 1.4  # larger half axis, and mean one, over the radii asked for
BLUR_SIGMAS = 4.0  # a marker's blur may differ from the frame's by so many standard deviations
SAME_BLUR_PX = 0.1  # standard deviation of the blur among markers near each other
SMALL_BLURS = 5.0  # discs below so many blurs may be confused with blurred specks
EDGE_MEDIAN = 0.6  # of the edge must be there in most sectors
SOUND_MIN = 0.5  # least contrast / the markers' * ratio of axes * exp(0.3 * worst sector)
SOUND_EDGE, SOUND_CORRELATION = 0.6, 0.985  # worst sector, and correlation, of a marker that nothing disturbs
DISTURBED_MIN = 0.65  # the same of one that something disturbs
CROSSED_MIN = 0.53  # the same without the edge of one that a line crosses
CONTRAST_CAP = 1.2  # more contrast than the markers' says nothing more
TINY_PX = 2.0  # radius below which pixels do not show a shape: where such markers are asked for, SPOT is believed
TILE_VARIANCE = 1.3  # a tile's noise, of 256 pixels, may be too small by so much
CONTRAST_SHARE = 0.6  # of the markers' contrast
SIZE_SHARE, SIZE_QUANTILE = 0.8, 0.2  # of the smaller of the typical markers, for those smaller than asked for
NEAR_RADIUS = 0.86  # of the smallest radius asked for
LEAST_VOLUME = 0.85  # of that of a disc as small as may be, with the markers' contrast


@dataclass(frozen=True)
class Noise:
    """What noise a spot's pixels have.

    Parameters
    ----------
    variance : (K,) of a pixel: the frame's if that speaks for all, else not more than the surface's there
    surface : (K,) of a pixel, as the surface round the spot shows it: not below what it is, but for chance
    tail : (K,) how much more the noise moves a filter than if it were not correlated: 1 where the markers have shown it
    least : of the matched filter, in standard deviations, that is no chance
    """

    variance: Array
    surface: Array
    tail: Array
    least: float


def judge_fits(
    fits: TemplateFits, spots: Spots, noise: Noise, support: Array, weak: Flags, radii: Sequence[float],
    options: Options, rivals: Callable[[Ints], Array],
) -> Ints:  # fmt: skip
    """What decides about each fit (K,): ACCEPTED or a code of `rejected.REASONS`.

    A disc seen at an angle keeps its radius as the larger half axis, so that one must not be smaller than asked for;
    the mean one must not be larger.
    What a blurred disc shows is r^2 / 4 + blur^2: an error e of the blur is one of 4 blur e / r of an axis r, which is
    allowed for. Discs much larger than the blur cannot be confused with blurred specks; for them the blur says nothing.

    Parameters
    ----------
    support : (K, 2) of the edge, see `rim_support`
    weak : (K,) spots that SPOT would not take: they must be better discs
    rivals : `rivals.rival_evidence` of some of the fits
    """
    reason = np.full(len(fits), ACCEPTED, dtype=np.int64)
    band = weak.astype(int)
    with np.errstate(invalid="ignore", divide="ignore"):
        spread = np.hypot(fits.blur_sigma_px, fits.frame.blur_spread_px)
        away = np.hypot(*(fits.xy - spots.xy).T)
        major, minor = fits.axes_px.T
        # At the bound of its axes a fit is surer of its blur than it may be: then it is the frame's.
        unsure = np.where(like_points(fits), spread, fits.blur_sigma_px)
        doubt = 4.0 * fits.blur_px[:, None] * unsure[:, None] / np.maximum(fits.axes_px, 0.5)
        if options.min_depth is not None:
            reason[~(fits.depth >= options.min_depth)] = SHALLOW
        # Where a line was fitted too, the edge it hides says nothing: contrast and roundness decide.
        edge = np.where(fits.crossed, 0.0, support[:, 0])
        correlation = shape_correlation(fits, noise.variance)
        answer = matched_filter(fits, noise.variance) / noise.tail
        sharp = support[:, 1] >= SHARP_EDGE
        unlike = ~(correlation >= np.where(sharp & ~weak, WITH_SHARP_EDGE, np.array(CORRELATION_MIN)[band]))
        shapely = weak | has_shape(fits, radii)
        unlike |= shapely & ~(minor + doubt[:, 1] >= np.array(ROUND_MIN)[band] * major)
        reason[shapely & ~fits.crossed & ~(support[:, 1] >= EDGE_MEDIAN)] = PART
        reason[~(fits.depth > 0.0) | ~(answer >= noise.least)] = FAINT
        # A radius measured off the picture may be the mean one; a disc seen at an angle has it as the larger half axis.
        reason[fits.radius_px - doubt[:, 0] > RADIUS_RATIO[1] * max(radii)] = LARGE
        reason[major + doubt[:, 0] < RADIUS_RATIO[0] * min(radii)] = SMALL
        reason[~fits.converged | ~np.isfinite(fits.cov).all(axis=(1, 2)) | (away > spots.r0)] = UNCERTAIN
        good = np.flatnonzero((reason == ACCEPTED) & ~fits.crossed & has_shape(fits, radii))
        contrast = fits.contrast if options.light == "multiplicative" else fits.depth
        size = size_at_blur(fits, fits.frame.blur_px)
        # Saturation takes part of what pixels say of shape and contrast: there each speaks for itself.
        plain = (fits.flags[good] & SATURATED) == 0
        other = are_others(rivals(good), size[good], np.abs(contrast[good]), plain)
        reason[good[other]] = OTHER  # before it can say what the image's markers are like
        sound = (edge >= SOUND_EDGE) & (correlation >= SOUND_CORRELATION)
        sound |= fits.crossed | ((fits.flags & SATURATED) > 0)  # saturated: too little is left of it to look disturbed
        weight = np.nan_to_num(answer, nan=0.0, posinf=0.0) ** 2  # specks and noise say little
        faint = answer < EVIDENCE_MIN
        clear = sound & ~weak & ~unlike & ~faint
        odd = (reason == ACCEPTED) & (fits.radius_px < SMALL_BLURS * fits.blur_px)
        odd &= np.abs(fits.blur_px - fits.frame.blur_px) > BLUR_SIGMAS * spread
        if odd.any():  # optics are not sharp everywhere: beside others that are as blurred it is one of them
            there = beside(fits.xy, fits.blur_px, (reason == ACCEPTED) & clear, weight)
            odd &= ~(np.abs(fits.blur_px - there) <= BLUR_SIGMAS * np.hypot(fits.blur_sigma_px, SAME_BLUR_PX))
        reason[odd] = BLURRED
        typical = (reason == ACCEPTED) & clear & ~fits.crossed & ~like_points(fits)
        tilted = ~fits.crossed & at_grazing_angle(
            fits, contrast, typical, weight, np.fmin(noise.variance, noise.surface), doubt, NEAR_RADIUS * min(radii)
        )
        reason[(reason == ACCEPTED) & unlike & ~tilted] = MISFIT
        reason[(reason == ACCEPTED) & faint & ~tilted] = FAINT
        _beside_the_others(reason, fits, weight, typical, tilted, edge, doubt, sound, weak, radii, options)
    return reason


def _beside_the_others(
    reason: Ints,
    fits: TemplateFits,
    weight: Array,
    typical: Flags,
    tilted: Flags,
    edge: Array,
    doubt: Array,
    sound: Flags,
    weak: Flags,
    radii: Sequence[float],
    options: Options,
) -> None:
    """Reject what differs from the image's typical markers.

    Markers are of one paint, so that their contrast to the light varies little and only from place to place (haze,
    another black level); what adds to the light varies more. A blurred speck is a good disc, but smaller; specks may be
    many, so each counts by its area. Contrast, roundness and edge count together: pieces of letters, rings and
    scratches lack some of each.
    """
    shapely = weak | has_shape(fits, radii)
    share, major, minor = np.ones(len(fits)), *fits.axes_px.T
    if typical.sum() >= TYPICAL:
        if options.light == "multiplicative":
            share = relative_contrast(fits.xy, fits.contrast, typical, weight)
            reason[(reason == ACCEPTED) & ~(share >= CONTRAST_SHARE)] = PALE
        else:
            share = relative_contrast(fits.xy, fits.depth, typical, weight)
        small = share * face_on(fits) < LEAST_VOLUME * np.square(RADIUS_RATIO[0] * min(radii))
        reason[(reason == ACCEPTED) & ~shapely & small] = SMALL
        share = share if options.light == "multiplicative" else np.sqrt(share)
        size = size_at_blur(fits, fits.frame.blur_px)
        least = SIZE_SHARE * weighted_quantile(size[typical], size[typical] ** 2, SIZE_QUANTILE)
        if min(radii) >= TINY_PX:
            # The frame's blur differs from place to place: so does the size that a small disc would have with it.
            unsure = doubt[:, 0] + 4.0 * fits.frame.blur_px * fits.frame.blur_spread_px / np.maximum(size, TINY_PX)
            reason[(reason == ACCEPTED) & (size + unsure < min(float(least), NEAR_RADIUS * min(radii)))] = SMALL
    else:  # no frame tells size from blur
        minor = np.minimum(minor + doubt[:, 1], major)
    # Seen at an angle all that are near each other are as narrow.
    narrow = beside(fits.xy, minor / major, typical, weight)
    roundness = np.clip(minor / major / np.fmin(narrow, 1.0), minor / major, 1.0)
    roundness = np.where(np.isfinite(roundness), roundness, minor / major)
    whole = np.minimum(share, CONTRAST_CAP) * roundness * np.exp(0.3 * edge)
    reason[
        (reason == ACCEPTED)
        & shapely
        & ~tilted
        & ~(whole >= np.select([fits.crossed, sound], [CROSSED_MIN, SOUND_MIN], DISTURBED_MIN))
    ] = PART


def has_shape(fits: TemplateFits, radii: Sequence[float]) -> Flags:
    """Fits (K,) large enough for the pixels to show a shape, or larger than the markers need to be."""
    return (fits.radius_px >= TINY_PX) | (min(radii) >= TINY_PX)


def speaks_for_all(fits: TemplateFits, spots: Spots) -> bool:
    """Whether the frame's noise is that of markers: most of what rises from it are discs by the surface's noise too.

    In a picture of text or strong texture the fits agree on a noise in which every letter is a disc.
    """
    surface = TILE_VARIANCE * spots.noise**2
    with np.errstate(invalid="ignore"):
        rises = fits.converged & (matched_filter(fits, fits.noise**2 / fits.chi2) >= EVIDENCE_MIN)
        beyond = rises & (matched_filter(fits, surface) >= EVIDENCE_MIN * spots.tail)
        beyond &= shape_correlation(fits, surface) >= CORRELATION_MIN[1]
    return bool(beyond.sum() >= max(TYPICAL, 0.5 * rises.sum()))


def expected_noise(fits: TemplateFits, spots: Spots) -> Noise:
    """The noise that the spots' pixels are expected to have."""
    surface = TILE_VARIANCE * spots.noise**2
    with np.errstate(invalid="ignore", divide="ignore"):
        frame = fits.noise**2 / fits.chi2
    if speaks_for_all(fits, spots):
        white = fits.frame.noise is not None and fits.frame.noise.is_white
        least = WHITE_EVIDENCE if white else EVIDENCE_MIN
        return Noise(np.where(np.isfinite(frame), frame, surface), surface, np.ones(len(fits)), least)
    return Noise(np.where(np.isfinite(frame), np.fmin(frame, surface), surface), surface, spots.tail, EVIDENCE_MIN)


def matched_filter(fits: TemplateFits, variance: Array) -> Array:
    """Answer (K,) of the disc's matched filter in standard deviations of noise of that variance (K,)."""
    pixels = np.pi * window_radius(fits.radius_px, fits.blur_px) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        rho2 = np.clip(fits.correlation, -1.0, 1.0) ** 2
        return np.sqrt(pixels * rho2 / (1.0 - rho2) / variance) * fits.noise


def shape_correlation(fits: TemplateFits, variance: Array) -> Array:
    """Correlation (K,) of disc and window that would be left without noise of that variance (K,).

    1 - rho^2 is the share of the window's variance that the disc does not explain. Noise explains part of it, by chance
    up to two standard deviations more than on average.
    """
    pixels = np.pi * window_radius(fits.radius_px, fits.blur_px) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        share = 1.0 - np.clip(variance * (1.0 + 2.0 * np.sqrt(2.0 / pixels)) / fits.noise**2, 0.0, 1.0)
    return np.sqrt(1.0 - share * (1.0 - np.clip(fits.correlation, 0.0, 1.0) ** 2)) * np.sign(fits.correlation)
