"""Pictures that show what another one shows, noise and all: a recording that dropped one, or a file under two names."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAST = 6
"""Fewer spots in common say nothing."""
PART, MOST = 0.1, 0.75
"""So much of their noise this part of the spots of two pictures of one scene differs by in 1 of 10^11 cases, or less
often; the others may have been fitted in another window, from another start."""
ONCE_MORE = "its spots do not differ by a tenth of their noise"
"""Why a picture is taken for another one once more; stands in every sentence that says so."""


def is_repeated(point_a: Ints, xy_a: Array, point_b: Ints, xy_b: Array, sigma_px: float) -> bool:
    """Whether two pictures are one, by the spots (K,), (K, 2) and (L,), (L, 2) of their markers.

    ``sigma_px`` is that of a spot, per coordinate. Of an instant that was taken twice the noise differs: by a tenth of
    it in both coordinates one spot does in 1 of 300 cases.
    """
    _, i, j = np.intersect1d(point_a, point_b, assume_unique=True, return_indices=True)
    same = np.abs(xy_a[i] - xy_b[j]).max(axis=1, initial=0.0) < PART * sigma_px
    return bool(len(i) >= LEAST and same.mean() >= MOST)
