"""Spots of several reference radii: found, chosen, each marker once."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from windmark.detection.image import Prepared
from windmark.detection.search import MERIT_SLACK, Bowl, at_tiles, candidates, surface_noise

if TYPE_CHECKING:
    from windmark.detection.shape import Shapes

Array = NDArray[np.float64]
Index = NDArray[np.int64] | NDArray[np.bool_]

MIN_CORE = 0.85  # share of the hole that must be inside the image
FULL_EVIDENCE_PX = 3.0  # fewer pixels vouch for smaller holes: their quality counts sqrt(r0 / 3)
MERIT_FLOOR = 1e-3  # of a hole without noise


@dataclass(frozen=True)
class Spots:
    """K spots as SPOT leaves them.

    Parameters
    ----------
    xy : (K, 2) vertex of the bowl
    merit, depth : (K,) of the top-hat there
    settled : (K,) whether the bowl came to rest
    r0 : (K,) reference radius
    noise : (K,) of the surface in the spot's tile
    tail : (K,) scatter there of the filter that searched, over that of noise as strong but not correlated
    misfit : (K,) the merit that would be left without noise
    """

    xy: Array
    merit: Array
    depth: Array
    settled: NDArray[np.bool_]
    r0: Array
    noise: Array
    tail: Array
    misfit: Array

    def take(self, index: Index) -> Spots:
        """The spots of a mask or of indices, in that order."""
        return Spots(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    @staticmethod
    def join(parts: list[Spots]) -> Spots:
        """All spots of several lists."""
        return Spots(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Spots)})


def find_spots(image: Prepared, r0: float, merit_max: float) -> Spots:
    """What SPOT finds with one reference radius, each once."""
    from windmark.detection._kernels.spot import refine_bowl

    found, noise = np.empty((0, 5)), np.ones((1, 1))
    if min(image.g.shape) >= 2.0 * r0:
        bowl, noise = Bowl.of_radius(r0), surface_noise(image, r0)
        start = candidates(image, r0, merit_max, noise)
        found = refine_bowl(image.g, start, r0, merit_max + MERIT_SLACK, MIN_CORE, bowl.positions, bowl.functionals)
        found = found[found[:, 2] <= merit_max]
    xy, radius = found[:, :2], np.full(len(found), r0)
    merit, depth, settled = found[:, 2], found[:, 3], found[:, 4] > 0
    spots = Spots(xy, merit, depth, settled, radius, at_tiles(noise, xy, r0), np.ones(len(xy)), merit)
    return spots.take(distinct(spots))


def quality(spots: Spots, depth: Array, noise: Array) -> Array:
    """Depth / noise / merit, less for small holes: what spots are ordered and chosen by, see `detect`."""
    evidence = np.sqrt(np.minimum(spots.r0 / FULL_EVIDENCE_PX, 1.0))
    return np.asarray(evidence * depth / noise / np.maximum(spots.merit, MERIT_FLOOR))


def significance(spots: Spots, found: Shapes) -> Array:
    """Standard deviations (K,) by which the spots' matched filter rises out of the surface's scatter."""
    return np.asarray(np.sqrt(0.75 * np.pi) * found.radius * found.depth / (found.noise * spots.tail))


def distinct(spots: Spots, width: Array | None = None) -> NDArray[np.int64]:
    """Indices of the best of those that are nearer to each other than 1.5 times their mean reference radius, or width.

    The best by quality with the tiles' noise, which competing radii share. Not by merit alone: a speck at a
    marker's rim may fit a small top-hat well without being the marker.
    """
    order = np.argsort(-quality(spots, spots.depth, spots.noise), kind="stable")
    if len(order) < 2:
        return order
    from scipy.spatial import cKDTree

    xy, r0 = spots.xy[order], (spots.r0 if width is None else width)[order]
    pairs = cKDTree(xy).query_pairs(1.5 * r0.max(), output_type="ndarray")
    distance = np.hypot(*(xy[pairs[:, 0]] - xy[pairs[:, 1]]).T)
    pairs = np.sort(pairs[distance < 0.75 * (r0[pairs[:, 0]] + r0[pairs[:, 1]])], axis=1)
    alive = np.ones(len(xy), dtype=bool)
    for better, worse in pairs[np.argsort(pairs[:, 0], kind="stable")].tolist():
        if alive[better]:
            alive[worse] = False
    return order[alive]
