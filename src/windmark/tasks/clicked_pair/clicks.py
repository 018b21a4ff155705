"""Matches by hand, and the spots that they mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.errors import UsageError
from windmark.scene import Detections

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SNAP_PX = 10.0
"""A click means the nearest spot within so many pixels."""


@dataclass(frozen=True)
class Clicks:
    """Matches by hand: places (N, 2) in both pictures, their names, and whether the user gave those."""

    xy_a: Array
    xy_b: Array
    name: tuple[str, ...]
    named: bool = False


def snapped(spots: Detections, xy: Array, names: Sequence[str], which: str) -> Ints:
    """The spot (N,) that each click means, -1 for none."""
    if not len(spots):
        return np.full(len(xy), -1)
    far, spot = cKDTree(spots.xy).query(xy)
    spot = np.where(far <= SNAP_PX, spot, -1)
    found, count = np.unique(spot[spot >= 0], return_counts=True)
    if (count > 1).any():
        twice = [names[k] for k in np.flatnonzero(spot == found[count > 1][0]).tolist()]
        raise UsageError(f"clicks {' and '.join(twice)} mean the same spot of the {which} picture; expected one click "
                         "for each")  # fmt: skip
    return np.asarray(spot, np.int64)
