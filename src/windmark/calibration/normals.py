"""Normals of markers from their neighbours: where a marker and its neighbours lie in a plane, that is the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]

NEIGHBOURS = 8
"""Neighbours that a plane is fitted to."""
FLAT = 0.05
"""Root mean square distance from the plane, as part of the neighbourhood's width, up to which it is the surface: a
plane fitted there is right within some three degrees. A wrong normal does more harm than none."""


def local_normals(xyz: Array, known: Array, seen_from: Array) -> Array:
    """(N, 3) normals: the known ones, else those of the plane through the neighbours, else NaN.

    Parameters
    ----------
    xyz : (N, 3) markers
    known : (N, 3) normals, NaN where unknown
    seen_from : (V, 3) places of the cameras; normals point to the side that most of them are on
    """
    out = known.copy()
    missing = np.flatnonzero(~np.isfinite(known).all(axis=1) & np.isfinite(xyz).all(axis=1))
    usable = np.flatnonzero(np.isfinite(xyz).all(axis=1))
    if len(usable) <= 4 or not len(missing):
        return out
    near = cKDTree(xyz[usable]).query(xyz[missing], k=min(NEIGHBOURS + 1, len(usable)))[1]
    around = xyz[usable][near]
    center = around.mean(axis=1, keepdims=True)
    _, size, axis = np.linalg.svd(around - center, full_matrices=False)
    flat = size[:, 2] < FLAT * size[:, 1]
    normal = axis[:, 2]
    towards = np.einsum("nvk,nk->nv", seen_from[None] - xyz[missing][:, None], normal)
    normal = normal * np.where((towards > 0).mean(axis=1) >= 0.5, 1.0, -1.0)[:, None]
    out[missing[flat]] = normal[flat]
    return out
