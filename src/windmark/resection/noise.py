"""The noise of a picture by its grey level, from the picture itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

Array = NDArray[np.float64]

BINS = 24
"""Grey levels are told apart in so many groups of equally many pixels."""
LEAST = 200
"""Pixels of a group that are enough for its median."""
MOST_PIXELS = 400_000
"""More pixels are not looked at: rows are left out evenly."""
FAR, ALIKE, STILL = (4, 7, 11, 18), 2.0, 1.25
"""Pixels apart, no period of a pattern being a part of all; times by which the scatter grows from neighbours to one of
these, and may change to the next two."""
NORMAL = 0.1
"""Part of itself by which a quantile of what is normal may be off, beside the median; markers make it 0.12 and more."""
_MEDIAN = 0.6744897501960817
"""Median of |x| of a normal deviate."""


@dataclass(frozen=True)
class NoiseLaw:
    """Variance of one pixel by its grey level v: ``constant + slope v``, at least ``least``.

    Shot noise makes the slope; with a black level the constant may be negative (photon transfer curve). ``alike`` is
    the correlation of the noise of neighbours: 0 where every pixel has its own, near 1 where a picture was made of
    means over several.
    """

    constant: float
    slope: float
    least: float
    alike: float = 0.0

    def variance(self, level: ArrayLike) -> Array:
        """Variance at grey levels (...), NaN kept."""
        return np.maximum(self.constant + self.slope * np.asarray(level, dtype=float), self.least)


def noise_law(image: ArrayLike, *, most: int = MOST_PIXELS, apart: int | None = None) -> NoiseLaw:
    """Noise of a picture by its grey level.

    From the mixed second differences of 3 x 3 pixels, in which every surface that is smooth along rows or along columns
    drops out: slopes, shading, and edges that are straight and upright. Medians in groups of equal grey level, so
    markers and outlines do not count.

    Parameters
    ----------
    image : (H, W), NaN pixels are left out
    most : more pixels than so many are not looked at
    apart : the noise of pixels that are so far apart is independent: 1 of a camera's picture, more of one that was made
        of means over several pixels (`io.APART` of colour interpolated from a mosaic). None asks the picture: one that
        was smoothed or enlarged scatters more over some pixels than between neighbours, and as much beyond. So does
        a fine texture of the surface, which is then taken for noise

    Returns
    -------
    NoiseLaw; of integer pictures at least 1/12 of a grey level squared, the noise of rounding. Noise that is correlated
    from pixel to pixel by less (compressed pictures) is seen up to `ALIKE` times too small.

    Raises
    ------
    ValueError
        For another shape than (H, W).

    Notes
    -----
    Source of the operator: J. Immerkaer, Computer Vision and Image Understanding 64 (1996).

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> light = np.tile(np.linspace(100.0, 900.0, 200), (200, 1))
    >>> image = np.random.default_rng(0).normal(light, np.sqrt(0.04 * light))  # photon noise
    >>> law = wm.noise_law(image)
    >>> round(law.slope, 2)  # variance per grey level
    0.04
    """
    pixels = np.asarray(image)
    if pixels.ndim != 2:
        raise ValueError(f"noise_law: image must be (H, W), got {pixels.shape}")
    least = 1 / 12 if pixels.dtype.kind in "biu" else 0.0
    if apart is not None and not apart >= 1:
        raise ValueError(f"noise_law: apart must be at least 1 pixel, got {apart!r}")
    at = cache(partial(_differences, pixels, most))
    if apart is None:
        apart = _spread_over(at, min(pixels.shape))
    if min(pixels.shape) < 2 * apart + 1:
        return NoiseLaw(least, 0.0, least)
    level, mixed = at(apart)
    law = _fitted(level, mixed, least)
    if apart == 1 or not len(mixed):
        return law
    beside = float(np.median(at(1)[1]))
    return replace(law, alike=max(0.0, 1 - (beside / max(float(np.median(mixed)), 1e-300)) ** 2))


def _spread_over(at: Callable[[int], tuple[Array, Array]], width: int) -> int:
    """Pixels over which the noise of neighbours is alike: so far apart they scatter far more than neighbours do.

    And as much where they are still farther apart: shading scatters more then, a pattern less. And normally: what many
    markers, of which the wider differences have more, make of noise with pixels of its own is not. 1 where there is no
    such distance. ``at`` gives `_differences` of a picture whose shorter side is ``width``.
    """
    if width <= 2 * FAR[-1]:
        return 1
    usual = cache(lambda apart: _usual(at(apart)[1]))
    for k, far in enumerate(FAR[:-2]):
        if not usual(far) > ALIKE * usual(1) > 0:
            continue
        beyond = [usual(apart) for apart in FAR[k + 1 : k + 3]]
        level = max(beyond) < STILL * usual(far) and min(beyond) > usual(far) / STILL
        if level and _is_normal(at(far)[1]):
            return far
    return 1


def _is_normal(mixed: Array) -> bool:
    """Whether the smaller three quarters of differences are those of a normal deviate."""
    shares = np.array([0.1, 0.25, 0.5, 0.75])
    parts = np.quantile(mixed, shares) / ndtri((1 + shares) / 2)
    return bool(np.abs(parts / max(parts[2], 1e-300) - 1).max() < NORMAL)


def _usual(mixed: Array) -> float:
    """Mean of the smallest quarter, which few edges reach; of whole numbers it has more steps than a quantile."""
    count = max(len(mixed) // 4, 1)
    return float(np.partition(mixed, count - 1)[:count].mean()) if len(mixed) else 0.0


def _differences(pixels: NDArray[np.generic], most: int, apart: int) -> tuple[Array, Array]:
    """Grey levels, and the mixed second differences of pixels ``apart`` in units of one pixel's noise."""
    step, far = max(1, int(np.ceil(pixels.size / most))), 2 * apart
    rows = np.arange(apart, pixels.shape[0] - apart, step)
    above, middle, below = (pixels[rows + k].astype(float) for k in (-apart, 0, apart))
    down = above - 2 * middle + below
    mixed = np.abs(down[:, :-far] - 2 * down[:, apart:-apart] + down[:, far:]) / 6
    # The middle column's mean of 3 x 3 is nearly independent of the difference; the pixel itself is not.
    total = above + middle + below
    level = (total[:, :-far] + total[:, apart:-apart] + total[:, far:]) / 9
    good = np.isfinite(mixed)
    return level[good], mixed[good]


