"""Fill values of pictures of floats: numbers that stand for "no value", as -9999 in a hole, where NaN should."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

REPEATED = 4
"""Fewer pixels of exactly one value are no fill value but pixels that went wrong."""
BELOW, ABOVE = 10.0, 100.0
"""So many times the lowest, or the highest, of all other values: no surface has both in one picture. Above it takes
more, as a lamp is brighter than all else."""
APART = 0.1
"""Part of the range of all other values that the lowest one is below them: what a dark picture was taken off from has
-1 beside 0."""


def fill_values(picture: NDArray[np.generic]) -> list[float]:
    """The fill values of a picture (H, W) of floats, at most the lowest and the highest value that it has.

    A value that several pixels have exactly, and that all others are far from: negative and far below where no other is
    negative, or many times beyond all of them. Zero is none: it is what no light gives. Pictures of whole numbers have
    none: what they cannot hold was cut off.
    """
    values = np.asarray(picture)
    if values.dtype.kind != "f":
        return []
    values = values[np.isfinite(values)]
    out = []
    if values.size and (low := values.min()) < 0:
        rest = values[values != low]
        alone = rest.size and rest.min() - low > APART * (rest.max() - rest.min())
        if alone and values.size - rest.size >= REPEATED and (rest.min() >= 0 or low < BELOW * rest.min()):
            out.append(float(low))
            values = rest
    if values.size and (high := values.max()) > 0:
        rest = values[values != high]
        if rest.size and values.size - rest.size >= REPEATED and rest.max() > 0 and high > ABOVE * rest.max():
            out.append(float(high))
    return out


def without_fill(picture: NDArray[np.generic]) -> tuple[NDArray[np.generic], str]:
    """The picture with NaN in place of its fill values, and what was done in words; itself and "" without any."""
    fills = fill_values(picture)
    if not fills:
        return picture, ""
    gone = np.isin(picture, np.array(fills, dtype=picture.dtype))
    where = " and ".join(f"{fill:g}" for fill in fills)
    words = f"{int(gone.sum())} pixels are at {where}, far from all others: a fill value, taken as no value (NaN)"
    return np.where(gone, np.array(np.nan, dtype=picture.dtype), picture), words
