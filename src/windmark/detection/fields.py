"""Two fields in one picture: rows of even and of odd number that were taken one after the other.

A compression in blocks of 8 x 8 pixels (JPEG) looks alike at one place of four: the last row of a block is like those
above it, and the first one of the next is not, so that a row between is not the mean of its neighbours. In the middle
of a block nothing has moved. Fields have moved at every row: a shift counts only where all four places tell it.
"""

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
BLOCK_PX = 8
"""Rows of a block of a compressed picture."""
SAME, KNOWN = 3.0, 2.0
"""A place of a block speaks against a shift if it shows less than its part, where it knows it at all, or more than so
many times it by so many sigmas."""
_UNKNOWNS = 3
"""Of the picture: shift in x and y, and what rows in between differ from the mean of their neighbours by."""


@dataclass(frozen=True)
class FieldShift:
    """How far markers lie apart in the two fields of a picture.

    Parameters
    ----------
    xy : (2,) px, from rows of even number to those of odd number; NaN where no spot tells it
    sigma : (2,) standard deviations
    parts : (4, 2, 2) the same two, of the rows of odd number at one place of a block each; None: not asked
    """

    xy: Array
    sigma: Array
    parts: Array | None = None

    @property
    def sure_px(self) -> float:
        """Length of the shift where one of its coordinates is beyond `SURE` sigmas, and no place of a block speaks
        against it; 0 where it may be chance or a compression.
        """
        sure = np.abs(self.xy) > SURE * self.sigma
        if self.parts is not None:
            size, shift, sigma = np.abs(self.xy), self.parts[:, 0] * np.sign(self.xy), self.parts[:, 1]
            less, more = (shift < size / SAME) & (sigma < size), shift > SAME * size + KNOWN * sigma
            sure &= ~(less | more).any(axis=0)
        return float(np.hypot(*self.xy)) if sure.any() else 0.0


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
    whole = np.isfinite(windows).all(axis=(1, 2))  # dead pixels of an infrared picture are NaN
    if whole.sum() < LEAST:
        return UNKNOWN
    even, odd = windows[whole, ::2], windows[whole, 1::2]
    found = _solved(even, odd, np.ones(odd.shape[:2]))
    if not found.sure_px:
        return found
    place = (rows[whole, 1::2, 0] % BLOCK_PX) // 2
    parts = [_solved(even, odd, (place == k).astype(float)) for k in range(BLOCK_PX // 2)]
    return FieldShift(found.xy, found.sigma, np.array([[p.xy, p.sigma] for p in parts]))


def _solved(even: Array, odd: Array, weight: Array) -> FieldShift:
    """By (N, R, W) rows of even and of odd number of N windows, of the odd ones those (N, R) with a weight of 1."""
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
    used = np.repeat(weight[:, 1:-2], shown.shape[2], axis=1)[..., None]
    design, own, misfit = design * used, own * used, misfit * used
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
