"""Which marker radius an image itself prefers: the size that the best, clean spots of all sizes share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.decide import describe_spots, judge
from windmark.detection.image import Prepared, check_image, check_polarity, prepare
from windmark.detection.options import Options
from windmark.detection.rejected import ACCEPTED
from windmark.detection.spots import Spots, distinct, find_spots

Array = NDArray[np.float64]

SMALLEST_PX, LARGEST_PX, STEP = 1.2, 64.0, 1.3  # the radii that are tried
SHARE_OF_SIDE = 8.0  # the largest is the image's shorter side over this
MERIT_MAX = 0.6  # stricter than `detect`: a size is wanted, not every marker
WIDTH = 0.12  # of the kernel over log radius: half a step
EDGE = 0.1  # the range ends where the density is below this share of its peak
VALLEY = 0.5  # or at a minimum below this share of it
SEARCH_STEP = 1.4  # between radii to search with: one finds 0.8 ... 1.2 of its own
LEAST_SPOTS = 3


@dataclass(frozen=True)
class RadiusEstimate:
    """The radius that prevails in an image; false where none does.

    Parameters
    ----------
    radius_px : mode of the measured radii, NaN if none
    radii_px : radii to search with, smallest first: one where the sizes are alike; empty if none
    spots : number of clean spots in the range
    others : number of clean spots of other sizes
    reason : what was taken and why, or why nothing was
    """

    radius_px: float
    radii_px: tuple[float, ...]
    spots: int
    others: int
    reason: str

    def __bool__(self) -> bool:
        return bool(self.radii_px)


def estimate_radius(image: ArrayLike, polarity: str = "dark", *, mask: ArrayLike | None = None) -> RadiusEstimate:
    """Estimate the radius of the markers in an image.

    Radii from 1.2 to 64 px (at most an eighth of the shorter side) are tried in steps of 1.3; every spot has the
    measured radius of the trial that suits it best. The mode of their density over log radius is taken, each weighted
    by the root of its quality (see `detect`) and by its radius (more pixels vouch for it, and dust is small), with all
    that belongs to its peak: down to a tenth of it, or to a valley of less than half of it.

    Where other round things outnumber the markers, it is their size that is found: give the radius then.

    Parameters
    ----------
    image, polarity, mask : see `detect`

    Returns
    -------
    RadiusEstimate
        False where fewer than 3 clean spots share a size.
    """
    sign = check_polarity(polarity)
    checked = check_image(image)
    prepared = prepare(checked, sign, mask) if min(checked.shape) >= 3 else None
    return _none("the image is constant or too small") if prepared is None else prevailing(prepared)


def prevailing(image: Prepared) -> RadiusEstimate:
    """`estimate_radius` of a prepared image."""
    radius, quality = clean_radii(image)
    if len(radius) < LEAST_SPOTS:
        return _none(f"only {len(radius)} clean spots of any size")
    log, weight = np.log(radius), radius * np.sqrt(quality)
    at = np.arange(log.min() - WIDTH, log.max() + WIDTH, 0.02)
    density = np.exp(-0.5 * ((at[:, None] - log) / WIDTH) ** 2) @ weight
    peak = int(density.argmax())
    end = density < EDGE * density[peak]
    inner = density[1:-1]
    end[1:-1] |= (inner < VALLEY * density[peak]) & (inner <= density[:-2]) & (inner <= density[2:])
    low, high = np.flatnonzero(end[: peak + 1]), np.flatnonzero(end[peak:])
    first = at[low[-1]] if len(low) else -np.inf
    last = at[peak + high[0]] if len(high) else np.inf
    mine = np.sort(radius[(log > first) & (log < last)])
    if len(mine) < LEAST_SPOTS:
        return _none(f"no size is shared by {LEAST_SPOTS} clean spots")
    mode = float(np.exp(at[peak]))
    radii = search_radii(float(np.quantile(mine, 0.02)), float(np.quantile(mine, 0.98)), mode)
    taken = ", ".join(f"{r:.1f}" for r in radii)
    others = len(radius) - len(mine)
    words = f"radius taken: {taken} px, which {len(mine)} clean spots share ({others} are of other sizes)"
    return RadiusEstimate(mode, radii, len(mine), others, words)


def clean_radii(image: Prepared) -> tuple[Array, Array]:
    """Measured radius and quality of the spots without flags, each with the trial radius that suits it best."""
    largest = min(LARGEST_PX, min(image.g.shape) / SHARE_OF_SIDE)
    count = int(np.log(max(largest / SMALLEST_PX, 1.0)) / np.log(STEP))
    trials = SMALLEST_PX * STEP ** np.arange(count + 1)
    options = Options(merit_max=MERIT_MAX)
    spots = Spots.join([find_spots(image, float(r), MERIT_MAX) for r in trials])
    found = describe_spots(image, spots)
    value, reason = judge(spots, found, options)
    good = np.flatnonzero(reason == ACCEPTED)
    good = good[distinct(spots.take(good))]
    good = good[found.flags[good] == 0]
    return found.radius[good], value[good]


def search_radii(low: float, high: float, mode: float) -> tuple[float, ...]:
    """Radii to search with for discs from `low` to `high`; rather too large than too small (AIAA 2005-5007, II.C)."""
    if high <= 1.15 * mode and low >= 0.85 * mode:
        return (max(round(1.03 * mode, 2), 1.0),)
    count = int(np.ceil(np.log(high / low) / np.log(SEARCH_STEP))) + 1
    radii = np.maximum(np.geomspace(low, 1.03 * high, max(count, 2)), 1.0)
    return tuple(np.unique(np.round(radii, 2)).tolist())


def _none(reason: str) -> RadiusEstimate:
    return RadiusEstimate(float("nan"), (), 0, 0, f"no radius prevails: {reason}; give the radius")
