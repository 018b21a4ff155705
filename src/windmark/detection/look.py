"""Candidates for the template: what rises out of the noise, measured once, on a picture reduced to its size.

A difference of two boxes finds what is as deep as a marker and about as large (`search`). The region below half depth
round each of its maxima says where a disc would be, how large and how elongated, whatever size was looked for, and the
correlation of that ellipse with its window how much of a disc it is: the paper's merit, taken with the top-hat as the
surface's tilt shows it. What runs on into something else (a line crosses the disc) has no such region: there SPOT says.
Large discs are looked at on a reduced picture throughout; the template then sees every pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.detection.image import Pixels, Prepared
from windmark.detection.options import FIT_SLACK
from windmark.detection.search import (
    MAX_LAG_PX,
    TILE,
    Bowl,
    at_tiles,
    box_sizes,
    noise_tiles,
    surface_noise,
)
from windmark.detection.shape import COLUMNS, Shapes, shapes
from windmark.detection.spots import MIN_CORE, Spots, distinct

Array = NDArray[np.float64]

FILTER_SIGMA = 5.0  # of the filter's noise if it is white: less rises from noise in every picture
SEARCH_SHARE = 0.8  # of a radius is searched for: a disc seen at an angle has less than its area
REDUCED_PX = 3.5  # a searched radius is not reduced below this
DISC_MISFIT = 0.3  # of a region's ellipse: what is better is a disc, not a piece of texture
TAIL_LAG = 2  # boxes between those that are compared: neighbours share the surface's shape
TAIL_ROWS = 16  # of a tile's boxes: 4 leave the ratio of two noises unsure by 12 %
SPAN = 1.6  # discs of the searched radius over this ... times this are measured
CLEAR_MERIT = 1.2  # of a region's ellipse: what is worse is no disc of its own, and SPOT is asked too


def trial_radii(radii: Sequence[float]) -> list[float]:
    """As few of the radii as measure all of them, smallest first."""
    left, trials = sorted(radii), []
    while left:
        trials.append(max(r for r in left if r <= SPAN * left[0]))
        left = [r for r in left if r > SPAN * trials[-1]]
    return trials


def look_for(image: Prepared, radii: Sequence[float], merit_max: float) -> tuple[Spots, Shapes]:
    """Candidates of some radii, as measured.

    Parameters
    ----------
    radii : that are asked for; a candidate belongs to the one nearest to its larger half axis
    merit_max : of the places where SPOT is asked
    """
    parts = [_look(image, r, radii, merit_max) for r in trial_radii(radii)]
    spots, found = Spots.join([p[0] for p in parts]), Shapes.join([p[1] for p in parts])
    once = separate(spots, found)
    return spots.take(once), found.take(once)


def separate(spots: Spots, found: Shapes) -> NDArray[np.int64]:
    """Indices of the best of those that are nearer than 1.5 times the mean of their smaller half axes, best first.

    As `distinct`, but two discs seen at a grazing angle side by side are two.
    """
    width = np.where(np.isfinite(found.axes[:, 1]), found.axes[:, 1], np.nan_to_num(found.radius, nan=0.0))
    width = np.where(width > 0.0, width, spots.r0)
    # Noise is left out: at one place it is one, though tiles of other radii say otherwise.
    return distinct(replace(spots, noise=np.ones_like(spots.noise)), width)


@dataclass(frozen=True)
class Regions:
    """Regions that one searched radius has led to.

    Parameters
    ----------
    spots, found : (K,) of them; `r0` of the spots is the radius searched for
    fill : (K,) region's area over that of the ellipse with its second moments: 1 for ellipses, 0.955 for squares
    rest : (L, 2) pixels of the reduced picture where something rises that is no such region
    level, factor : the reduced picture and how far it is
    tiles : noise of the picture's own pixels, see `surface_noise`
    tails, box : `Spots.tail` in tiles of boxes of so many pixels of the reduced picture
    """

    spots: Spots
    found: Shapes
    fill: Array
    rest: Array
    level: Pixels
    factor: int
    tiles: Array
    tails: Array
    box: int


def measured_regions(image: Prepared, radius_px: float) -> Regions:
    """What rises out of the noise and is about as large as a radius, measured by its region below half depth."""
    from windmark.detection._kernels.map import bin_mean, depth_peaks
    from windmark.detection._kernels.regions import WHOLE, regions

    factor = max(1, int(radius_px // REDUCED_PX))
    level = image.g if factor == 1 else bin_mean(image.g, factor)
    r, tiles = radius_px / factor, surface_noise(image, radius_px)
    start, tails, box = np.empty((0, 2)), np.ones((1, 1)), 1
    if min(level.shape) >= 2.0 * r:
        noise = np.maximum(noise_tiles(level, TILE, min(max(round(r), 1), MAX_LAG_PX)), image.quantum)
        core, window = box_sizes(r)
        inner, outer = (2 * core + 1) ** 2, (2 * window + 1) ** 2 - (2 * core + 1) ** 2
        gate = (FILTER_SIGMA * np.sqrt(1.0 / inner + 1.0 / outer) * noise).astype(np.float32)
        start = np.ascontiguousarray(depth_peaks(level, core, window, gate, TILE)[:, :2])
    level_noise = at_tiles(noise, start, 1.0) if len(start) else np.empty(0)
    rows = regions(level, start, r, level_noise)
    with np.errstate(invalid="ignore", divide="ignore"):
        merit = np.sqrt(rows[:, 9] * (1.0 / rows[:, 7] - 1.0))
        misfit = merit * np.sqrt(np.maximum(1.0 - (level_noise / rows[:, 8]) ** 2, 0.0))
    good = (misfit <= CLEAR_MERIT) & (rows[:, 6] > 0.0) & (rows[:, 11] == WHOLE)  # cut ones look whole, but smaller
    rows, merit, misfit, rest = rows[good], merit[good], misfit[good], start[~good]
    xy = (rows[:, :2] + 0.5) * factor - 0.5
    axes, angle = _ellipses(factor * rows[:, 2:5])
    local, count = at_tiles(tiles, xy, radius_px), len(rows)
    size, flags = np.sqrt(axes.prod(axis=1)), np.zeros(count, dtype=np.int64)
    one = np.ones(count)
    spots = Spots(xy, merit, rows[:, 6], one > 0, radius_px * one, local, one, misfit)
    found = Shapes(rows[:, 8], local, rows[:, 6], size, axes, angle, flags)
    if len(start):
        disc = misfit <= DISC_MISFIT
        tails, box = _tails(level, noise, core, (xy[disc] + 0.5) / factor), 2 * core + 1
        spots = replace(spots, tail=at_tiles(tails, (xy + 0.5) / (factor * box) - 0.5, 1.0))
    return Regions(spots, found, rows[:, 10], rest, level, factor, tiles, tails, box)


def _tails(level: Pixels, noise: Array, core: int, discs: Array) -> Array:
    """`Spots.tail` in tiles of the picture reduced by the inner box: how its noise differs from that of white noise.

    By second differences again. Three boxes in a row hit a marker in half of the places where markers are dense, so
    what looks like discs (K, 2) is left out. What a border leaves of a tile is no measure of it where it is little: the
    tile before it says what is there.
    """
    from windmark.detection._kernels.map import bin_mean

    width = 2 * core + 1
    if min(level.shape) < 8 * width:
        return np.ones((1, 1))
    boxes = _without(bin_mean(level, width), discs / width)
    coarse = noise_tiles(boxes, TILE, TAIL_LAG, TAIL_ROWS)
    for axis, side in enumerate(boxes.shape):
        if coarse.shape[axis] > 1 and (side - 1) % TILE + 1 < TILE // 2:
            last = [slice(None), slice(None)]
            last[axis] = slice(-2, None)
            coarse[tuple(last)] = np.take(coarse, [-2], axis=axis)
    fine = [[_tile_mean(noise, j, i, width) for i in range(coarse.shape[1])] for j in range(coarse.shape[0])]
    return np.clip(width * coarse / np.array(fine), 1.0, width)  # noise of a pixel's strength cannot do more


def _without(boxes: Pixels, discs: Array) -> Pixels:
    """Boxes without those at and next to discs (K, 2), unless these cover so much that the rest says nothing."""
    out, place, (h, w) = boxes.copy(), discs.astype(np.int64), boxes.shape
    for dx, dy in np.ndindex(3, 3):
        out[(place[:, 1] + dy - 1).clip(0, h - 1), (place[:, 0] + dx - 1).clip(0, w - 1)] = np.nan
    return out if np.isfinite(out).mean() > 0.5 else boxes


def _tile_mean(noise: Array, j: int, i: int, width: int) -> float:
    """Root mean square of the tiles' noise over one tile of a picture reduced by `width`."""
    part = noise[j * width : (j + 1) * width, i * width : (i + 1) * width]
    return float(np.sqrt(np.mean(np.square(part if part.size else noise[-1:, -1:]))))


