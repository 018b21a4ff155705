"""The merit map of the whole image, for pictures and for checking the search."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.image import (
    Levels,
    Pixels,
    check_image,
    check_mask,
    check_polarity,
    grey_rows,
    levels_of,
    usable_sample,
)

Array = NDArray[np.float64]

MIN_CORE, MIN_WINDOW = 0.8, 0.6  # share of hole and window that must be visible
BAND_ROWS = 256  # taken at a time: the whole image is never there in another type


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
    sign = check_polarity(polarity)
    r0 = float(radius_px)
    if not (np.isfinite(r0) and r0 >= 1.0):
        raise ValueError(f"radius_px must be a radius of at least 1 px, got {radius_px!r}")
    checked = check_image(image)
    use = check_mask(mask, checked.shape)
    sample = usable_sample(checked, use)
    if sample.size == 0:
        return np.full(checked.shape, np.nan, dtype=np.float32)
    levels, discs = levels_of(checked, sign, use, sample), _Discs.of_radius(r0)
    out, varies = np.full(checked.shape, np.nan, dtype=np.float32), False
    for first in range(0, len(out), BAND_ROWS):
        varies |= _band(checked, use, levels, discs, first, out[first : first + BAND_ROWS])
    if not varies and len({float(v) for v in sample}) == 1:
        out[:] = np.inf
    return out


@dataclass(frozen=True)
class _Discs:
    """Window and hole round a pixel's centre.

    Parameters
    ----------
    r0 : radius of the hole
    window, hole : (2 h + 1, 2 h + 1) weights
    window_steps, hole_steps : (T, 5) float32, for `_kernels_merit.merit_rows`
    """

    r0: float
    window: Array
    hole: Array
    window_steps: Pixels
    hole_steps: Pixels

    @staticmethod
    def of_radius(r0: float) -> _Discs:
        half = int(2.0 * r0 + 0.5)
        y, x = np.mgrid[-half : half + 1, -half : half + 1].astype(float)
        window, hole = (np.clip(r - np.hypot(x, y) + 0.5, 0.0, 1.0) for r in (2.0 * r0, r0))
        return _Discs(r0, window, hole, _steps(window), _steps(hole))

    def form(self, above: int, below: int) -> Array:
        """Numbers of `_merit_row` where so many rows lie in the image above and below; NaN where that is too few."""
        half = len(self.window) // 2
        dy, dx = np.mgrid[-half : half + 1, -half : half + 1]
        seen = (dy >= -above) & (dy <= below)
        q, t = np.where(seen, self.window, 0.0), np.where(seen, self.hole, 0.0)
        n, sy, syy, sxx = q.sum(), (q * dy).sum(), (q * dy * dy).sum(), (q * dx * dx).sum()
        t1, ty, tt = t.sum(), (t * dy).sum(), (t * t).sum()
        area = np.pi * self.r0**2
        if n < MIN_WINDOW * 4.0 * area or t1 < MIN_CORE * area:
            return np.full(8, np.nan)
        aa, ac, cc = np.array([syy, -sy, n]) / (n * syy - sy * sy)
        free = tt - (aa * t1 * t1 + 2.0 * ac * t1 * ty + cc * ty * ty)
        return np.array([aa, ac, cc, 1.0 / sxx, t1, ty, tt, free])

    def forms(self, first: int, last: int, rows: int) -> Pixels:
        """`form` of the rows first ... last - 1 of an image of so many rows."""
        half = len(self.window) // 2
        inside = [(min(y, half), min(rows - 1 - y, half)) for y in range(first, last)]
        known = {key: self.form(*key) for key in set(inside)}
        return np.array([known[key] for key in inside], dtype=np.float32).reshape(-1, 8)


def _band(
    image: NDArray[np.generic], use: NDArray[np.bool_] | None, levels: Levels, discs: _Discs, first: int, out: Pixels
) -> bool:
    """Merit of the rows from `first` on into `out`; whether the grey levels there differ."""
    from windmark.detection._kernels_map import fill_rows
    from windmark.detection._kernels_merit import merit_pixels, merit_rows

    (rows, columns), half = image.shape, len(discs.window) // 2
    last, top, bottom = first + len(out), max(first - half, 0), min(first + len(out) + half, rows)
    g, missing = grey_rows(image, use, levels, top, bottom)
    filled = fill_rows(g) if missing else np.ascontiguousarray(g)
    general = np.ones(out.shape, dtype=bool)
    if min(rows, columns) > 2 * half:
        steps = half, discs.window_steps, discs.hole_steps
        merit_rows(filled, *steps, discs.forms(first, last, rows), first - top, out)
        a, b = max(first, half), min(last, rows - half)  # rows whose window the image's height holds
        inner = slice(a - first, b - first)
        if b > a:
            for x, start in ((0, 0), (columns - half, half)):
                strip = filled[a - half - top : b + half - top, x - start : x - start + 2 * half]
                strip = np.ascontiguousarray(strip.T)
                side = np.empty((half, strip.shape[1]), dtype=np.float32)
                merit_rows(strip, *steps, discs.forms(x, x + half, columns), start, side)
                out[inner, x : x + half] = side[:, half:-half].T
            general[inner] = False
        general[:, half:-half] = False
        if missing:
            from scipy.ndimage import maximum_filter

            near = maximum_filter(np.isnan(g).view(np.uint8), 2 * half + 1, mode="constant")
            general |= near[first - top : last - top].view(np.bool_)
    merit_pixels(g, np.argwhere(general), first - top, discs.r0, MIN_CORE, out)
    return bool(np.fmin.reduce(g, axis=None) < np.fmax.reduce(g, axis=None))


def _steps(weight: Array) -> Pixels:
    """Steps (T, 5) of `_kernels_merit` for a symmetric table of weights: |dx|, |dy|, weight, second |dy|, weight."""
    half = len(weight) // 2
    quarter = weight[half:, half:]
    reach = int(np.flatnonzero(quarter[0])[-1])
    change = quarter - np.pad(quarter, ((0, 0), (0, 1)))[:, 1:]
    rows = []
    for d in range(reach, -1, -1):
        k = np.flatnonzero(change[:, d])
        k = k if len(k) else np.zeros(1, dtype=np.int64)
        for i in range(0, len(k), 2):
            second = k[min(i + 1, len(k) - 1)]
            rows.append([d, k[i], change[k[i], d], second, change[second, d] if i + 1 < len(k) else 0.0])
    return np.array(rows, dtype=np.float32)
