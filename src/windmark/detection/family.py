"""What a fit is like beside the image's other markers: their contrast, size and shape, near it and in all.

A disc seen at an angle keeps its radius as the larger half axis and its contrast; what it takes away from the light
shrinks by the cosine of the angle, however little the pixels show of its width. Pieces of other things are of any
length, contrast and area. So a narrow fit that has the others' length and contrast to within what noise does to them,
takes away as much as they would at 72 degrees and more, and leaves nothing of its window but noise, is one of them seen
at a grazing angle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.detection.quantile import weighted_quantile
from windmark.detection.template.crlb import window_radius
from windmark.detection.template.result import LEAST_AXIS_PX, TemplateFits

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

TYPICAL = 8  # sound markers that say what the image's markers are like
NEAREST = 9  # of them are those near a place
GRAZING = 0.3  # ratio of the axes, 72 deg of tilt
ALIKE = 0.03  # standard deviation of size and of contrast among markers near each other
LIKELY = 3.0  # standard deviations by which chance may move what noise makes unsure
UNSURE = 2.0  # standard deviations of what is taken away: 1 / answer of the matched filter
AXIS_OVER_PLACE = 1.15  # sigma of a half axis over the centre's along it: rim weighed by cos^2, sqrt(<c^2> / <c^4>)


def at_grazing_angle(
    fits: TemplateFits, contrast: Array, typical: Flags, weight: Array, variance: Array, doubt: Array, least_px: float
) -> Flags:
    """Fits (K,) that are discs of the image's family seen at any angle up to 72 deg.

    None where the family has few members or is smaller than asked for: dust is a family of its own.

    Parameters
    ----------
    contrast : (K,) what markers have in common: contrast where paint takes away light, else depth
    typical, weight : (K,) which fits say what the family is like, and how much each counts: its matched filter's
        answer squared
    variance : (K,) of one pixel's noise
    doubt : (K, 2) standard deviation of the half axes that an unsure blur makes, px
    least_px : radius that the family must have
    """
    if typical.sum() < TYPICAL:
        return np.zeros(len(fits), dtype=bool)
    size, (major, minor) = size_at_blur(fits, fits.frame.blur_px), fits.axes_px.T
    contrast = np.abs(contrast)
    usual_size, usual = (beside(fits.xy, value, typical, weight) for value in (size, contrast))
    pixels = np.pi * window_radius(fits.radius_px, fits.blur_px) ** 2
    along = np.stack([np.cos(fits.angle), np.sin(fits.angle)], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        place = np.sqrt(np.einsum("ki,kij,kj->k", along, fits.cov, along))
        of_size = np.hypot(np.hypot(AXIS_OVER_PLACE * place, doubt[:, 0]), ALIKE * usual_size)
        of_contrast = np.hypot(np.fmax(contrast, usual) * fits.depth_sigma / np.abs(fits.depth), ALIKE * usual)
        as_long = (np.abs(size - usual_size) <= LIKELY * of_size) & (usual_size >= least_px)
        as_dark = np.abs(contrast - usual) <= LIKELY * of_contrast
        nothing_left = fits.noise**2 <= variance * (1.0 + LIKELY * np.sqrt(2.0 / pixels))
        # Half axes and depth are confused where discs are narrow; their product, what is taken away, is known.
        taken = contrast * major * minor / (usual * usual_size**2)
        seen = taken * (1.0 + UNSURE / np.sqrt(weight)) >= GRAZING
    return np.asarray(as_long & as_dark & nothing_left & seen & fits.converged)


def relative_contrast(xy: Array, contrast: Array, typical: Flags, weight: Array) -> Array:
    """Contrast (K,) over the median of the typical markers: of all, or of those near, whichever is kinder."""
    from scipy.spatial import cKDTree

    known, counts = np.abs(contrast[typical]), weight[typical]
    near = cKDTree(xy[typical]).query(np.nan_to_num(xy), k=min(NEAREST, int(typical.sum())))[1]
    least = np.minimum(weighted_quantile(known, counts, 0.5), weighted_quantile(known[near], counts[near], 0.5))
    return np.asarray(np.abs(contrast) / least)


def beside(xy: Array, value: Array, typical: Flags, weight: Array) -> Array:
    """Weighted median (K,) of a value of the typical markers near a place, itself left out; NaN where they are few."""
    from scipy.spatial import cKDTree

    index = np.flatnonzero(typical)
    if len(index) < TYPICAL:
        return np.full(len(xy), np.nan)
    near = index[cKDTree(xy[index]).query(np.nan_to_num(xy), k=min(NEAREST + 1, len(index)))[1]]
    counts = np.where(near == np.arange(len(xy))[:, None], 0.0, weight[near])
    return np.asarray(weighted_quantile(value[near], counts, 0.5))


def size_at_blur(fits: TemplateFits, blur_px: float) -> Array:
    """Larger half axis (K,) that a marker would have with the frame's blur: small discs leave the two open."""
    return np.sqrt(np.maximum(fits.axes_px[:, 0] ** 2 + 4.0 * (fits.blur_px**2 - blur_px**2), 0.0))


def face_on(fits: TemplateFits) -> Array:
    """Square (K,) of the radius that the discs would have if seen at no angle; as they are where pixels do not tell.

    Contrast times this is known where neither of them is: of discs so small that only what they take away is seen.
    """
    major, minor = fits.axes_px.T
    return np.asarray(major * np.where(like_points(fits), minor, major))


def like_points(fits: TemplateFits) -> Flags:
    """Fits (K,) at the bound of their axes: size and depth are each arbitrary."""
    return np.asarray(fits.axes_px[:, 1] < LEAST_AXIS_PX)
