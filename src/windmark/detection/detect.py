"""The verb `detect`: markers in one image by SPOT (AIAA 2005-5007, section II)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.image import Prepared, check_image, check_polarity, prepare
from windmark.detection.search import Bowl
from windmark.detection.shape import COLUMNS, ILL, TOUCHING, Shapes, covariance, shapes
from windmark.detection.spots import Spots, distinct, find_spots, quality
from windmark.scene import Detections

Array = NDArray[np.float64]

REFINEMENTS = ("bowl",)
QUALITY_MIN = 12.0  # see `detect`
RADIUS_RATIO = (0.7, 1.4)  # measured / reference radius


def detect(
    image: ArrayLike,
    *,
    radius_px: float | Sequence[float],
    polarity: str = "dark",
    merit_max: float = 0.7,
    refine: str = "bowl",
    max_spots: int | None = None,
    min_depth: float | None = None,
    min_quality: float = QUALITY_MIN,
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
        One radius finds discs of about 0.8 ... 1.2 r0; rather take it a little too large than too small (paper, II.C)
    polarity : "dark" or "bright" markers on their surface
    merit_max : largest merit of a spot; the paper's 0.7 is a correlation of 0.778 with the top-hat
    refine : "bowl", the paper's centre
    max_spots : keep only so many, the best
    min_depth : smallest depth in grey levels; None leaves it to `min_quality`
    min_quality : smallest depth / noise / merit. The noise is the scatter of one pixel of the surface round the spot,
        and not below that of its neighbourhood. The worse the shape, the more a spot must stand out: m = 0.7 needs
        8.4 times the noise, m = 0.35 half of that; below r0 = 3 px fewer pixels vouch for it and the ratio counts
        sqrt(r0 / 3). White noise alone gives m = 2 noise / depth: the default passes perfect discs down to
        depth / noise = 5

    Returns
    -------
    Detections
        Best first (largest quality, see `min_quality`). `xy` is the centre of the imaged ellipse; `cov` is white
        noise of the measured scatter propagated through the bowl, plus the bowl's pixel-lattice error (0.025 / r0 px
        per axis); correlated texture and uneven light are not in it. `radius_px` and `axes_px` are measured (area =
        volume / depth at the core, blur-free anisotropy), `depth` is the contrast at the core. Flags: border (cut by
        the image's edge), saturated (over 2 % of the window; integer images only), contaminated (dead pixels, or over
        10 % of the ring stands out), touching (another spot reaches into the window), ill-conditioned (the bowl did
        not settle). A constant image, or one smaller than the marker, has no spots.

    Raises
    ------
    ValueError
        An image that is not (H, W) real numbers, a radius below 1, an unknown polarity or refinement.
    """
    sign = check_polarity(polarity)
    radii = _check_options(radius_px, merit_max, refine, max_spots, min_depth, min_quality)
    checked = check_image(image)
    prepared = prepare(checked, sign) if min(checked.shape) >= 3 else None
    if prepared is None:
        return Detections.make(np.empty((0, 2)))
    spots = Spots.join([find_spots(prepared, r, merit_max) for r in radii])
    found = _describe(prepared, spots)
    value, ratio = quality(spots, found.depth, found.noise), found.radius / spots.r0
    good = (value >= min_quality) & (ratio >= RADIUS_RATIO[0]) & (ratio <= RADIUS_RATIO[1])
    if min_depth is not None:
        good &= found.depth >= min_depth
    chosen = np.flatnonzero(good)
    chosen = chosen[distinct(spots.take(chosen))]
    order = chosen[np.argsort(-value[chosen], kind="stable")][:max_spots]
    return _detections(prepared, spots.take(order), found.take(order))


def _check_options(
    radius_px: float | Sequence[float],
    merit_max: float,
    refine: str,
    max_spots: int | None,
    min_depth: float | None,
    min_quality: float,
) -> list[float]:
    """The radii, largest last, after all options have been looked at."""
    try:
        radii = np.unique(np.asarray(radius_px, dtype=float).ravel())
    except (TypeError, ValueError):
        radii = np.empty(0)
    if radii.size == 0 or not (np.isfinite(radii).all() and radii[0] >= 1.0):
        raise ValueError(f"radius_px must be one radius or several, each at least 1 px, got {radius_px!r}")
    if not (np.isfinite(merit_max) and merit_max > 0):
        raise ValueError(f"merit_max must be a positive number, got {merit_max!r}")
    if refine not in REFINEMENTS:
        raise ValueError(f"refine must be one of {', '.join(REFINEMENTS)}, got {refine!r}")
    if max_spots is not None and not (max_spots >= 0 and int(max_spots) == max_spots):
        raise ValueError(f"max_spots must be None or a whole number from 0, got {max_spots!r}")
    if min_depth is not None and not np.isfinite(min_depth):
        raise ValueError(f"min_depth must be None or a number of grey levels, got {min_depth!r}")
    if not (np.isfinite(min_quality) and min_quality >= 0):
        raise ValueError(f"min_quality must be a number from 0, got {min_quality!r}")
    return [float(r) for r in radii]


def _describe(image: Prepared, spots: Spots) -> Shapes:
    """Measure the spots, radius by radius."""
    from windmark.detection._kernels_shape import describe

    raw = np.empty((len(spots.xy), len(COLUMNS)))
    for r0 in np.unique(spots.r0):
        mine = spots.r0 == r0
        raw[mine] = describe(image.g, spots.xy[mine], float(r0), image.clip, image.sign)
    size = image.g.shape[1], image.g.shape[0]
    return shapes(raw, spots.xy, spots.r0, size, spots.noise)


def _covariance(image: Prepared, spots: Spots, found: Shapes) -> Array:
    """Covariance of the centres, radius by radius."""
    from windmark.detection._kernels_shape import centre_covariances

    unit = np.empty((len(spots.xy), 3))
    for r0 in np.unique(spots.r0):
        mine, bowl = spots.r0 == r0, Bowl.of_radius(float(r0))
        unit[mine] = centre_covariances(image.g, spots.xy[mine], float(r0), bowl.positions, bowl.functionals)
    return covariance(unit, found.scatter, spots.r0, image.quantum)


def _detections(image: Prepared, spots: Spots, found: Shapes) -> Detections:
    """The chosen spots with their covariance and the flags that need the neighbours."""
    cov = _covariance(image, spots, found)
    sure = np.asarray(np.isfinite(cov).all(axis=(1, 2)))
    spots, found, cov = spots.take(sure), found.take(sure), cov[sure]
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
