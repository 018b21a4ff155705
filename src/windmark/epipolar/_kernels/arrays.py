"""What the kernels see of the views and of their spots; everything in ideal coordinates (no lens, focal length 1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Stations(NamedTuple):
    """V views: where they stand, how well that is known, and what they can see.

    ``rotation`` (V, 3, 3), ``translation`` (V, 3): cam_from_model; ``center`` (V, 3); ``pose_cov`` (V, 6, 6) of
    ``exp(delta) @ cam_from_model``; ``low``, ``high`` (V, 2): the picture's borders; ``near``, ``far`` (V,): depths
    between which points are looked for; ``order`` (V, V): for each view the views, nearest first (itself included).
    """

    rotation: Array
    translation: Array
    center: Array
    pose_cov: Array
    low: Array
    high: Array
    near: Array
    far: Array
    order: Ints


class Spots(NamedTuple):
    """S spots of all views, view after view, and a raster of cells in every view.

    ``views`` (S,); ``start`` (V + 1,) first spot of each view; ``xy`` (S, 2); ``cov`` (S, 3) as xx, xy, yy;
    ``density`` (S,) of the spots round each, per unit area; ``crowd`` (V,) the largest of them in each view,
    ``widest`` (V,) the largest variance of a spot. Cells of a view are numbered ``base + row columns +
    column``: ``base`` (V,), ``shape`` (V, 2) columns and rows, ``origin`` (V, 2), ``cell`` (V,) width;
    ``first`` (cells + 1,) into ``member`` (S,).
    """

    views: Ints
    start: Ints
    xy: Array
    cov: Array
    density: Array
    crowd: Array
    widest: Array
    base: Ints
    shape: Ints
    origin: Array
    cell: Array
    first: Ints
    member: Ints
