"""Pixels on the model's outline, where one pixel mixes two surfaces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.resection.casting import for_kernels, to_camera_frame
from windmark.resection.pixelmap import PixelMap


def silhouette(pixel_map: PixelMap, *, width_px: float = 1.0, step_px: float = 2.0) -> NDArray[np.bool_]:
    """The pixels next to an outline: of the model against the background, or of one part before another.

    Such pixels mix the light of two surfaces, and interpolation carries it further. Blanked in the
    *real* image they do no harm, because all sampling leaves out NaN:
    ``image = np.where(silhouette(map_pixels(mesh, camera, pose), width_px=1.5), np.nan, image)``.

    Parameters
    ----------
    pixel_map : of the view whose pixels are asked for
    width_px : pixels whose centre is nearer than this to an outline, >= 1 (the outline is known to half
        a pixel); add the blur of the image and the error of the pose
    step_px : steps in depth below this many pixel sizes are no outline

    Returns
    -------
    (H, W) bool, True on both sides of outlines. Creases and borders between triangles are not outlines.

    Raises
    ------
    ValueError
        For a width below 1 or a negative step.
    """
    from windmark.resection import _points

    if not width_px >= 1:
        raise UsageError(f"silhouette: width_px must be at least 1, got {width_px}")
    if not step_px >= 0:
        raise UsageError(f"silhouette: step_px must be >= 0, got {step_px}")
    mesh = pixel_map.mesh
    vertices_cam = to_camera_frame(pixel_map.cam_from_model, mesh.vertices)
    step = step_px / pixel_map.camera.focal_px
    out = np.zeros(pixel_map.triangle.shape, bool)
    _points.silhouette(vertices_cam, for_kernels(mesh.triangles), pixel_map.triangle, pixel_map.barycentric, step, out)
    return _widened(out, width_px - 0.5) if out.any() and width_px >= 1.5 else out


def _widened(marked: NDArray[np.bool_], radius_px: float) -> NDArray[np.bool_]:
    from scipy.ndimage import distance_transform_edt

    return distance_transform_edt(~marked) <= radius_px
