"""Markers without a spot beside a spot without a marker: the table has them at another place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import gammaincc

Array = NDArray[np.float64]

CHANCE = 0.01
"""Chance, for all such markers together, of a false spot so near to a marker's place."""


def nearest_spots(place: Array, spots: Array, size_px: tuple[int, int]) -> tuple[Array, Array]:
    """Distance of each place from its nearest spot (A,), and the chance of a spot so near (A,).

    Spots that are none of the markers are as dense as they are in the whole image, spread at random: so many of them
    are expected within a circle round a place. Without spots the distances are infinite and the chances 1.

    Parameters
    ----------
    place : (A, 2) where markers should be that have no spot, pixels
    spots : (F, 2) spots that no marker has
    size_px : (width, height) of the image
    """
    if not len(place) or not len(spots):
        return np.full(len(place), np.inf), np.ones(len(place))
    nearest = np.asarray(cKDTree(spots).query(place)[0])
    return nearest, np.minimum(np.pi * nearest**2 * len(spots) / float(np.prod(size_px)), 1.0)


def together(chances: Sequence[float]) -> float:
    """Chance that pictures which have nothing to do with each other all show a spot as near as they do, or nearer.

    By Fisher's method: the product of n chances that are uniform from 0 to 1 is below x with gammaincc(n, -ln x).
    """
    size = -float(np.sum(np.log(np.maximum(chances, 1e-300))))
    return float(gammaincc(len(chances), size))
