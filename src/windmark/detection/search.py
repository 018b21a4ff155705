"""Where SPOT starts: local maxima of a coarse depth filter, gated by the image's own noise.

The merit map of the paper is only needed where there can be a marker. A difference of two box means costs a few
operations per pixel whatever the radius; its local maxima that rise out of the noise are the candidates, and only they
are given to SPOT. Large radii are searched on a binned image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.detection.image import Pixels, Prepared

Array = NDArray[np.float64]

TILE = 64  # pixels of the searched image per noise tile
MAX_LAG_PX = 6
GATE_SIGMA = 2.5  # coarse depth in units of the tile's noise; accepted spots need about 5, the filter keeps half
MERIT_SLACK = 0.5  # a candidate sits up to a pixel off its spot: its merit may be that much worse
BIN_RADIUS_PX = 3.0  # the radius is not binned below this


@dataclass(frozen=True)
class Bowl:
    """Positions at which the merit is taken for the quadratic fit, and that fit as linear functionals.

    Parameters
    ----------
    positions : (13, 2) disc of radius 0.6 r0, spacing 0.3 r0, in pixels
    functionals : (5, 13) gradient (2) and second derivatives xx, xy, yy of the least-squares quadratic
    """

    positions: Array
    functionals: Array

    @staticmethod
    def of_radius(r0: float) -> Bowl:
        """The bowl for a reference radius. The radius is fixed: restricted to m < 0.7 the fit is ill-posed."""
        steps = np.array([(i, j) for j in range(-2, 3) for i in range(-2, 3) if i * i + j * j <= 4], dtype=float)
        u, v = (0.3 * r0 * steps).T
        design = np.column_stack([np.ones_like(u), u, v, 0.5 * u * u, u * v, 0.5 * v * v])
        return Bowl(0.3 * r0 * steps, np.ascontiguousarray(np.linalg.pinv(design)[1:]))


def bin_factor(radius_px: float) -> int:
    """How far the image is binned to search for a radius."""
    return max(1, int(radius_px // BIN_RADIUS_PX))


def box_sizes(radius_px: float) -> tuple[int, int]:
    """Half widths of the boxes whose areas are nearest to those of the hole and of the 2 r0 window."""
    core = max(1, round((np.sqrt(np.pi) * radius_px - 1.0) / 2.0))
    window = max(core + 1, round((2.0 * np.sqrt(np.pi) * radius_px - 1.0) / 2.0))
    return core, window


def noise_tiles(g: Pixels, tile: int, lag: int, rows_each: int = 4) -> Array:
    """Scatter of the surface, one pixel, in tiles of `tile` pixels: (ceil(H / tile), ceil(W / tile)).

    Second differences over `lag` pixels along some rows of each tile: slopes drop out, and texture that is correlated
    over less than the lag counts in full (neighbouring pixels of a blurred texture differ too little). Their lower
    quartile is taken, so that markers and edges may cover half of a tile. Missing pixels (NaN) do not count; a tile
    without any other has the noise of the median tile.
    """
    from windmark.detection._kernels.map import bend_quartiles

    h, w = g.shape
    across, down = -(-w // tile), -(-h // tile)
    rows = np.minimum((np.arange(rows_each * down) + 0.5) * (tile / rows_each), h - 1).astype(np.int64)
    cols = np.clip((np.arange(64 * across) + 0.5) * (tile / 64.0), lag, max(lag, w - 1 - lag)).astype(np.int64)
    quartile = np.empty((down, across))
    bend_quartiles(g, rows.reshape(down, rows_each), cols.reshape(across, 64), lag, 16, quartile)
    known = np.isfinite(quartile)
    quartile[~known] = np.median(quartile[known]) if known.any() else 0.0
    return quartile / (0.3186 * np.sqrt(6.0))


def surface_noise(image: Prepared, radius_px: float) -> Array:
    """The tiles' noise for markers of a radius: the lag is the radius, 6 px at most; at least one grey-level step."""
    lag = min(round(radius_px), MAX_LAG_PX)
    return np.maximum(noise_tiles(image.g, TILE * bin_factor(radius_px), lag), image.quantum)


def few_levels(image: Prepared) -> str:
    """That no depth can exceed the steps between grey levels, which are taken as noise; "" where one can."""
    steps = float(np.nanmax(image.g) - np.nanmin(image.g)) / image.quantum
    if steps > GATE_SIGMA:
        return ""
    return (f"the image has only {round(steps) + 1} grey levels, from which no centre can be measured (thresholded, or "
            "far too dark): expected as the camera took it")  # fmt: skip


def at_tiles(noise: Array, xy: Array, radius_px: float) -> Array:
    """The noise of the tiles in which the points xy (K, 2) lie: (K,)."""
    index = (xy / (TILE * bin_factor(radius_px))).astype(np.int64)
    return np.asarray(noise[index[:, 1].clip(0, noise.shape[0] - 1), index[:, 0].clip(0, noise.shape[1] - 1)])


def candidates(image: Prepared, radius_px: float, merit_max: float, noise: Array) -> Array:
    """Starting positions (K, 2) in full-resolution pixels for one radius, given its `surface_noise`."""
    from windmark.detection._kernels.map import bin_mean, depth_peaks
    from windmark.detection._kernels.spot import refine_bowl

    factor = bin_factor(radius_px)
    small, r = image.g if factor == 1 else bin_mean(image.g, factor), radius_px / factor
    gate = (GATE_SIGMA * noise).astype(np.float32)
    core, window = box_sizes(r)
    start = np.ascontiguousarray(depth_peaks(small, core, window, gate, TILE)[:, :2])
    if factor == 1:
        return start
    bowl = Bowl.of_radius(r)
    found = refine_bowl(small, start, r, merit_max + MERIT_SLACK, 0.7, bowl.positions, bowl.functionals)
    found = found[found[:, 2] < merit_max + 0.2]
    return np.asarray((found[:, :2] + 0.5) * factor - 0.5)
