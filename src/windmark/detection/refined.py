"""The template's part in `detect`: fit the candidates of SPOT, decide again with what the fits say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.detection.decide_fits import expected_variance, judge_fits
from windmark.detection.image import Prepared
from windmark.detection.options import Options
from windmark.detection.rejected import ACCEPTED, SAME
from windmark.detection.shape import CONTAMINATED, Shapes
from windmark.detection.spots import Spots, distinct
from windmark.scene import Detections

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

FIT_SLACK = 1.43  # times the limit of the merit: a tilted or dirty disc may suit no trial radius, so the fit decides
QUALITY_SHARE = 0.5  # of the least quality of `detect`: fainter spots are not fitted


def worth_fitting(value: Array, spots: Spots, bowl: Ints, options: Options) -> Ints:
    """Indices of the spots to be fitted, best first: those that SPOT takes, then weaker ones at other places."""
    weak = (value >= QUALITY_SHARE * options.min_quality) & (spots.merit <= options.merit_max * FIT_SLACK)
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
    from windmark.detection.template.refine import make_scene, refine_template
    from windmark.detection.template.rim import rim_support

    usable = np.isfinite(prepared.g) if prepared.missing else None
    radius = np.clip(np.nan_to_num(found.radius, nan=0.0), 0.75 * spots.r0, 1.3 * spots.r0)
    fits = refine_template(
        image, spots.xy, radius, polarity=options.polarity, photometry=options.light, mask=usable
    )  # fmt: skip
    scene = make_scene(image, options.polarity, options.light, usable, None)
    support = rim_support(scene, fits, expected_variance(fits, spots))
    weak = np.arange(len(fits)) >= taken
    reason = judge_fits(fits, spots, support, weak, radii, options)
    good = np.flatnonzero(reason == ACCEPTED)
    once = np.sort(good[distinct(replace(spots.take(good), xy=fits.xy[good]))])
    reason[np.setdiff1d(good, once)] = SAME
    fits = fits.take(once)
    return Detections(
        xy=fits.xy, cov=fits.cov, merit=spots.merit[once], radius_px=fits.radius_px, axes_px=fits.axes_px,
        angle=fits.angle, depth=fits.depth, flags=fits.flags | (found.flags[once] & CONTAMINATED),
    ), reason  # fmt: skip
