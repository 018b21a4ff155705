"""From the raw measurements of a spot to what is reported: radius, ellipse, depth, covariance, flags."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

COLUMNS = ("scatter", "depth", "volume", "mxx", "mxy", "myy", "pixels", "missing", "outliers", "clipped")
LATTICE = 0.025  # pixel-lattice error of the bowl: LATTICE / r0 px per axis (tests/paper/test_spot.py)
BORDER, SATURATED, CONTAMINATED, TOUCHING, ILL = 1, 2, 4, 8, 16


@dataclass(frozen=True)
class Shapes:
    """K spots as measured; lengths in pixels, depths in grey levels.

    Parameters
    ----------
    scatter : (K,) of the pixels in the ring round the spot about their plane
    noise : (K,) scatter of the surface, one pixel: that, but not below the tile's
    depth : (K,) background less core, at the core (disc of radius r0 / 2)
    radius : (K,) radius of the disc of depth `depth` and the hole's volume; NaN where that is not positive
    axes, angle : (K, 2), (K,) ellipse of that area and the second moments' anisotropy; NaN where noise hides it
    flags : (K,) bits border, saturated, contaminated
    """

    scatter: Array
    noise: Array
    depth: Array
    radius: Array
    axes: Array
    angle: Array
    flags: Ints

    def take(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> Shapes:
        """The spots of a mask or of indices, in that order."""
        return Shapes(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    @staticmethod
    def join(parts: list[Shapes]) -> Shapes:
        """All spots of several lists."""
        return Shapes(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Shapes)})


def shapes(raw: Array, xy: Array, r0: Array, size: tuple[int, int], tile_noise: Array) -> Shapes:
    """Interpret the columns of `describe` for spots at xy found with the reference radii r0.

    Blur adds the same to both second moments, so their difference is the sharp ellipse's:
    (a^2 - b^2) / 4 = l1 - l2; the area pi a b = volume / depth closes the system. No size of the blur is needed.
    """
    c = dict(zip(COLUMNS, raw.T, strict=True))
    noise = np.maximum(c["scatter"], tile_noise)
    with np.errstate(invalid="ignore", divide="ignore"):
        ab = np.where((c["depth"] > 0) & (c["volume"] > 0), c["volume"] / c["depth"] / np.pi, np.nan)
        mxx, mxy, myy = (c[k] / c["volume"] for k in ("mxx", "mxy", "myy"))
        spread = 4.0 * np.hypot(0.5 * (mxx - myy), mxy)
        major = np.sqrt(spread + np.hypot(spread, ab))
        axes = np.column_stack([major, ab / major])
        reach = 1.5 * r0
        error = 4.0 * noise * np.sqrt(np.pi / 24.0) * reach**3 / c["volume"]  # 1 sigma of `spread`
        clear = (error < 0.15 * ab) & (c["missing"] == 0) & (c["outliers"] < 0.25)
    axes[~clear] = np.nan
    angle = np.where(clear, 0.5 * np.arctan2(2.0 * mxy, mxx - myy), np.nan)
    radius = np.sqrt(ab)
    return Shapes(c["scatter"], noise, c["depth"], radius, axes, angle, _flags(c, xy, np.fmax(radius, r0), size))


def covariance(unit: Array, scatter: Array, r0: Array, quantum: float) -> Array:
    """Covariance (K, 2, 2) of the centres: white noise of the ring's scatter, plus the bowl's lattice error.

    `unit` (K, 3: xx, xy, yy) is for noise of variance 1; the scatter is at least that of rounding to grey levels.
    """
    noise2 = np.maximum(scatter, quantum / np.sqrt(12.0)) ** 2
    cov = noise2[:, None, None] * unit[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    return np.asarray(cov + ((LATTICE / r0) ** 2)[:, None, None] * np.eye(2))


def _flags(c: dict[str, Array], xy: Array, reach: Array, size: tuple[int, int]) -> Ints:
    """Bits that follow from the spot alone."""
    inside = (
        np.minimum(np.minimum(xy[:, 0], xy[:, 1]), np.minimum(size[0] - 1 - xy[:, 0], size[1] - 1 - xy[:, 1])) + 0.5
    )
    cut = inside < reach
    flags = BORDER * cut + SATURATED * (c["clipped"] > 0.02)
    return np.asarray(flags + CONTAMINATED * ((c["outliers"] > 0.1) | ((c["missing"] > 0) & ~cut)), dtype=np.int64)
