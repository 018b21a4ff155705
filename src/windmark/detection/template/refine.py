"""Template refinement: centres of markers at the Cramer-Rao bound.

The image of a small disc is an ellipse, blurred and seen through square pixels, on light that is not even
(`disc_model`). All ten unknowns of a marker are fitted to its window by least squares. What a single marker cannot
know well is taken from the frame: the blur (small or faint discs confuse size, blur and depth) and the noise (its
strength decides what is a contamination; its correlation decides how far a centre can be trusted).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.image import check_image, check_mask, check_polarity
from windmark.detection.measured import lattice_of
from windmark.detection.template.disc_model import check_photometry
from windmark.detection.template.doubt import Doubts
from windmark.detection.template.frame import fit_at_first, fit_markers
from windmark.detection.template.learn import BLUR_SPREAD, BLUR_START, LEAST_SPREAD, frame_blur, learn_frame
from windmark.detection.template.noise import FrameNoise
from windmark.detection.template.request import Request, Scene
from windmark.detection.template.result import Frame, TemplateFits
from windmark.errors import UsageError
from windmark.options.detection import POLARITY
from windmark.scene.levels import saturation_level

__all__ = ["Frame", "FrameNoise", "TemplateFits", "frame_blur", "refine_template"]

Array = NDArray[np.float64]

LEAST_AXIS = 0.5  # px; smaller discs only show their blur


def refine_template(
    image: ArrayLike,
    xy: ArrayLike,
    radius_px: ArrayLike,
    *,
    polarity: str = POLARITY.default,
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
        48 speak for the frame
    radius_px : (M,) or one number: radius of the discs, good to about 30 %
    polarity : "dark" or "bright" markers
    photometry : "multiplicative" where paint scales the light that falls on it (black must be 0), "additive"
        where a marker adds a constant (infrared)
    blur_px : blur of the frame, or blur and its spread; None finds both from the clean markers
    noise : noise of the frame; None finds it from the clean markers
    mask : (H, W), only pixels where it is true are used
    saturation : grey level from which on a pixel is left out, unless most of a window is; None takes the level at which
        the picture itself ends, see `windmark.scene.levels.saturation_level`
    robust : contaminated markers are fitted again: with a line across them if there is one, else with Tukey's weights
        for the frame's noise

    Returns
    -------
    TemplateFits
        In white noise the centres reach the bound of `crlb.centre_bound` and `cov` is theirs; on textured paint `cov`
        holds for the texture that the residuals show; of contaminated markers it is not below what the centre owes to
        a quarter of the window (`doubt`). Flags: border (the ellipse is cut by the image's edge), saturated (over 2 %
        of the window), contaminated (the residuals are not the frame's noise, or pixels of the disc are missing),
        touching (another marker reaches into the window; its pixels are left out, or both are fitted together),
        ill-conditioned (not converged, size or blur at the bound of what pixels can show, or no disc to be seen).

    Raises
    ------
    ValueError
        An image that is not (H, W) real numbers, positions or radii of the wrong shape, an unknown option.
    """
    scene = make_scene(image, polarity, photometry, mask, saturation)
    places, radius = check_places(xy, radius_px)
    frame = Frame(*known_blur(blur_px), noise)
    request = fresh_request(places, radius, frame)
    if len(places) and (blur_px is None or noise is None):
        learnt, request = learn_frame(scene, request, blur=blur_px is None, noise=noise is None)
        frame = Frame(learnt.blur_px, learnt.blur_spread_px, learnt.noise if noise is None else noise)
    return fit_markers(scene, request, frame, robust=robust)


def fit_candidates(scene: Scene, xy: Array, radius: Array) -> tuple[TemplateFits, Doubts]:
    """`refine_template` of markers (M,), with the covariances of contaminated ones left to the doubts."""
    frame = Frame(*known_blur(None), None)
    request = fresh_request(xy, radius, frame)
    if len(xy):
        frame, request = learn_frame(scene, request, blur=True, noise=True)
    return fit_at_first(scene, request, frame, robust=True, choosy=True)


def make_scene(
    image: ArrayLike, polarity: str, photometry: str, mask: ArrayLike | None, saturation: float | None
) -> Scene:
    """What the fits of one image have in common, checked."""
    sign, multiplicative, grey = check_polarity(polarity), check_photometry(photometry), check_image(image)
    if saturation is None:
        saturation = saturation_level(grey)
    if not saturation > -np.inf:
        raise UsageError(f"saturation must be a grey level or None, got {saturation!r}")
    usable = check_mask(mask, grey.shape)
    return Scene(grey, usable, sign, float(saturation), multiplicative, lattice_of(grey))


def check_places(xy: ArrayLike, radius_px: ArrayLike) -> tuple[Array, Array]:
    """Positions (M, 2) and radii (M,), checked."""
    places, radius = np.asarray(xy, dtype=float), np.asarray(radius_px, dtype=float)
    if places.size == 0:
        places = places.reshape(0, 2)
    if places.ndim != 2 or places.shape[1] != 2 or not np.isfinite(places).all():
        raise ValueError(f"xy must be (M, 2) finite positions in pixels, got shape {places.shape}")
    if radius.shape not in ((), (len(places),)) or not (np.isfinite(radius).all() and (radius > 0).all()):
        raise UsageError(f"radius_px must be one positive number or {len(places)} of them, got {radius_px!r}")
    return places, np.array(np.broadcast_to(radius, len(places)))


def known_blur(blur_px: float | tuple[float, float] | None) -> tuple[float, float]:
    """Blur and its spread."""
    if blur_px is None:
        return BLUR_START, BLUR_SPREAD
    blur, spread = blur_px if isinstance(blur_px, tuple) else (float(blur_px), LEAST_SPREAD)
    if not (0 < blur < np.inf and 0 < spread < np.inf):
        raise UsageError(f"blur_px must be None, a blur or (blur, spread), all positive, got {blur_px!r}")
    return float(blur), float(spread)


def fresh_request(places: Array, radius: Array, frame: Frame) -> Request:
    """Markers to be fitted of which nothing else is known."""
    count = len(places)
    blur, spread = np.full(count, frame.blur_px), np.full(count, frame.blur_spread_px)
    return Request(places, radius, blur, spread, None, np.full(count, np.inf), np.full((count, 10), np.nan))