def _fitted(level: Array, mixed: Array, least: float) -> NoiseLaw:
    """A line through the groups' variances, each as certain as it is large."""
    if not len(level):
        return NoiseLaw(least, 0.0, least)
    edges = np.unique(np.quantile(level, np.linspace(0, 1, BINS + 1)))
    group = np.clip(np.searchsorted(edges, level, side="right") - 1, 0, max(len(edges) - 2, 0)).astype(np.uint8)
    order = np.argsort(group, kind="stable")
    cuts = np.searchsorted(group[order], np.arange(1, max(len(edges) - 1, 1)))
    groups = [g for g in np.split(order, cuts) if len(g) >= LEAST] or [order]
    v = np.array([np.median(level[g]) for g in groups])
    variance = np.array([(np.median(mixed[g]) / _MEDIAN) ** 2 for g in groups])
    # No difference at all is rounding or a clipped sensor, not a noise of zero.
    known = variance > 0
    floor = max(least, 0.5 * float(variance[known].min()) if known.any() else 0.0)
    if known.sum() < 2 or not np.ptp(v[known]) > 0:
        constant = float(np.median(variance[known])) if known.any() else least
        return NoiseLaw(max(constant, least), 0.0, floor)
    v, variance = v[known], variance[known]
    keep = np.ones(len(v), bool)
    for _ in range(3):  # groups of texture or outlines stand out upwards
        slope, constant = np.polyfit(v[keep], variance[keep], 1, w=1 / variance[keep])
        ratio = variance / np.maximum(constant + slope * v, floor or 1e-300)
        keep = ratio < 1.5 * max(float(np.median(ratio)), 1e-300)
        if keep.sum() < 2:
            break
    if slope < 0:  # noise does not fall with the light: the spread of the groups is chance
        return NoiseLaw(max(float(np.median(variance)), least), 0.0, floor)
    return NoiseLaw(float(constant), float(slope), floor)
