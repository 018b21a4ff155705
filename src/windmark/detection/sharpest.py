"""How sharp a picture's optic is, and what is sharper than it can be."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEEP, ENOUGH = 20.0, 100
"""Times the noise that a step of an edge is at least; so many of them tell the blur."""
SHARPEST_PX = 0.4
"""Blur (1 sigma) that is taken where a picture has no edges to tell it."""
EACH = 8
"""Steps of one column that are taken, so a line along it, of the sensor or of the picture, is not most of them."""
SAMPLE = 500_000
"""Pixels, in whole rows and columns evenly spread, of which edges are taken."""
SPREADS = (0.234, 0.351, 0.494, 0.653, 0.812, 0.962, 1.096, 1.313, 1.629)
BLURS_PX = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.5)
"""Lower quartile of what an edge changes on the pixels before and after its steepest step, in units of that, by the
blur: of a straight edge at all places between two pixels, means over square pixels."""


def sharpness_px(picture: NDArray[Any], noise: Any) -> float:
    """Blur (1 sigma, pixels) of a picture (H, W) by its steepest edges, which are those in focus, in the sharper of
    both directions, where each has enough; NaN where it is sharper than any optic makes it, as drawn, sharpened and
    interlaced pictures are.

    ``noise``: 1 sigma of a pixel, a number or (H, W). Of a lower quartile, so a part of the edges may be defects.
    """
    every = max(1, picture.size // SAMPLE)
    limit = np.broadcast_to(np.asarray(noise, np.float32), picture.shape)
    both = [_spread(a[::every], n[::every]) for a, n in ((picture, limit), (picture.T, limit.T))]
    if min(map(len, both)) < ENOUGH:
        both = [np.concatenate(both)]
    if len(both[0]) < ENOUGH:
        return SHARPEST_PX
    lower = min(float(np.quantile(spread, 0.25)) for spread in both)
    return float(np.interp(lower, SPREADS, BLURS_PX)) if lower >= SPREADS[0] else float("nan")


def _spread(picture: NDArray[Any], noise: Any) -> Array:
    """Of the local steepest steps along the rows: change just before and after them over their own."""
    step = np.diff(picture, axis=1)
    size = np.abs(step)
    middle = size[:, 1:-1]
    row, column = np.nonzero((middle > STEEP * noise[:, 1:-2]) & (middle >= size[:, :-2]) & (middle >= size[:, 2:]))
    order = np.argsort(column, kind="stable")
    first = np.searchsorted(column[order], column)
    many = -(-np.bincount(column, minlength=1)[column] // EACH)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    some = (rank - first) % many == 0
    row, column = row[some], column[some]
    before, here, after = (step[row, column + k].astype(float) for k in range(3))
    return np.asarray((before + after) / here)


def sharpest_line(blur_px: float) -> float:
    """Light beside a line of no width in the middle of its pixels, over that of these: none leaves less."""
    return (_below(1.5 / blur_px) - _below(0.5 / blur_px)) / (2 * _below(0.5 / blur_px) - 1)


def sharpest_pair(blur_px: float) -> float:
    """The same beside the two pixels between which a line of no width lies, and beside the four of a point."""
    return (_below(2 / blur_px) - _below(1 / blur_px)) / (_below(1 / blur_px) - 0.5)


def _below(z: float) -> float:
    """Part of a normal deviate below z."""
    return 0.5 * (1 + math.erf(z / math.sqrt(2)))
