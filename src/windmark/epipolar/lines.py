"""Matching along epipolar lines from a few known matches, without camera parameters.

The paper's second way (AIAA 2005-5007, section VI.B): a few markers are matched by hand, which gives the fundamental
matrix, and then the remaining ones. Where on its line a spot is, its neighbours say that are matched already: the map
between the pictures is nearly affine over a small region.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

NEIGHBOURS = 6
"""Matched spots nearest to one, whose places predict its own."""
ALONG, SLACK_PX = 0.15, 2.0
"""A prediction is off along the line by this part of the distance to the nearest of them, and some pixels (a gate)."""
ALONE = 4.0
"""No other spot in the band may be within so many of these gates: a step in depth moves a marker along its line."""
WEIGHT = 0.05
"""The affine part of a prediction is believed as if a neighbour's place were off by this part of its distance."""


def match_along_lines(xy_a: ArrayLike, xy_b: ArrayLike, first: Ints, second: Ints, allowed: Mask) -> tuple[Ints, Ints]:
    """Matches that start from known ones and grow, the spot nearest to matched ones first.

    Parameters
    ----------
    xy_a, xy_b : (A, 2), (B, 2) spots of both pictures
    first, second : (K,) spots that are known to match, at least three
    allowed : (A, B) pairs that are within the band of each other's epipolar line

    Returns
    -------
    Indices (M,) of the matched spots of both pictures, the known ones among them. A spot with two candidates near its
    prediction, or whose candidate is as near to another spot's, is left out.
    """
    a, b = np.asarray(xy_a, dtype=float), np.asarray(xy_b, dtype=float)
    if len(first) < 3 or len(first) != len(second):
        raise ValueError(f"match_along_lines: expected at least three known matches, got {len(first)}, {len(second)}")
    match, back = np.full(len(a), -1, np.int64), np.full(len(b), -1, np.int64)
    match[first], back[second] = second, first
    while True:
        added = 0
        for spot in _nearest_first(a, match):
            other = _candidate(a, b, match, back, allowed, spot)
            if other >= 0 and _candidate(b, a, back, match, allowed.T, other) == spot:
                match[spot], back[other] = other, spot
                added += 1
        if not added:
            break
    known = np.flatnonzero(match >= 0)
    return known, match[known]


def _nearest_first(xy: Array, match: Ints) -> Ints:
    """Spots without a match, those nearest to matched ones first."""
    open_, known = np.flatnonzero(match < 0), np.flatnonzero(match >= 0)
    away = np.linalg.norm(xy[open_][:, None] - xy[known][None], axis=2).min(axis=1)
    return open_[np.argsort(away, kind="stable")]


def _candidate(a: Array, b: Array, match: Ints, back: Ints, allowed: Mask, spot: int) -> int:
    """The only spot of b near enough to the prediction, with no other one near; -1 for none."""
    place, reach = _prediction(a, b, match, spot)
    near = np.flatnonzero(allowed[spot] & ((back < 0) | (back == spot)))
    if not len(near):
        return -1
    off = np.linalg.norm(b[near] - place, axis=1)
    order = np.argsort(off, kind="stable")
    best = float(off[order[0]])
    if best > reach or (len(order) > 1 and off[order[1]] < ALONE * reach):
        return -1
    return int(near[order[0]])


def _prediction(a: Array, b: Array, match: Ints, spot: int) -> tuple[Array, float]:
    """Where the matched neighbours put a spot, and how far off that may be."""
    known = np.flatnonzero((match >= 0) & (np.arange(len(match)) != spot))
    away = np.linalg.norm(a[known] - a[spot], axis=1)
    order = np.argsort(away, kind="stable")[:NEIGHBOURS]
    near, far = known[order], np.maximum(away[order], 1.0)
    weight = 1 / far
    offset = a[near] - a[spot]
    design = np.column_stack([np.ones(len(near)), offset]) * weight[:, None]
    target = b[match[near]] * weight[:, None]
    # All known matches together say what the affine part is; the neighbours correct it.
    whole = np.linalg.lstsq(np.column_stack([np.ones(len(known)), a[known]]), b[match[known]], rcond=None)[0][1:]
    prior = 1 / WEIGHT / float(np.median(far))
    design = np.vstack([design, prior * np.eye(3)[1:] * WEIGHT * far.min()])
    target = np.vstack([target, prior * whole * WEIGHT * far.min()])
    place = np.linalg.lstsq(design, target, rcond=None)[0][0]
    return place, ALONG * float(far[0]) + SLACK_PX
