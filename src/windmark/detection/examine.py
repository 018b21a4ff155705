"""One look at an image with given options: find, measure, decide, and say what was not taken and why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.decide import describe_spots, judge, rejected_places
from windmark.detection.image import Prepared, check_image, check_polarity, prepare
from windmark.detection.look import look_for
from windmark.detection.measured import lattice_of
from windmark.detection.options import FIT_SLACK, Options, check_radii
from windmark.detection.radius import prevailing
from windmark.detection.refined import refined, worth_fitting
from windmark.detection.rejected import ACCEPTED, FAINT, MISFIT, OTHER, PART, SURPLUS, UNCERTAIN, Rejected
from windmark.detection.search import MERIT_SLACK, Bowl
from windmark.detection.shape import ILL, TOUCHING, Shapes, covariance
from windmark.detection.spots import Spots, distinct, find_spots
from windmark.scene import Detections

Array = NDArray[np.float64]

TAKEN, SAME_SIZE, AS_DEEP = (0.1, 0.9), 1.25, 0.5
"""Quantiles of the radii of spots that are taken; how much smaller or larger others may be that are as large; part of
their middle depth from which on others are as deep.
"""


def examine(image: ArrayLike, options: Options, *, why: bool) -> tuple[Detections, Rejected, int]:
    """Find, measure, decide; ``why``: the rejected, too, which are only collected if asked for. And `_unlike`.

    `detect` and `explain` say what the options are and what comes back; of one polarity, which "auto" is not.
    """
    nothing = Detections.make(np.empty((0, 2))), Rejected.none(), 0
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
        result, verdict = _bowls(checked, prepared, spots.take(order), found.take(order))
    # What SPOT holds against a weak spot says more than that the template does not fit noise.
    reason[order] = np.where((verdict != ACCEPTED) & (reason[order] == FAINT), FAINT, verdict)
    order = order[verdict == ACCEPTED]
    reason[order[options.max_spots :] if options.max_spots is not None else []] = SURPLUS
    keep = np.arange(len(order))[: options.max_spots]
    result, r0 = result.take(keep), spots.r0[order[keep]]
    rejected = _rejected(prepared, options, radii, r0, result, spots, reason) if why else Rejected.none()
    return result, rejected, _unlike(found, reason, order[keep])


def _unlike(found: Shapes, reason: NDArray[np.int64], taken: NDArray[np.intp]) -> int:
    """Spots as deep and as large as those taken that are no discs: as many may be the markers themselves, domes or
    lit pits, and those taken the few of them that look like discs.
    """
    if not len(taken):
        return 0
    (low, high), deep = np.quantile(found.radius[taken], TAKEN), np.median(found.depth[taken])
    alike = (found.depth >= AS_DEEP * deep) & (found.radius > low / SAME_SIZE) & (found.radius < high * SAME_SIZE)
    return int((alike & np.isin(reason, (PART, OTHER, MISFIT))).sum())


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


def _bowls(
    picture: NDArray[np.generic], image: Prepared, spots: Spots, found: Shapes
) -> tuple[Detections, NDArray[np.int64]]:
    """Detections with the bowl's centres, and for each spot ACCEPTED or UNCERTAIN."""
    cov, lattice = _covariance(image, spots, found), lattice_of(picture)
    if lattice is not None:  # the scatter is that of means, too, and pixels that are means say nothing of their own
        cov /= lattice.scatter * lattice.share
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
