"""Two fields in one picture: rows of even and of odd number that were taken one after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

MOST = 30
"""Spots that tell it."""
LEAST = 6
"""Spots without which nothing is said."""
SURE = 6.0
"""Sigmas from which a shift is no chance."""
_UNKNOWNS = 3
"""Of the picture: shift in x and y, and what rows in between differ from the mean of their neighbours by."""


@dataclass(frozen=True)
class FieldShift:
    """How far markers lie apart in the two fields of a picture.

    Parameters
    ----------
    xy : (2,) px, from rows of even number to those of odd number; NaN where no spot tells it
    sigma : (2,) standard deviations
    """

    xy: Array
    sigma: Array

    @property
    def sure_px(self) -> float:
        """Length of the shift where one of its coordinates is beyond `SURE` sigmas; 0 where it may be chance."""
        return float(np.hypot(*self.xy)) if (np.abs(self.xy) > SURE * self.sigma).any() else 0.0


UNKNOWN = FieldShift(np.full(2, np.nan), np.full(2, np.nan))


def field_shift(image: ArrayLike, xy: Array, radius_px: float) -> FieldShift:
    """Shift between the fields of an image (H, W) at spots (N, 2), best first, of about one radius.

    A row of the one field is predicted by the mean of the two rows of the other that enclose it. What is left is, to
    first order, the shift times the slopes, and a multiple of the curvature across the rows; a level and a contrast
    that the rows of a field have to themselves (sensors that are read at two sides) are each window's own. Where
    nothing moves, or all rows are taken at once, the shift is nought whatever the spots look like.
    """
    if not radius_px > 0:
        return UNKNOWN
    grey, xy = np.asarray(image), xy[:MOST]
    reach = int(np.ceil(radius_px)) + 3
    # From an even row on: the rows in between are odd, three rows of the other field lie beyond them.
    x0, y0 = np.rint(xy[:, 0]).astype(int) - reach, 2 * (np.rint(xy[:, 1] - reach).astype(int) // 2)
    inside = (x0 >= 0) & (y0 >= 0) & (x0 + 2 * reach < grey.shape[1]) & (y0 + 2 * reach + 3 < grey.shape[0])
    rows = y0[inside, None, None] + np.arange(2 * reach + 4)[None, :, None]
    columns = x0[inside, None, None] + np.arange(2 * reach + 1)[None, None, :]
    windows = grey[rows, columns].astype(float)
    windows = windows[np.isfinite(windows).all(axis=(1, 2))]  # dead pixels of an infrared picture are NaN
    return _solved(windows[:, ::2], windows[:, 1::2]) if len(windows) >= LEAST else UNKNOWN


def _solved(even: Array, odd: Array) -> FieldShift:
    """By (N, R, W) rows of even and of odd number of N windows."""
    left, right, inner = slice(None, -2), slice(2, None), slice(1, -1)
    above, below = even[:, 1:-2], even[:, 2:-1]  # of the odd rows 1 .. R - 3
    mean, found = 0.5 * (above + below), odd[:, 1:-2]
    by_x = 0.5 * (mean[..., right] - mean[..., left])
    by_y = 0.5 * (below - above)[..., inner]  # rows of a field are two pixels apart
    curved = (even[:, :-3] - above - below + even[:, 3:])[..., inner]
    misfit, shown = (found - mean)[..., inner], mean[..., inner]
    count = len(even)
    design = np.stack([-by_x, -by_y, curved], axis=-1).reshape(count, -1, _UNKNOWNS)
    own = np.stack([np.ones_like(shown), shown], axis=-1).reshape(count, -1, 2)
    misfit = misfit.reshape(count, -1, 1)
    # What is each window's own is taken out of all columns.
    basis = np.linalg.qr(own).Q
    design, misfit = (v - basis @ (basis.swapaxes(1, 2) @ v) for v in (design, misfit))
    normal = np.einsum("nki,nkj->ij", design, design)
    moved = np.einsum("nki,nkj->i", design, misfit)
    if not np.linalg.cond(normal) < 1e12:
        return UNKNOWN
    solution = np.linalg.solve(normal, moved)
    # Each window errs as a whole, by where its disc lies between the rows: Liang and Zeger, Biometrika 73 (1986).
    pull = np.einsum("nki,nk->ni", design, misfit[..., 0] - design @ solution)
    inverse = np.linalg.inv(normal)
    cov = inverse @ (pull.T @ pull) @ inverse * count / (count - _UNKNOWNS)
    return FieldShift(solution[:2], np.sqrt(np.maximum(np.diagonal(cov)[:2], 1e-24)))
