"""Pixels of a sensor that do not measure: hot and dead ones, alone, in groups and in whole columns or rows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.dead_groups import dead_groups
from windmark.detection.dead_lines import dead_lines
from windmark.detection.image import DEAD_RATIO, Pixels, check_image, levels_of, shifted, usable_sample
from windmark.detection.sharpest import sharpness_px

Mask = NDArray[np.bool_]

LEAST_DEAD = 0.02  # part of an image's range by which a dead pixel leaves that of its neighbours
MOST_DEAD = 0.01  # part of a sensor's pixels: one with more has no picture
PAIR_RATIO = 8.0  # of two neighbours, see DEAD_RATIO: a point of light of 0.5 px between them does so 6.4 times
TILE_PX, EVERY = 32, 4
"""Pixels across a part of a picture of which the noise is taken, of every fourth row of it."""


def dead_pixels(image: ArrayLike) -> Mask | None:
    """(H, W) the hot and dead pixels of an image, which stand out as nothing does that an optic has imaged; None where
    there are none, or so many that it is how the picture was drawn. `detect` leaves single ones out by itself.

    Alone, in twos, in groups of up to `dead_groups.MOST`, and whole columns and rows, of which a constant offset is
    enough. What has the blur of the picture's own edges is not found: a hot pixel whose charge has spread.
    """
    grey = check_image(image)
    sample = usable_sample(grey, None)
    if sample.size == 0:
        return None
    levels = levels_of(grey, 1.0, None, sample)
    g = shifted(grey, None, 1.0, levels.offset)[0]
    # Noise that compression has taken away limits nothing.
    least = max(levels.dead, LEAST_DEAD * float(np.ptp(sample)))
    out = _single(g, least)
    if out is not None and min(g.shape) >= 2 * TILE_PX:
        noise = local_noise(g, levels.step)
        blur_px = sharpness_px(g, noise)
        out |= dead_lines(g, blur_px, levels.step) | dead_lines(g.T, blur_px, levels.step)[:, None]
        g[out] = np.nan
        groups = dead_groups(g, noise, blur_px, least)
        out |= False if groups is None else groups
    return out if out is not None and out.any() else None


def _single(g: Pixels, least: float) -> Mask | None:
    """Alone or in twos; None where these are so many that it is how the picture was drawn."""
    from windmark.detection._kernels import dead

    found = dead.dead_pixels(g, least, DEAD_RATIO, PAIR_RATIO)
    if len(found) > MOST_DEAD * g.size:
        return None
    out = np.zeros(g.shape, bool)
    out[found[:, 0], found[:, 1]] = True
    return out


def local_noise(g: Pixels, step: float) -> Any:
    """(H, W) 1 sigma of a pixel, by the median scatter of neighbours in a row about their trend, in tiles; of levels
    that lie ``step`` apart at least what rounding makes.
    """
    rows, columns = (max(n // TILE_PX, 1) for n in g.shape)
    height, width = g.shape[0] // rows, (g.shape[1] - 2) // columns
    part = g[: rows * height]
    bend = np.abs(part[:, :-2] - 2 * part[:, 1:-1] + part[:, 2:])[:, : columns * width]
    tiles = bend.reshape(rows, height, columns, width)[:, ::EVERY].swapaxes(1, 2).reshape(rows, columns, -1)
    sigma = np.maximum(np.median(np.nan_to_num(tiles), axis=2) / (0.6745 * np.sqrt(6.0)), 0.3 * step)
    where = (np.minimum(np.arange(n) // size, count - 1) for n, size, count in
             zip(g.shape, (height, width), (rows, columns), strict=True))  # fmt: skip
    return sigma[np.ix_(*where)]
