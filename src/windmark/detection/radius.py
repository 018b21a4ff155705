"""Which marker radius an image itself prefers: the size that the strongest clear spots of all sizes share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.image import Prepared, check_image, check_polarity, prepare
from windmark.detection.look import measured_regions, separate
from windmark.detection.options import QUALITY_MIN
from windmark.detection.quantile import weighted_quantile
from windmark.detection.search import few_levels
from windmark.detection.shape import Shapes
from windmark.detection.spots import MERIT_FLOOR, Spots, quality
from windmark.options.detection import POLARITY

Array = NDArray[np.float64]

SMALLEST_PX, LARGEST_PX, STEP = 1.3, 64.0, 1.7  # the radii that are tried: each measures half to twice its size
SHARE_OF_SIDE = 8.0  # the largest is the image's shorter side over this
MISFIT_MAX = 0.45  # merit but for noise: stricter than `detect`, as a size is wanted, not every marker
POINT_PX = 1.5  # discs below are hardly told from points: their evidence counts r^2 / (r^2 + this^2)
WIDTH = 0.12  # of the kernel over log radius: half a step
EDGE = 0.1  # the range ends where the density is below this share of its peak
VALLEY = 0.5  # or at a minimum below this share of it
SEARCH_STEP = 1.4  # between radii to search with: one finds 0.8 ... 1.2 of its own
LEAST_SPOTS = 3
SHALLOW = 0.25  # of the median depth of a size: shallower spots of this size are dust, light falls less
RIVAL = 0.5  # another size with this share of the evidence is named
FILL_MIN = 0.85  # area of a region over that of its ellipse: less is no disc, however few its pixels


@dataclass(frozen=True)
class RadiusEstimate:
    """The radius that prevails in an image; false where none does.

    Parameters
    ----------
    radius_px : mode of the measured radii, NaN if none
    radii_px : radii to search with, smallest first: one where the sizes are alike; empty if none
    spots : number of spots in the range
    others : number of spots of other sizes
    reason : what was taken and why, or why nothing was
    """

    radius_px: float
    radii_px: tuple[float, ...]
    spots: int
    others: int
    reason: str

    def __bool__(self) -> bool:
        return bool(self.radii_px)


def estimate_radius(
    image: ArrayLike, polarity: str = POLARITY.default, *, mask: ArrayLike | None = None
) -> RadiusEstimate:
    """Estimate the radius of the markers in an image.

    Spots of 1 to some 100 px (a fourth of the shorter side) are looked for in steps of 1.7 and measured by their region
    below half depth, see `look`: tilted discs by their larger half axis. Each counts with its radius times its depth
    over its merit: the root of what it explains in its window (more pixels vouch for large ones, and dust is small and
    pale), more for a better shape, less where it is hardly told from a point. Not with the noise at its place: where a
    camera has cut off black or white there is none, and one grey level would outweigh all markers. The mode of the
    density over log radius is taken, with all that belongs to its peak: down to a tenth of it, or to a valley of less
    than half of it.

    Where other round things outweigh the markers, it is their size that is found; the reason names a size that has at
    least half as much evidence. Give the radius then.

    Parameters
    ----------
    image, polarity, mask : see `detect`

    Returns
    -------
    RadiusEstimate
        False where fewer than 3 spots share a size.
    """
    sign = check_polarity(polarity)
    checked = check_image(image)
    prepared = prepare(checked, sign, mask) if min(checked.shape) >= 3 else None
    return _none("the image is constant or too small") if prepared is None else prevailing(prepared)


def prevailing(image: Prepared) -> RadiusEstimate:
    """`estimate_radius` of a prepared image."""
    radius, depth, evidence = clear_spots(image)
    if len(radius) < LEAST_SPOTS:
        if few := few_levels(image):
            return RadiusEstimate(float("nan"), (), 0, 0, few)
        spots = f"only {len(radius)} clear spot{'s' if len(radius) > 1 else ''}" if len(radius) else "no clear spot"
        return _none(f"{spots} of any size")
    log = np.log(radius)
    at = np.arange(log.min() - WIDTH, log.max() + WIDTH, 0.02)
    density = np.exp(-0.5 * ((at[:, None] - log) / WIDTH) ** 2) @ evidence
    peak = int(density.argmax())
    first, last = _foot(at, density, peak)
    mine = (log > first) & (log < last)
    mine &= depth > SHALLOW * float(weighted_quantile(depth[mine], evidence[mine], 0.5))
    if mine.sum() < LEAST_SPOTS:
        return _none(f"no size is shared by {LEAST_SPOTS} clear spots")
    mode = float(np.exp(at[peak]))
    low, high = (float(weighted_quantile(radius[mine], evidence[mine], q)) for q in (0.02, 0.98))
    radii = search_radii(low, high, mode)
    taken, count, others = ", ".join(f"{r:.1f}" for r in radii), int(mine.sum()), int((~mine).sum())
    words = f"radius taken: {taken} px, which {count} clear spots share ({others} are of other sizes)"
    rest = np.where((at > first) & (at < last), 0.0, density)
    if rest.max() > RIVAL * density[peak]:
        words += f"; much speaks for {np.exp(at[rest.argmax()]):.1f} px too: give the radius if it is that"
    return RadiusEstimate(mode, radii, count, others, words)


def clear_spots(image: Prepared) -> tuple[Array, Array, Array]:
    """Larger half axis, depth and evidence of the clear spots."""
    parts = [measured_regions(image, r) for r in trials(min(image.g.shape))]
    spots, found = Spots.join([p.spots for p in parts]), Shapes.join([p.found for p in parts])
    filled = np.concatenate([p.fill >= FILL_MIN for p in parts])
    good = filled & (spots.misfit <= MISFIT_MAX) & (quality(spots, found.depth, found.noise) >= QUALITY_MIN)
    spots, found = spots.take(good), found.take(good)
    once = separate(spots, found)
    major, depth = found.axes[once, 0], found.depth[once]
    resolved = major**2 / (major**2 + POINT_PX**2)
    return major, depth, resolved * found.radius[once] * depth / np.maximum(spots.merit[once], MERIT_FLOOR)


def trials(side_px: int) -> list[float]:
    """Radii to look for where none is known, in an image of that shorter side."""
    largest = min(LARGEST_PX, side_px / SHARE_OF_SIDE)
    count = int(np.log(max(largest / SMALLEST_PX, 1.0)) / np.log(STEP)) + 1
    return [float(r) for r in SMALLEST_PX * STEP ** np.arange(count + 1)]


def _foot(at: Array, density: Array, peak: int) -> tuple[float, float]:
    """Where a peak of the density ends on both sides."""
    end = density < EDGE * density[peak]
    inner = density[1:-1]
    end[1:-1] |= (inner < VALLEY * density[peak]) & (inner <= density[:-2]) & (inner <= density[2:])
    low, high = np.flatnonzero(end[: peak + 1]), np.flatnonzero(end[peak:])
    return float(at[low[-1]]) if len(low) else -np.inf, float(at[peak + high[0]]) if len(high) else np.inf


def search_radii(low: float, high: float, mode: float) -> tuple[float, ...]:
    """Radii to search with for discs from `low` to `high`; rather too large than too small (AIAA 2005-5007, II.C)."""
    if high <= 1.15 * mode and low >= 0.85 * mode:
        return (max(round(1.03 * mode, 2), 1.0),)
    count = int(np.ceil(np.log(high / low) / np.log(SEARCH_STEP))) + 1
    radii = np.maximum(np.geomspace(low, 1.03 * high, max(count, 2)), 1.0)
    return tuple(np.unique(np.round(radii, 2)).tolist())


def _none(reason: str) -> RadiusEstimate:
    return RadiusEstimate(float("nan"), (), 0, 0, f"no radius prevails: {reason}; give the radius")
