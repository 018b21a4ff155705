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
from windmark.errors import UsageError
from windmark.options.detection import POLARITY

Array = NDArray[np.float64]

MIN_CORE, MIN_WINDOW = 0.8, 0.6  # share of hole and window that must be visible
BAND_ROWS = 256  # taken at a time: the whole image is never there in another type


def merit_map(
    image: ArrayLike, radius_px: float, polarity: str = POLARITY.default, *, mask: ArrayLike | None = None
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
        raise UsageError(f"radius_px must be a radius of at least 1 px, got {radius_px!r}")
    checked = check_image(image)
    use = check_mask(mask, checked.shape)
    sample = usable_sample(checked, use)
    if sample.size == 0:
        return np.full(checked.shape, np.nan, dtype=np.float32)
    levels, discs = levels_of(checked, sign, use, sample), _Discs.of_radius(r0)
    out = np.full(checked.shape, np.nan, dtype=np.float32)
    for first in range(0, len(out), BAND_ROWS):
        _band(checked, use, levels, discs, first, out[first : first + BAND_ROWS])
    if not np.ptp(sample) > 0.0 and not np.isfinite(out).any():
        out[:] = np.inf
    return out


@dataclass(frozen=True)
class _Discs:
    """Window and hole round a pixel's centre.

    Parameters
    ----------
    r0 : radius of the hole
    window, hole : (2 h + 1, 2 h + 1) weights
    window_steps, hole_steps : (T, 5) float32, for `_kernels.merit.merit_rows`
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

    def forms(self, first: int, last: int, rows: int) -> Pixels:
        """Numbers of `_kernels.merit._merit_row` for rows first ... last - 1 of so many; NaN where too few are seen."""
        half = len(self.window) // 2
        d = np.arange(-half, half + 1.0)
        w, t = self.window.sum(axis=1), self.hole.sum(axis=1)
        table = np.stack([w, w * d, w * d * d, self.window @ (d * d), t, t * d, (self.hole**2).sum(axis=1)], axis=1)
        y = np.arange(first, last)[:, None] + d
        n, sy, syy, sxx, t1, ty, tt = (((y >= 0) & (y < rows)).astype(float) @ table).T
        det, area = n * syy - sy * sy, np.pi * self.r0**2
        aa, ac, cc = syy / det, -sy / det, n / det
        free = tt - (aa * t1 * t1 + 2.0 * ac * t1 * ty + cc * ty * ty)
        forms = np.stack([aa, ac, cc, 1.0 / sxx, t1, ty, tt, free], axis=1).astype(np.float32)
        forms[(n < MIN_WINDOW * 4.0 * area) | (t1 < MIN_CORE * area)] = np.nan
        return forms


def _band(
    image: NDArray[np.generic], use: NDArray[np.bool_] | None, levels: Levels, discs: _Discs, first: int, out: Pixels
) -> None:
    """Merit of the rows from `first` on into `out`."""
    from windmark.detection._kernels.map import fill_rows
    from windmark.detection._kernels.merit import merit_pixels

    rows, half = len(image), len(discs.window) // 2
    last, top, bottom = first + len(out), max(first - half, 0), min(first + len(out) + half, rows)
    g, missing = grey_rows(image, use, levels, top, bottom)
    general = np.ones(out.shape, dtype=bool)
    if min(image.shape) > 2 * half:
        a, b = max(first, half), min(last, rows - half)  # rows whose window the image's height holds
        _by_rows(fill_rows(g) if missing else g, discs, rows, (first, a, b, top), out)
        general[:, half:-half] = False
        general[a - first : max(b - first, 0)] = False
        if missing:
            from scipy.ndimage import maximum_filter

            near = maximum_filter(np.isnan(g).view(np.uint8), 2 * half + 1, mode="constant")
            general |= near[first - top : last - top].view(np.bool_)
    where = np.column_stack(np.divmod(np.flatnonzero(general), out.shape[1]))
    merit_pixels(g, where, first - top, discs.r0, MIN_CORE, out)


def _by_rows(g: Pixels, discs: _Discs, rows: int, band: tuple[int, int, int, int], out: Pixels) -> None:
    """Merit of all pixels of a band but those in the image's corners, which lie near two borders.

    `g` starts in row `top` of the image, `out` in row `first`; from row a to b the window is inside. Left and right of
    the image are above and below of its transpose.
    """
    from windmark.detection._kernels.merit import merit_rows

    first, a, b, top = band
    half, columns, steps = len(discs.window) // 2, out.shape[1], (discs.window_steps, discs.hole_steps)
    merit_rows(g, half, *steps, discs.forms(first, first + len(out), rows), first - top, out)
    if b <= a:
        return
    forms = discs.forms(0, 2 * half, 2 * half)  # of a strip along one border
    for x, mine in ((0, slice(0, half)), (columns - 2 * half, slice(half, 2 * half))):
        strip = np.ascontiguousarray(g[a - half - top : b + half - top, x : x + 2 * half].T)
        side = np.empty((half, strip.shape[1]), dtype=np.float32)
        merit_rows(strip, half, *steps, forms[mine], mine.start, side)
        out[a - first : b - first, x + mine.start : x + mine.stop] = side[:, half:-half].T


def _steps(weight: Array) -> Pixels:
    """Steps (T, 5) of `_kernels.merit` for a symmetric table of weights: |dx|, |dy|, weight, second |dy|, weight."""
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
