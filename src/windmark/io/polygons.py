"""Polygons as triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.int64]


def fan_triangles(sizes: Indices) -> tuple[Indices, Indices]:
    """Split polygons into fans from their first corner; right for convex ones, as surface grids have.

    Parameters
    ----------
    sizes : (F,) corners of each polygon, whose corners are listed one polygon after the other

    Returns
    -------
    corners : (T, 3) positions in that list
    face : (T,) the polygon of each triangle; polygons of fewer than three corners give none
    """
    count = np.maximum(sizes - 2, 0)
    face = np.repeat(np.arange(len(sizes)), count)
    first = (np.cumsum(sizes) - sizes)[face]
    step = np.arange(len(face)) - (np.cumsum(count) - count)[face]
    return np.stack([first, first + step + 1, first + step + 2], axis=1), face
