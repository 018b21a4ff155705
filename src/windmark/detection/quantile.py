"""Quantiles of weighted values."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def weighted_quantile(values: Array, weight: Array, share: float) -> Any:
    """Smallest of the values (..., K) up to which lies at least `share` of the weight (..., K): (...)."""
    order = np.argsort(values, axis=-1)
    sums = np.cumsum(np.take_along_axis(weight, order, -1), axis=-1)
    first = (sums >= share * sums[..., -1:]).argmax(axis=-1)
    return np.take_along_axis(values, np.take_along_axis(order, first[..., None], -1), -1)[..., 0]
