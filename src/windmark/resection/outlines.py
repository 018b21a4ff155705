"""How far the pixels of a picture are from the outline of the surface that they show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.resection.pixelmap import PixelMap, map_pixels
from windmark.scene import Mesh

Array = NDArray[np.float64]

CLIFF = 12.0
"""Neighbouring pixels whose depths differ by more pixel widths are on two surfaces: a slope of 85 degrees."""
FOLD_DEG = 15.0
"""Two pieces of surface that meet at a larger angle run into each other (a wing into a body); at a smaller one they are
blocks of one surface that overlap."""


def inside_px(mesh: Mesh, camera: Camera, cam_from_mesh: Pose) -> Array:
    """(H, W) distance of every pixel to the nearest one of the surface's outline, in pixels; 0 off the surface.

    An outline is where the surface ends, passes before another part of itself, or where two pieces of it
    (`Mesh.pieces`) run into each other: its two sides have nothing in common, and a lens mixes them. The image's border
    is none.
    """
    return outline_distance(map_pixels(mesh, camera, cam_from_mesh, cull_backfaces=True))


def outline_distance(pixels: PixelMap) -> Array:
    """`inside_px` of a view that is mapped already."""
    from scipy.ndimage import distance_transform_edt

    whole = pixels.valid.copy()
    if not whole.any():
        return np.zeros(whole.shape)
    depth = np.where(whole, pixels.depth(), np.inf)
    with np.errstate(invalid="ignore"):  # beside the surface: infinite less infinite
        across, down = (np.abs(np.diff(depth, axis=a)) > CLIFF * depth.min() / pixels.camera.focal_px for a in (1, 0))
    for jump, folded in zip((across, down), _folds(pixels), strict=True):
        jump |= folded
    for part, jump in ((np.s_[:, :-1], across), (np.s_[:, 1:], across), (np.s_[:-1], down), (np.s_[1:], down)):
        whole[part] &= ~jump
    return np.asarray(distance_transform_edt(whole)) if not whole.all() else np.full(whole.shape, np.inf)


def _folds(pixels: PixelMap) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Between which neighbours across and down two pieces of the surface meet at an angle."""
    shape, seen = pixels.valid.shape, np.where(pixels.valid, pixels.triangle, -1)
    piece = pixels.mesh.pieces
    none = np.zeros((shape[0], shape[1] - 1), bool), np.zeros((shape[0] - 1, shape[1]), bool)
    if len(np.unique(piece[seen[seen >= 0]])) < 2:
        return none
    normal = pixels.mesh.triangle_normals()
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    for out, one, other in ((none[0], seen[:, :-1], seen[:, 1:]), (none[1], seen[:-1], seen[1:])):
        where = np.flatnonzero((one >= 0) & (other >= 0) & (piece[one] != piece[other]))
        a, b = one.ravel()[where], other.ravel()[where]
        out.ravel()[where] = (normal[a] * normal[b]).sum(axis=1) < np.cos(np.radians(FOLD_DEG))
    return none
