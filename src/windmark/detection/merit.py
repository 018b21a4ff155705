"""The merit map of the whole image, for pictures and for checking the search."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.image import check_image, check_polarity, prepare

Array = NDArray[np.float64]

MIN_CORE = 0.8


def merit_map(
    image: ArrayLike, radius_px: float, polarity: str = "dark", *, mask: ArrayLike | None = None
) -> NDArray[np.float32]:
    """Merit m of an inverse top-hat centred on every pixel (AIAA 2005-5007, section II.B).

    With the slope-removed correlation rho of window and top-hat, m^2 = kappa (1 / rho^2 - 1), kappa = |t'|^2 / |t|^2
    (t the top-hat, t' the same without its slope), 3/4 but for the pixels' coarseness.

    Parameters
    ----------
    image : (H, W) grey levels, any real type; pixels that are not finite are left out
    radius_px : reference radius r0, at least 1
    polarity : "dark" or "bright" markers
    mask : (H, W), only pixels where it is true (not 0) are used

    Returns
    -------
    (H, W) float32, inf where there is no hole (hill or flat), NaN where less than 80 % of the hole or 60 % of the
    window of radius 2 r0 is visible
    """
    from windmark.detection._kernels_map import merit_pixels, merit_rows

    sign = check_polarity(polarity)
    r0 = float(radius_px)
    if not (np.isfinite(r0) and r0 >= 1.0):
        raise ValueError(f"radius_px must be a radius of at least 1 px, got {radius_px!r}")
    checked = check_image(image)
    prepared = prepare(checked, sign, mask)
    if prepared is None:
        return np.full(checked.shape, np.inf if np.isfinite(checked).any() else np.nan, dtype=np.float32)
    out = np.full(checked.shape, np.nan, dtype=np.float32)
    runs, soft, window = _pile(2.0 * r0)
    core_runs, core_soft, core = _pile(r0)
    half = runs.size // 2
    sums = np.array([window[0], window[1], core[0], core[2]])
    general = np.ones(checked.shape, dtype=bool)
    if min(checked.shape) > 2 * half:
        merit_rows(prepared.filled, runs, soft, core_runs, core_soft, sums, out)
        general[half:-half, half:-half] = False
        if prepared.filled is not prepared.g:
            general |= _near(np.isnan(prepared.g), half)
    merit_pixels(prepared.g, np.argwhere(general), r0, MIN_CORE, out)
    return out


def _pile(radius: float) -> tuple[NDArray[np.int64], Array, Array]:
    """A soft-edged disc: full rows, a quarter of its soft pixels, and its sums n, sum x^2, sum of squares.

    Soft pixels are |dx|, |dy| and the weight of each of the four (+-dx, +-dy); on an axis those fall together.
    """
    half = int(radius + 0.5)
    y, x = np.mgrid[-half : half + 1, -half : half + 1].astype(float)
    weight = np.clip(radius - np.hypot(x, y) + 0.5, 0.0, 1.0)
    full = weight == 1.0
    runs = np.where(full.any(axis=1), full.sum(axis=1) // 2, -1)
    edge = (weight > 0.0) & ~full & (x >= 0) & (y >= 0)
    shared = np.where(x == 0, 0.5, 1.0) * np.where(y == 0, 0.5, 1.0)
    soft = np.column_stack([x[edge], y[edge], (weight * shared)[edge]])
    return runs, soft, np.array([weight.sum(), (weight * x * x).sum(), (weight**2).sum()])


def _near(mask: NDArray[np.bool_], half: int) -> NDArray[np.bool_]:
    """Pixels within a square of half width `half` of a true one."""
    grown = mask
    for axis in (0, 1):
        count = np.cumsum(np.pad(grown, [(half + 1, half) if a == axis else (0, 0) for a in (0, 1)]), axis=axis)
        n = mask.shape[axis]
        ahead, behind = (
            np.take(count, np.arange(2 * half + 1, 2 * half + 1 + n), axis),
            np.take(count, np.arange(n), axis),
        )
        grown = ahead > behind
    return grown
