"""The verb `detect`: markers in one image by SPOT (AIAA 2005-5007, section II)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import ArrayLike

from windmark.detection.either import find_markers
from windmark.detection.examine import examine
from windmark.detection.options import QUALITY_MIN, REFINEMENTS, Options
from windmark.detection.rejected import Rejected
from windmark.options.detection import MERIT_MAX, MIN_QUALITY, POLARITY, REFINE
from windmark.scene import Detections

__all__ = ["QUALITY_MIN", "REFINEMENTS", "detect", "explain"]


def detect(
    image: ArrayLike,
    *,
    radius_px: float | Sequence[float] | None = None,
    polarity: str = POLARITY.default,
    merit_max: float = MERIT_MAX.default,
    refine: str = REFINE.default,
    photometry: str | None = None,
    mask: ArrayLike | None = None,
    max_spots: int | None = None,
    min_depth: float | None = None,
    min_quality: float = MIN_QUALITY.default,
) -> Detections:
    """Find markers: discs that are darker (or brighter) than the surface round them.

    Each spot is a least-squares fit of an inverse top-hat (depth d, radius r0) on a sloping plane over the disc of
    radius 2 r0. Its merit m is the norm of what is left over by the norm of the hole: 0 is a perfect hole, 1 one as big
    as its error. The centre is the vertex of a quadratic fitted to the "bowl" of the merit round its minimum, taken
    again round the new centre until it stays.

    Parameters
    ----------
    image : (H, W) grey levels, any real type; pixels that are not finite are left out
    radius_px : radius r0 of the markers in pixels, at least 1; or several radii, of which the best wins at each spot.
        One radius finds discs of about 0.8 ... 1.2 r0; rather take it a little too large than too small (paper, II.C).
        None takes what `estimate_radius` says; an image in which no size prevails has no spots
    polarity : "dark" or "bright" markers on their surface; "auto" takes bright ones where fewer than three dark ones
        are there, see `find_markers`, which also says what was decided
    merit_max : largest merit of a spot; the paper's 0.7 is a correlation of 0.778 with the top-hat. For the template
        the top-hat is taken as the surface's tilt shows it, and what noise adds does not count
    refine : "template", a fit of the blurred ellipse to every candidate of `look` (`template.refine_template`), also to
        those whose quality is down to half of `min_quality` and those whose matched filter rises by 8 sigma; the fit
        decides: see `decide_fits`. Or "bowl", the paper's centre and decision
    photometry : of the template, "multiplicative" where paint scales the light (black must be 0) or "additive"
        (infrared); None takes the first for dark markers, the second for bright ones and for images with negative light
    mask : (H, W), only pixels where it is true (not 0) are used; a marker needs 85 % of its disc in them
    max_spots : keep only so many, the best
    min_depth : smallest depth in grey levels; None leaves it to `min_quality`
    min_quality : smallest depth / noise / merit. The noise is the scatter of one pixel of the surface round the spot,
        and not below that of its neighbourhood. The worse the shape, the more a spot must stand out: m = 0.7 needs
        8.4 times the noise, m = 0.35 half of that; below r0 = 3 px fewer pixels vouch for it and the ratio counts
        sqrt(r0 / 3). White noise alone gives m = 2 noise / depth: in a bowl the default passes perfect discs down to
        depth / noise = 5. The template passes fainter ones whose matched filter has 10 sigma of the frame's noise
        (8, like the others, where these show that it is white), unless more than the default is asked for

    Returns
    -------
    Detections
        Best first (largest quality, see `min_quality`, times radius for the template). `xy` is the centre of the imaged
        ellipse, not the image of the disc's centre (`geometry.imaged_ellipse` tells the difference). A constant image,
        or one smaller than the marker, has no spots; `why_none` says why. Pixels that stand out alone are taken as
        dead.

        template: `cov` is the bound of least squares in the frame's own noise, texture included; `axes_px` are those of
        the disc without blur, `depth` is that of its middle. Flags: border, saturated (over 2 % of the window; integer
        images only), contaminated (residuals that are not the frame's noise, or pixels of the disc are missing),
        touching (another marker reaches into the window and its pixels are left out), ill-conditioned (size or blur at
        the bound of what pixels can show).

        bowl: `cov` is white noise of the measured scatter propagated through the bowl, plus the bowl's pixel-lattice
        error (0.025 / r0 px per axis); correlated texture and uneven light are not in it. `radius_px` and `axes_px` are
        measured (area = volume / depth at the core, blur-free anisotropy), `depth` is the contrast at the core. Flags:
        contaminated (dead pixels, or over 10 % of the ring stands out), ill-conditioned (the bowl did not settle).

    Raises
    ------
    ValueError
        An image that is not (H, W) real numbers, a radius below 1, an unknown polarity or refinement.

    Examples
    --------
    >>> import windmark as wm
    >>> test = wm.synth.wind_tunnel(1, size_px=(640, 512), nodes=2000, clutter=None)
    >>> shot = test.shot("wind-off")
    >>> spots = wm.detect(shot.image, radius_px=2.0)
    >>> len(spots) > 20, spots.xy.shape[1]
    (True, 2)
    """
    if polarity == "auto":
        look = find_markers(
            image, radius_px=radius_px, merit_max=merit_max, refine=refine, photometry=photometry, mask=mask,
            max_spots=max_spots, min_depth=min_depth, min_quality=min_quality,
        )  # fmt: skip
        return look.detections
    options = Options(radius_px, polarity, merit_max, refine, photometry, mask, max_spots, min_depth, min_quality)
    return examine(image, options, why=False)[0]


def explain(image: ArrayLike, **options: Any) -> tuple[Detections, Rejected]:
    """What `detect` finds with the same options, and what it looked at but did not take, each with the reason.

    Candidates whose merit is up to 0.5 above `merit_max` are listed, one per place; what is next to an accepted marker
    is not (its rim and the other reference radii are no news).

    Parameters
    ----------
    image, **options : see `detect`

    Returns
    -------
    found, rejected : `found` is exactly what `detect` returns
    """
    if options.get("polarity") == "auto":
        look = find_markers(image, rejected=True, **options)
        return look.detections, look.rejected or Rejected.none()
    return examine(image, Options(**options), why=True)[:2]