def _look(image: Prepared, radius_px: float, radii: Sequence[float], merit_max: float) -> tuple[Spots, Shapes]:
    """Regions, and SPOT where there are none, of one searched radius."""
    here = measured_regions(image, max(SEARCH_SHARE * radius_px, 1.0))
    like = here.spots.misfit <= min(merit_max / FIT_SLACK, CLEAR_MERIT)  # its own ellipse has no tilt to be excused for
    spots, found = here.spots.take(like), here.found.take(like)
    asked = np.array(sorted(radii))
    nearest = np.abs(np.log(asked[:, None] / found.axes[:, 0])).argmin(axis=0)
    spots = replace(spots, r0=asked[nearest])
    others = [_spot(image, r, here, merit_max) for r in radii if trial_of(r, radii) == radius_px]
    return (
        Spots.join([spots, *(o[0] for o in others)]),
        Shapes.join([found, *(o[1] for o in others)]),
    )


def trial_of(radius: float, radii: Sequence[float]) -> float:
    """The trial radius with which a radius is looked for."""
    return min(trial_radii(radii), key=lambda t: abs(np.log(t / radius)))


def _spot(image: Prepared, radius_px: float, here: Regions, merit_max: float) -> tuple[Spots, Shapes]:
    """SPOT on the reduced picture at pixels of it."""
    from windmark.detection._kernels.shape import describe
    from windmark.detection._kernels.spot import refine_bowl

    level, factor, tiles = here.level, here.factor, here.tiles
    r = max(radius_px / factor, 1.0)
    bowl = Bowl.of_radius(r)
    rows = refine_bowl(level, here.rest, r, merit_max + 0.2, MIN_CORE, bowl.positions, bowl.functionals)
    rows = rows[rows[:, 2] <= merit_max]
    xy = (rows[:, :2] + 0.5) * factor - 0.5
    r0, noise = np.full(len(rows), radius_px), at_tiles(tiles, xy, radius_px)
    raw = describe(level, np.ascontiguousarray(rows[:, :2]), r, image.clip, image.sign)
    raw[:, COLUMNS.index("volume")] *= factor**2
    raw[:, [COLUMNS.index(k) for k in ("mxx", "mxy", "myy")]] *= factor**4
    size = image.g.shape[1], image.g.shape[0]
    tail = at_tiles(here.tails, (rows[:, :2] + 0.5) / here.box - 0.5, 1.0)
    spots = Spots(xy, rows[:, 2], rows[:, 3], rows[:, 4] > 0, r0, noise, tail, rows[:, 2])
    return spots, shapes(raw, xy, r0, size, noise)


def _ellipses(shape: Array) -> tuple[Array, Array]:
    """Half axes (K, 2), largest first, and direction (K,) of the first from symmetric matrices xx, xy, yy (K, 3)."""
    xx, xy, yy = shape.T
    mean, half = 0.5 * (xx + yy), 0.5 * np.hypot(xx - yy, 2.0 * xy)
    return np.column_stack([mean + half, mean - half]), 0.5 * np.arctan2(2.0 * xy, xx - yy)
