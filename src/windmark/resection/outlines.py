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


def inside_px(mesh: Mesh, camera: Camera, cam_from_mesh: Pose) -> Array:
    """(H, W) distance of every pixel to the nearest one of the surface's outline, in pixels; 0 off the surface.

    An outline is where the surface ends, or passes before another part of itself. The image's border is none.
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
    for part, jump in ((np.s_[:, :-1], across), (np.s_[:, 1:], across), (np.s_[:-1], down), (np.s_[1:], down)):
        whole[part] &= ~jump
    return np.asarray(distance_transform_edt(whole)) if not whole.all() else np.full(whole.shape, np.inf)
