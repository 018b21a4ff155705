"""Which spots are markers, and what decided about the others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.detection.image import Prepared
from windmark.detection.options import Options
from windmark.detection.rejected import ACCEPTED, FAINT, FORMLESS, LARGE, SHALLOW, SHAPE, SMALL, Rejected
from windmark.detection.shape import COLUMNS, Shapes, shapes
from windmark.detection.spots import Spots, distinct, quality

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

RADIUS_RATIO = (0.7, 1.4)  # measured / reference radius


def describe_spots(image: Prepared, spots: Spots) -> Shapes:
    """Measure the spots, radius by radius."""
    from windmark.detection._kernels.shape import describe

    raw = np.empty((len(spots.xy), len(COLUMNS)))
    for r0 in np.unique(spots.r0):
        mine = spots.r0 == r0
        raw[mine] = describe(image.g, spots.xy[mine], float(r0), image.clip, image.sign)
    size = image.g.shape[1], image.g.shape[0]
    return shapes(raw, spots.xy, spots.r0, size, spots.noise)


def judge(spots: Spots, found: Shapes, options: Options) -> tuple[Array, Ints]:
    """Quality (K,) of the spots and what decides about each (K,): ACCEPTED or a code of `rejected.REASONS`.

    Where several things speak against a spot the one that says most is given: its size before its faintness.
    """
    value = quality(spots, found.depth, found.noise)
    ratio = found.radius / spots.r0
    longer = np.fmax(found.axes[:, 0] / spots.r0, ratio) if options.refine == "template" else ratio  # at an angle
    reason = np.full(len(value), ACCEPTED, dtype=np.int64)
    if options.min_depth is not None:
        reason[~(found.depth >= options.min_depth)] = SHALLOW
    reason[~(value >= options.min_quality)] = FAINT
    reason[spots.merit > options.merit_max] = SHAPE
    reason[ratio > RADIUS_RATIO[1]] = LARGE
    reason[longer < RADIUS_RATIO[0]] = SMALL
    reason[~np.isfinite(longer)] = FORMLESS
    return value, reason


def rejected_places(spots: Spots, found: Shapes, value: Array, reason: Ints, taken: Array, reach: Array) -> Rejected:
    """One row per place that is no marker: the candidate that came nearest to one there.

    A marker is also a bad spot of other reference radii, and its rim is a bad spot: what lies within 1.5 of the mean of
    its radius and theirs, of the accepted spots at `taken` (M, 2) with radii `reach` (M,), is not listed.
    """
    index = np.flatnonzero(reason != ACCEPTED)
    if len(taken) and len(index):
        away = np.hypot(*(spots.xy[index, None] - taken).transpose(2, 0, 1))
        index = index[(away >= 0.75 * (spots.r0[index, None] + reach)).all(axis=1)]
    index = index[distinct(spots.take(index))]
    order = index[np.argsort(-np.nan_to_num(value[index], nan=-np.inf), kind="stable")]
    return Rejected(
        spots.xy[order], found.radius[order], spots.merit[order], found.depth[order], value[order], reason[order]
    )
