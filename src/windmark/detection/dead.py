"""Pixels of a sensor that do not measure: hot and dead ones, alone, in groups and in whole columns or rows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.dead_groups import RATIO, dead_groups
from windmark.detection.dead_lines import candidates, dead_lines, repeated
from windmark.detection.dead_single import LEAVES, SURE, dead_singles
from windmark.detection.image import DEAD_NOISE, DEAD_RATIO, Pixels, check_image, levels_of, shifted, usable_sample
from windmark.detection.sharpest import sharpness_px

Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]

LEAST_DEAD = 0.02  # part of an image's range by which a dead pixel leaves that of its neighbours
MOST_DEAD = 0.01  # part of a sensor's pixels: one with more has no picture
PAIR_RATIO = 8.0  # of two neighbours, see DEAD_RATIO: a point of light of 0.5 px between them does so 6.4 times
TILE_PX, EVERY = 32, 8
"""Pixels across a part of a picture of which the noise is taken; of every so many rows of it."""


def dead_pixels(image: ArrayLike) -> Mask | None:
    """(H, W) the hot and dead pixels of an image, which stand out as nothing does that an optic has imaged; None where
    there are none, or so many that it is how the picture was drawn. `detect` leaves single ones out by itself.

    Alone (of ten noises and more, where the picture's noise and blur tell it), in twos, in groups of up to
    `dead_groups.MOST`, and whole columns and rows, of which a constant offset is enough. What has the blur of the
    picture's own edges is not found: a hot pixel whose charge has spread.
    """
    from windmark.detection._kernels import dead

    grey = check_image(image)
    sample = usable_sample(grey, None)
    if sample.size == 0:
        return None
    levels = levels_of(grey, 1.0, None, sample)
    g = shifted(grey, None, 1.0, levels.offset)[0]
    # Noise that compression has taken away limits nothing.
    least = max(levels.dead, LEAST_DEAD * float(np.ptp(sample)))
    found = dead.dead_pixels(g, least, DEAD_RATIO, PAIR_RATIO, RATIO)
    # Alone or in twos; so many of these are how the picture was drawn.
    single, seeds = found[found[:, 2] == 0, :2], found[found[:, 2] != 0]
    if len(single) > MOST_DEAD * g.size:
        return None
    faint = dead.dead_pixels(g, SURE * levels.dead / DEAD_NOISE, LEAVES, 0.0, 0.0)[:, :2]
    faint = faint[~_among(faint, single, g.shape[1])] if len(faint) <= MOST_DEAD * g.size else faint[:0]
    single, columns, rows, groups = _together(g, levels.step, single, faint, seeds)
    if not (len(single) or len(columns) or len(rows) or groups is not None):
        return None
    out = np.zeros(g.shape, bool) if groups is None else groups
    out[single[:, 0], single[:, 1]] = out[:, columns] = out[rows] = True
    return out


def _together(
    g: Pixels, step: float, single: Ints, faint: Ints, seeds: Ints
) -> tuple[Ints, Ints, Ints, Mask | None]:
    """Single pixels, those of ``faint`` that are dead among them, dead columns, rows and groups of a picture, in which
    all that is dead but the groups is NaN afterwards.

    What needs the noise and the blur is looked at only where something may be dead: in most pictures nothing is.
    """
    none = np.empty(0, np.int64)
    if min(g.shape) < 2 * TILE_PX:
        return single, none, none, None
    maybe = [candidates(turned, step) for turned in (g, g.T)]
    seeds = seeds[~_among(seeds, single, g.shape[1])]
    if not (len(faint) or len(seeds) or any(len(some) for some in maybe)) or repeated(g) or repeated(g.T):
        return single, none, none, None
    ends = float(np.fmin.reduce(g, axis=None)), float(np.fmax.reduce(g, axis=None))
    noise = local_noise(g, step)
    blur_px = sharpness_px(g, noise)
    faint = dead_singles(g, faint, noise[faint[:, 0], faint[:, 1]], blur_px, step, ends)
    single = np.concatenate([single, faint])
    columns, rows = (
        dead_lines(turned, some, blur_px, step, ends) for turned, some in zip((g, g.T), maybe, strict=True)
    )
    g[single[:, 0], single[:, 1]] = g[:, columns] = g[rows] = np.nan
    seeds = seeds[~_among(seeds, faint, g.shape[1])]
    return single, columns, rows, dead_groups(g, seeds, noise, blur_px, step, ends)


def _among(pixels: Ints, others: Ints, width: int) -> NDArray[np.bool_]:
    """Which of some pixels (K, 2 ...: row, column) of a picture so wide are among others."""
    return np.isin(pixels[:, 0] * width + pixels[:, 1], others[:, 0] * width + others[:, 1])


def local_noise(g: Pixels, step: float) -> Any:
    """(H, W) 1 sigma of a pixel, by the median scatter of neighbours in a row about their trend, in tiles; of levels
    that lie ``step`` apart at least what rounding makes.
    """
    rows, columns = (max(n // TILE_PX, 1) for n in g.shape)
    height, width = g.shape[0] // rows, (g.shape[1] - 2) // columns
    part = g[: rows * height].reshape(rows, height, -1)[:, ::EVERY]
    bend = np.abs(part[..., :-2] - 2 * part[..., 1:-1] + part[..., 2:])[..., : columns * width]
    tiles = bend.reshape(rows, -1, columns, width).swapaxes(1, 2).reshape(rows, columns, -1)
    known = np.where(np.isnan(tiles), np.float32(0), tiles)
    half = known.shape[2] // 2
    middle = np.partition(known, half, axis=2)[..., half]
    sigma = np.maximum(middle / (0.6745 * np.sqrt(6.0)), 0.3 * step).astype(np.float32)
    down, across = (np.bincount(np.minimum(np.arange(n) // size, count - 1)) for n, size, count in
                    zip(g.shape, (height, width), (rows, columns), strict=True))  # fmt: skip
    return np.repeat(np.repeat(sigma, across, axis=1), down, axis=0)
