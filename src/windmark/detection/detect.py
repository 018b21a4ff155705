"""The verb `detect`: markers in one image by SPOT (AIAA 2005-5007, section II)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.decide import describe_spots, judge, rejected_places
from windmark.detection.image import Prepared, check_image, check_polarity, prepare
from windmark.detection.look import look_for
from windmark.detection.options import FIT_SLACK, QUALITY_MIN, REFINEMENTS, Options, check_radii
from windmark.detection.radius import prevailing
from windmark.detection.refined import refined, worth_fitting
from windmark.detection.rejected import ACCEPTED, FAINT, SURPLUS, UNCERTAIN, Rejected
from windmark.detection.search import MERIT_SLACK, Bowl
from windmark.detection.shape import ILL, TOUCHING, Shapes, covariance
from windmark.detection.spots import Spots, distinct, find_spots
from windmark.options.detection import MERIT_MAX, MIN_QUALITY, POLARITY, REFINE
from windmark.scene import Detections

__all__ = ["QUALITY_MIN", "REFINEMENTS", "detect", "explain"]

Array = NDArray[np.float64]


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
        from windmark.detection.either import find_markers  # which calls this function

        look = find_markers(
            image, radius_px=radius_px, merit_max=merit_max, refine=refine, photometry=photometry, mask=mask,
            max_spots=max_spots, min_depth=min_depth, min_quality=min_quality,
        )  # fmt: skip
        return look.detections
    options = Options(radius_px, polarity, merit_max, refine, photometry, mask, max_spots, min_depth, min_quality)
    return _examine(image, options, why=False)[0]


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
        from windmark.detection.either import find_markers  # which calls this function

        look = find_markers(image, rejected=True, **options)
        return look.detections, look.rejected or Rejected.none()
    return _examine(image, Options(**options), why=True)


def _examine(image: ArrayLike, options: Options, *, why: bool) -> tuple[Detections, Rejected]:
    """Find, measure, decide; the rejected are only collected if asked for."""
    nothing = Detections.make(np.empty((0, 2))), Rejected.none()
    checked = check_image(image)
    prepared = prepare(checked, check_polarity(options.polarity), options.mask) if min(checked.shape) >= 3 else None
    if prepared is None:
        return nothing
    radii = prevailing(prepared).radii_px if options.radius_px is None else check_radii(options.radius_px)
    if not len(radii):
        return nothing
    options = options.in_light_of(checked)
    template = options.refine == "template"
    limit = options.merit_max * (FIT_SLACK if template else 1.0)
    if template:
        spots, found = look_for(prepared, radii, limit)
    else:
        spots = Spots.join([find_spots(prepared, r, limit) for r in radii])
        found = describe_spots(prepared, spots)
    value, reason = judge(spots, found, options)
    chosen = np.flatnonzero(reason == ACCEPTED)
    if not template:
        chosen = chosen[distinct(spots.take(chosen))]
    rank = value * found.radius if template else value  # of two as clear the larger one is the surer
    order = chosen[np.argsort(-rank[chosen], kind="stable")]
    if template:
        taken = len(order)
        order = worth_fitting(value, spots, found, order, options)
        result, verdict = refined(checked, prepared, spots.take(order), found.take(order), radii, taken, options)
    else:
        result, verdict = _bowls(prepared, spots.take(order), found.take(order))
    # What SPOT holds against a weak spot says more than that the template does not fit noise.
    reason[order] = np.where((verdict != ACCEPTED) & (reason[order] == FAINT), FAINT, verdict)
    order = order[verdict == ACCEPTED]
    reason[order[options.max_spots :] if options.max_spots is not None else []] = SURPLUS
    keep = np.arange(len(order))[: options.max_spots]
    result, r0 = result.take(keep), spots.r0[order[keep]]
    return result, _rejected(prepared, options, radii, r0, result, spots, reason) if why else Rejected.none()


def _rejected(
    image: Prepared, options: Options, radii: Sequence[float], r0: Array, result: Detections, spots: Spots, reason: Any
) -> Rejected:
    """The spots that were not taken, and candidates beyond the limit of the merit."""
    near = np.flatnonzero(reason != ACCEPTED)
    far = Spots.join([find_spots(image, r, options.merit_max + MERIT_SLACK) for r in radii])
    every = Spots.join([spots.take(near), far.take(far.merit > options.merit_max)])
    found = describe_spots(image, every)
    value, why = judge(every, found, options)
    why[: len(near)] = reason[near]
    return rejected_places(every, found, value, why, result.xy, np.fmax(result.radius_px, r0))


def _bowls(image: Prepared, spots: Spots, found: Shapes) -> tuple[Detections, NDArray[np.int64]]:
    """Detections with the bowl's centres, and for each spot ACCEPTED or UNCERTAIN."""
    cov = _covariance(image, spots, found)
    sure = np.asarray(np.isfinite(cov).all(axis=(1, 2)))
    return _detections(spots.take(sure), found.take(sure), cov[sure]), np.where(sure, ACCEPTED, UNCERTAIN)


def _covariance(image: Prepared, spots: Spots, found: Shapes) -> Array:
    """Covariance of the centres, radius by radius."""
    from windmark.detection._kernels.shape import centre_covariances

    unit = np.empty((len(spots.xy), 3))
    for r0 in np.unique(spots.r0):
        mine, bowl = spots.r0 == r0, Bowl.of_radius(float(r0))
        unit[mine] = centre_covariances(image.g, spots.xy[mine], float(r0), bowl.positions, bowl.functionals)
    return covariance(unit, found.scatter, spots.r0, image.quantum)


def _detections(spots: Spots, found: Shapes, cov: Array) -> Detections:
    """The chosen spots and the flags that need the neighbours."""
    flags = found.flags | np.where(spots.settled, 0, ILL)
    if len(flags) > 1:
        from scipy.spatial import cKDTree

        pairs = cKDTree(spots.xy).query_pairs(2.0 * spots.r0.max() + found.radius.max(), output_type="ndarray")
        for i, j in (pairs.T, pairs.T[::-1]):
            distance = np.hypot(*(spots.xy[i] - spots.xy[j]).T)
            flags[i[distance < 2.0 * spots.r0[i] + found.radius[j]]] |= TOUCHING
    return Detections(
        xy=spots.xy,
        cov=cov,
        merit=spots.merit,
        radius_px=found.radius,
        axes_px=found.axes,
        angle=found.angle,
        depth=found.depth,
        flags=flags,
    )
