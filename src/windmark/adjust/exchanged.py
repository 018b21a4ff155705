"""Exchanged identities among gross errors: two marks of one view that fit each other's marker."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

NEAR = 8.0
"""Distance in sigma up to which a mark fits another marker's place."""


def exchanged_pairs(seen: ArrayLike, predicted: ArrayLike, sigma: ArrayLike) -> list[tuple[int, int]]:
    """Pairs (a, b), a < b, of n marks of one view that were exchanged.

    Parameters
    ----------
    seen : (n, 2) where the marks are, in pixels
    predicted : (n, 2) where their markers should be; NaN where that is not known
    sigma : (n,) of the marks, in pixels
    """
    xy, there, size = (np.asarray(v, dtype=float) for v in (seen, predicted, sigma))
    away = np.linalg.norm(xy[:, None] - there[None], axis=2) / size[:, None]
    fits = away < NEAR  # never where nothing is predicted
    return [(int(a), int(b)) for a, b in zip(*np.nonzero(np.triu(fits & fits.T, 1)), strict=True)]
