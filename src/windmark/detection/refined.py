"""The template's part in `detect`: fit the candidates of SPOT, decide again with what the fits say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.detection.decide_fits import expected_noise, judge_fits
from windmark.detection.image import Prepared
from windmark.detection.options import FIT_SLACK, QUALITY_MIN, Options
from windmark.detection.rejected import ACCEPTED, SAME
from windmark.detection.rivals import rival_evidence
from windmark.detection.shape import CONTAMINATED, Shapes
from windmark.detection.spots import Spots, distinct, significance
from windmark.scene import Detections

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SIGMAS = 8.0  # of the matched filter, from which a spot is fitted
QUALITY_SHARE = 0.5  # of the least quality of `detect`: fainter spots are not fitted


def worth_fitting(value: Array, spots: Spots, found: Shapes, sure: Ints, options: Options) -> Ints:
    """Indices of the spots to be fitted, best first: the sure ones, then weaker ones at other places.

    A spot is worth it for its quality, or where no more is asked for than usual, for what its matched filter says.
    """
    weak = value >= QUALITY_SHARE * options.min_quality
    if options.min_quality <= QUALITY_MIN:
        regions = spots.misfit < spots.merit  # of what SPOT has measured only the quality is known
        weak |= regions & (significance(spots, found) >= SIGMAS)
    weak &= spots.misfit <= options.merit_max * FIT_SLACK
    weak[sure] = False
    rest = np.flatnonzero(weak)
    return np.concatenate([sure, rest[np.argsort(-value[rest], kind="stable")]])


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
    from windmark.detection.template.refine import fit_candidates, make_scene
    from windmark.detection.template.rim import rim_support

    usable = np.isfinite(prepared.g) if prepared.missing else None
    size = np.where(spots.misfit < spots.merit, found.axes[:, 0], found.radius)
    radius = np.clip(np.nan_to_num(size, nan=0.0), 0.75 * spots.r0, 1.3 * spots.r0)
    scene = make_scene(image, options.polarity, options.light, usable, None)
    if scene.lattice is not None:  # the spots' surface was measured with the means between its pixels
        spots = replace(spots, noise=spots.noise / np.sqrt(scene.lattice.scatter))
    fits, doubts = fit_candidates(scene, spots.xy, radius)
    noise = expected_noise(fits, spots)
    support = rim_support(scene, fits, noise.variance)
    weak = np.arange(len(fits)) >= taken
    # Whether it is a disc is asked of the surface's noise: fits to squares agree on a noise in which they are discs.
    reason = judge_fits(
        fits, spots, noise, support, weak, radii, options,
        lambda index: rival_evidence(scene, fits.take(index), spots.noise[index] ** 2),
    )  # fmt: skip
    good = np.flatnonzero(reason == ACCEPTED)
    once = np.sort(good[distinct(replace(spots.take(good), xy=fits.xy[good]))])
    reason[np.setdiff1d(good, once)] = SAME
    fits = doubts.cast(fits, once)
    return Detections(
        xy=fits.xy, cov=fits.cov, merit=spots.merit[once], radius_px=fits.radius_px, axes_px=fits.axes_px,
        angle=fits.angle, depth=fits.depth, flags=fits.flags | (found.flags[once] & CONTAMINATED),
    ), reason  # fmt: skip
