"""Candidates for the template: what rises out of the noise, measured once, on a picture reduced to its size.

A difference of two boxes finds what is as deep as a marker and about as large (`search`). The region below half depth
round each of its maxima says where a disc would be, how large and how elongated, whatever size was looked for, and the
correlation of that ellipse with its window how much of a disc it is: the paper's merit, taken with the top-hat as the
surface's tilt shows it. What runs on into something else (a line crosses the disc) has no such region: there SPOT tells.
Large discs are looked at on a reduced picture throughout; the template then sees every pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import numpy as np
from numpy.typing import NDArray

from windmark.detection.image import Pixels, Prepared
from windmark.detection.search import (
    MAX_LAG_PX,
    MERIT_SLACK,
    TILE,
    Bowl,
    at_tiles,
    box_sizes,
    noise_tiles,
    surface_noise,
)
from windmark.detection.shape import COLUMNS, Shapes, shapes
from windmark.detection.spots import MIN_CORE, Spots, distinct, significance

Array = NDArray[np.float64]

FILTER_SIGMA = 5.0  # of the filter's noise if it is white: less rises from noise in every picture
SEARCH_SHARE = 0.8  # of a radius is searched for: a disc seen at an angle has less than its area
REDUCED_PX = 3.5  # a searched radius is not reduced below this
SAMPLED_ROWS = 16  # one row in so many says how the filter scatters
CALM_SIGMAS = 10.0  # of uncorrelated noise: what rises more is left out when the filter's scatter is measured
TENTH = 1.2816  # standard deviations below which a tenth of Gaussian noise lies
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
    tails : `Spots.tail` of the reduced picture's tiles
    """

    spots: Spots
    found: Shapes
    fill: Array
    rest: Array
    level: Pixels
    factor: int
    tiles: Array
    tails: Array


def measured_regions(image: Prepared, radius_px: float) -> Regions:
    """What rises out of the noise and is about as large as a radius, measured by its region below half depth."""
    from windmark.detection._kernels.map import bin_mean, depths
    from windmark.detection._kernels.regions import WHOLE, regions

    factor = max(1, int(radius_px // REDUCED_PX))
    level = image.g if factor == 1 else bin_mean(image.g, factor)
    r, tiles = radius_px / factor, surface_noise(image, radius_px)
    start, tails = np.empty((0, 2)), np.ones((1, 1))
    if min(level.shape) >= 2.0 * r:
        noise = np.maximum(noise_tiles(level, TILE, min(max(round(r), 1), MAX_LAG_PX)), image.quantum)
        core, window = box_sizes(r)
        inner, outer = (2 * core + 1) ** 2, (2 * window + 1) ** 2 - (2 * core + 1) ** 2
        white = np.sqrt(1.0 / inner + 1.0 / outer) * noise
        sampled = np.empty((max(level.shape[0] // SAMPLED_ROWS, 1), level.shape[1]), np.float32)
        gate = (FILTER_SIGMA * white).astype(np.float32)
        start = np.ascontiguousarray(depths(level, core, window, gate, TILE, SAMPLED_ROWS, sampled)[:, :2])
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
        places, sure = (xy + 0.5) / factor - 0.5, significance(spots, found) >= CALM_SIGMAS
        most = float((1.0 / inner + 1.0 / outer) ** -0.5)
        tails = _tails(sampled, white, np.concatenate([places, rest]), places[sure], axes[sure, 0] / factor, float(window + 1), most)
        spots = replace(spots, tail=at_tiles(tails, places, 1.0))
    return Regions(spots, found, rows[:, 10], rest, level, factor, tiles, tails)


def _tails(sampled: Pixels, white: Array, xy: Array, sure: Array, size: Array, span: float, most: float) -> Array:
    """`Spots.tail` in the tiles of places (L, 2), from the sampled rows of the filter without the `sure` spots (K, 2).

    By the negative side, where no marker is, beside what clearly rises: its surroundings are no scatter. Noise of a
    pixel's strength moves the filter at `most` so much more, however it is correlated: what does is something else.
    """
    from windmark.detection._kernels.map import calm_scatter

    wanted, scatter = np.zeros(white.shape, dtype=bool), np.empty(white.shape)
    index = (np.maximum(xy, 0.0) / TILE).astype(np.int64)
    wanted[index[:, 1].clip(0, wanted.shape[0] - 1), index[:, 0].clip(0, wanted.shape[1] - 1)] = True
    calm_scatter(sampled, SAMPLED_ROWS, TILE, sure, size + span, wanted, scatter)
    return np.clip(scatter / (TENTH * white), 1.0, most)


def _look(image: Prepared, radius_px: float, radii: Sequence[float], merit_max: float) -> tuple[Spots, Shapes]:
    """Regions, and SPOT where there are none, of one searched radius."""
    here = measured_regions(image, max(SEARCH_SHARE * radius_px, 1.0))
    spots, found = here.spots, here.found
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


def _spot(
    image: Prepared, radius_px: float, here: Regions, merit_max: float
) -> tuple[Spots, Shapes]:
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
    tail = at_tiles(here.tails, rows[:, :2], 1.0)
    spots = Spots(xy, rows[:, 2], rows[:, 3], rows[:, 4] > 0, r0, noise, tail, rows[:, 2])
    return spots, shapes(raw, xy, r0, size, noise)


def _ellipses(shape: Array) -> tuple[Array, Array]:
    """Half axes (K, 2), largest first, and direction (K,) of the first from symmetric matrices xx, xy, yy (K, 3)."""
    xx, xy, yy = shape.T
    mean, half = 0.5 * (xx + yy), 0.5 * np.hypot(xx - yy, 2.0 * xy)
    return np.column_stack([mean + half, mean - half]), 0.5 * np.arctan2(2.0 * xy, xx - yy)
