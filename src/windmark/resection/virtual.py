"""Virtual images: what a real image shows, redrawn from another point of view."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry import Camera, Pose
from windmark.resection.casting import single_pose, to_camera_frame
from windmark.resection.pixelmap import PixelMap, interpolate_at, sight_cosines
from windmark.resection.reasons import FACING_AWAY, HIDDEN, OBLIQUE, VISIBLE
from windmark.resection.sampling import Image, checked_image, node_values
from windmark.resection.visibility import NodeView, checked_angle, hiding_tolerance, is_hidden, look
from windmark.scene import Mesh
from windmark.scene.shown import ARRAY, check_kinds


def virtual_image(
    image: ArrayLike,
    pixel_map: PixelMap,
    camera: Camera,
    cam_from_model: Pose,
    *,
    mesh: Mesh | None = None,
    interpolation: str = "cubic",
    max_obliquity_deg: float | None = None,
    tolerance: float | None = None,
) -> tuple[Image, NDArray[np.bool_]]:
    """The image as it would look from the virtual point of view of ``pixel_map``.

    Each virtual pixel's surface point is looked up in the real image: images of a model that moved,
    or from several cameras, come out in one and the same frame (3D alignment).

    Parameters
    ----------
    image : (H, W) or (H, W, C), the real image
    pixel_map : of the virtual view, from `map_pixels`
    camera, cam_from_model : of the real image
    mesh : the grid in the shape it had when the image was taken (deformed under load): the nodes and
        triangles of ``pixel_map.mesh`` with other coordinates. None: the same shape
    interpolation : see `interpolate_image`
    max_obliquity_deg : leave out what the real camera sees more obliquely than this
    tolerance : see `see_nodes`

    Returns
    -------
    image : float32 of the virtual camera's size, NaN where not valid
    valid : bool, where the virtual pixel sees the model, the real camera sees the same side of the same
        place, and the image has a value there

    Raises
    ------
    ValueError
        For an image that is not the camera's size, another grid, or an option out of range.

    Notes
    -----
    Source: AIAA 2005-5007, section III.D. From the image's own point of view the image itself comes
    back. The image is sampled at points, not averaged over the virtual pixel: a virtual view that is
    much coarser than the image should be drawn finer and then averaged. Next to outlines of the model
    the image's own pixels mix two surfaces: blank them first with `silhouette`.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> camera = wm.Camera((64, 48), 60.0)
    >>> here, there = (wm.Pose.look_at([x, 0.0, 4.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]) for x in (0.0, 1.0))
    >>> seen_from_there = wm.map_pixels(plate, camera, there)
    >>> picture, valid = wm.virtual_image(np.full((48, 64), 5.0), seen_from_there, camera, here)
    >>> float(picture[24, 32]), bool(valid[0, 0])
    (5.0, False)
    """
    check_kinds(
        "virtual_image", image=(image, ARRAY), pixel_map=(pixel_map, PixelMap), camera=(camera, Camera),
        cam_from_model=(cam_from_model, Pose),
    )  # fmt: skip
    pixels = checked_image(image, camera.size_px, "virtual_image")
    view = see_pixels(
        pixel_map, camera, cam_from_model, mesh=mesh, max_obliquity_deg=max_obliquity_deg, tolerance=tolerance
    )
    out = pixel_map.to_image(node_values(pixels, view, interpolation=interpolation))
    known = np.isfinite(out)
    return out, known if out.ndim == 2 else known.all(axis=-1)


def see_pixels(
    pixel_map: PixelMap,
    camera: Camera,
    cam_from_model: Pose,
    *,
    mesh: Mesh | None = None,
    max_obliquity_deg: float | None = None,
    tolerance: float | None = None,
) -> NodeView:
    """Where another camera sees the surface points of a pixel map, and which of them.

    The geometry of `virtual_image` without the image; for sequences it is made once:
    ``pixel_map.to_image(node_values(frame, view))``, with `NodeView.follow` where the model moves.

    Returns
    -------
    NodeView of the valid pixels of ``pixel_map``, in row-major order. "facing_away": the camera is on
    the other side of the triangle than the virtual one, whatever the triangle's orientation.
    ``obliquity_deg`` is that of the side the virtual camera sees.

    Parameters and errors as in `virtual_image`.
    """
    pose = single_pose(cam_from_model, "see_pixels")
    checked_angle(max_obliquity_deg, "see_pixels")
    grid = pixel_map.same_grid(mesh)
    least = hiding_tolerance(tolerance, grid, "see_pixels")
    found = pixel_map.valid
    triangle, weights, triangles = pixel_map.triangle[found], pixel_map.barycentric[found], grid.triangles
    vertices_cam = to_camera_frame(pose, grid.vertices)
    points, xy, reason, depth = look(camera, pose, interpolate_at(triangles, grid.vertices, triangle, weights))
    side = np.sign(_virtual_cosines(pixel_map, triangle, weights))
    cosine = side * sight_cosines(vertices_cam, triangles, points, triangle)
    reason[(reason == VISIBLE) & ~(cosine > 0)] = FACING_AWAY
    obliquity = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    if max_obliquity_deg is not None:
        reason[(reason == VISIBLE) & (obliquity > max_obliquity_deg)] = OBLIQUE
    asked = np.flatnonzero(reason == VISIBLE)
    reason[asked[is_hidden(vertices_cam, triangles, points[asked], least)]] = HIDDEN
    return NodeView(xy, depth, reason, obliquity, camera.size_px)


def _virtual_cosines(pixel_map: PixelMap, triangle: NDArray[np.int32], weights: NDArray[np.float64]
                     ) -> NDArray[np.float64]:  # fmt: skip
    mesh = pixel_map.mesh
    vertices_cam = to_camera_frame(pixel_map.cam_from_model, mesh.vertices)
    points = interpolate_at(mesh.triangles, vertices_cam, triangle, weights)
    return sight_cosines(vertices_cam, mesh.triangles, points, triangle)
