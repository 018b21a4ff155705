"""Template refinement: centres of markers at the Cramer-Rao bound.

The image of a small disc is an ellipse, blurred and seen through square pixels, on light that is not even
(`disc_model`). All ten unknowns of a marker are fitted to its window by least squares. What a single marker cannot
know well
is taken from the frame: the blur (small or faint discs confuse size, blur and depth) and the noise (its strength
decides
what is a contamination; its correlation decides how far a centre can be trusted).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.disc_model import check_photometry, shape_matrix
from windmark.detection.image import check_image, check_mask, check_polarity
from windmark.detection.template_fit import Request, Scene
from windmark.detection.template_frame import (
    BLUR_SPREAD,
    BLUR_START,
    LEAST_SPREAD,
    fit_markers,
    frame_blur,
    learn_frame,
)
from windmark.detection.template_noise import FrameNoise
from windmark.detection.template_result import Frame, TemplateFits
from windmark.detection.template_search import search

__all__ = ["Frame", "FrameNoise", "TemplateFits", "frame_blur", "refine_template", "track_template"]

Array = NDArray[np.float64]

LEAST_AXIS = 0.5  # px; smaller discs only show their blur


def refine_template(
    image: ArrayLike,
    xy: ArrayLike,
    radius_px: ArrayLike,
    *,
    polarity: str = "dark",
    photometry: str = "multiplicative",
    blur_px: float | tuple[float, float] | None = None,
    noise: FrameNoise | None = None,
    mask: ArrayLike | None = None,
    saturation: float | None = None,
    robust: bool = True,
) -> TemplateFits:
    """Fit the template to all markers of an image.

    Parameters
    ----------
    image : (H, W) grey levels, any real type, linear in light; pixels that are not finite are left out
    xy : (M, 2) centres to start from, good to about half a radius; best first, as `detect` gives them: the first
        48 speak
        for the frame
    radius_px : (M,) or one number: radius of the discs, good to about 30 %
    polarity : "dark" or "bright" markers
    photometry : "multiplicative" where paint scales the light that falls on it (black must be 0), "additive"
        where a marker
        adds a constant (infrared)
    blur_px : blur of the frame, or blur and its spread; None finds both from the clean markers
    noise : noise of the frame; None finds it from the clean markers
    mask : (H, W), only pixels where it is true are used
    saturation : grey level from which on a pixel is left out; None takes the largest number of an integer type
    robust : contaminated markers are fitted again with Tukey's weights for the frame's noise

    Returns
    -------
    TemplateFits
        In white noise the centres reach the bound of `crlb.centre_bound` and `cov` is theirs; on textured paint `cov`
        holds
        for the texture that the residuals show. Flags: border (the ellipse is cut by the image's edge), saturated (over
        2 % of the window), contaminated (the residuals are not the frame's noise, or pixels of the disc are missing),
        touching (another marker reaches into the window; its pixels are left out), ill-conditioned (not converged, or
        size
        or blur at the bound of what pixels can show).

    Raises
    ------
    ValueError
        An image that is not (H, W) real numbers, positions or radii of the wrong shape, an unknown option.
    """
    scene = _scene(image, polarity, photometry, mask, saturation)
    places, radius = _places(xy, radius_px)
    frame = Frame(*_known_blur(blur_px), noise)
    request = _request(places, radius, frame)
    if len(places) and (blur_px is None or noise is None):
        learnt, request = learn_frame(scene, request, blur=blur_px is None, noise=noise is None)
        frame = Frame(learnt.blur_px, learnt.blur_spread_px, learnt.noise if noise is None else noise)
    return fit_markers(scene, request, frame, robust=robust)


def track_template(
    image: ArrayLike,
    xy: ArrayLike,
    axes_px: ArrayLike,
    angle: ArrayLike = 0.0,
    *,
    blur_px: float | tuple[float, float],
    noise: FrameNoise | None = None,
    search_px: int = 3,
    polarity: str = "dark",
    photometry: str = "multiplicative",
    mask: ArrayLike | None = None,
    saturation: float | None = None,
    robust: bool = True,
) -> TemplateFits:
    """Find and fit markers of known size and shape near predicted places: the fast path of tracking.

    All places within `search_px` of the prediction are tried and the best correlated one is taken (a descent misses one
    marker in four when the prediction is 2.5 px off). Then centre, depth, background and slope are fitted, the shape
    held:
    six unknowns, which also finds markers too faint to show their shape.

    Parameters
    ----------
    image, polarity, photometry, mask, saturation, robust : see `refine_template`
    xy : (M, 2) predicted centres
    axes_px, angle : (M, 2), (M,) predicted ellipses (camera, normal and radius give them), or (2,) and a number for all
    blur_px : blur of the frame (`Frame.blur_px` of a frame before)
    noise : noise of the frame (`Frame.noise`); without it contaminated markers are not noticed
    search_px : half width of the square that is searched, whole pixels

    Returns
    -------
    TemplateFits
        Shape and blur as given. A marker that is not there has a low `correlation` and `depth`: with correlation rho
        over N
        pixels, depth is rho sqrt(N) / sqrt(1 - rho^2) of its standard deviations.
    """
    scene = _scene(image, polarity, photometry, mask, saturation)
    count = len(np.asarray(xy, dtype=float).reshape(-1, 2))
    axes = np.array(np.broadcast_to(np.asarray(axes_px, dtype=float), (count, 2)))
    if not (np.isfinite(axes).all() and (axes >= LEAST_AXIS).all()):
        raise ValueError(f"axes_px must be half axes of at least {LEAST_AXIS} px, (M, 2) or (2,), got {axes_px!r}")
    if not (0 <= search_px <= 64 and int(search_px) == search_px):
        raise ValueError(f"search_px must be a whole number from 0 to 64, got {search_px!r}")
    places, radius = _places(xy, axes.max(axis=1))
    frame = Frame(*_known_blur(blur_px), noise)
    shape = shape_matrix(axes, np.broadcast_to(np.asarray(angle, dtype=float), count))
    request = replace(
        _request(places, radius, frame), shape=np.column_stack([shape[:, 0, 0], shape[:, 0, 1], shape[:, 1, 1]])
    )
    return fit_markers(scene, search(scene, request, int(search_px)), frame, robust=robust)


def _scene(image: ArrayLike, polarity: str, photometry: str, mask: ArrayLike | None, saturation: float | None) -> Scene:
    sign, multiplicative, grey = check_polarity(polarity), check_photometry(photometry), check_image(image)
    if saturation is None:
        saturation = float(np.iinfo(grey.dtype.name).max) if grey.dtype.kind in "iu" else np.inf
    if not saturation > -np.inf:
        raise ValueError(f"saturation must be a grey level or None, got {saturation!r}")
    return Scene(grey, check_mask(mask, grey.shape), sign, float(saturation), multiplicative)


def _places(xy: ArrayLike, radius_px: ArrayLike) -> tuple[Array, Array]:
    places, radius = np.asarray(xy, dtype=float), np.asarray(radius_px, dtype=float)
    if places.size == 0:
        places = places.reshape(0, 2)
    if places.ndim != 2 or places.shape[1] != 2 or not np.isfinite(places).all():
        raise ValueError(f"xy must be (M, 2) finite positions in pixels, got shape {places.shape}")
    if radius.shape not in ((), (len(places),)) or not (np.isfinite(radius).all() and (radius > 0).all()):
        raise ValueError(f"radius_px must be one positive number or {len(places)} of them, got {radius_px!r}")
    return places, np.array(np.broadcast_to(radius, len(places)))


def _known_blur(blur_px: float | tuple[float, float] | None) -> tuple[float, float]:
    if blur_px is None:
        return BLUR_START, BLUR_SPREAD
    blur, spread = blur_px if isinstance(blur_px, tuple) else (float(blur_px), LEAST_SPREAD)
    if not (0 < blur < np.inf and 0 < spread < np.inf):
        raise ValueError(f"blur_px must be None, a blur or (blur, spread), all positive, got {blur_px!r}")
    return float(blur), float(spread)


def _request(places: Array, radius: Array, frame: Frame) -> Request:
    count = len(places)
    blur, spread = np.full(count, frame.blur_px), np.full(count, frame.blur_spread_px)
    return Request(places, radius, blur, spread, None, np.full(count, np.inf), np.full((count, 10), np.nan))
