"""Points of the surface, with their triangles, as a camera sees them."""

from __future__ import annotations

import numpy as np

from windmark.geometry import Camera, Pose
from windmark.resection.casting import single_pose, to_camera_frame
from windmark.resection.nearest import SurfacePoints
from windmark.resection.reasons import FACING_AWAY, HIDDEN, OBLIQUE, VISIBLE
from windmark.resection.visibility import NodeView, checked_angle, hiding_tolerance, is_hidden, look
from windmark.scene import Mesh


def see_surface(
    mesh: Mesh,
    points: SurfacePoints,
    camera: Camera,
    cam_from_model: Pose,
    *,
    max_obliquity_deg: float | None = None,
    tolerance: float | None = None,
) -> NodeView:
    """Where points of the surface are in the image, and which of them the camera sees.

    As `see_nodes`, with the normal of the triangle that holds the point. Points without a place are "outside".

    Parameters
    ----------
    mesh : the surface; it may be the grid on which the points were found in another shape
    points : from `nearest_on_surface`
    camera, cam_from_model, max_obliquity_deg, tolerance : as in `see_nodes`
    """
    pose = single_pose(cam_from_model, "see_surface")
    checked_angle(max_obliquity_deg, "see_surface")
    least = hiding_tolerance(tolerance, mesh, "see_surface")
    xyz = points.on(mesh)
    cam, xy, reason, depth = look(camera, pose, xyz)
    corners = to_camera_frame(pose, mesh.vertices)[mesh.triangles[points.triangle]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    along, across = -np.einsum("nk,nk->n", normal, cam), np.linalg.norm(np.cross(normal, cam), axis=1)
    obliquity = np.where(points.triangle >= 0, np.degrees(np.arctan2(across, along)), np.nan)
    reason[(reason == VISIBLE) & (along <= 0)] = FACING_AWAY
    if max_obliquity_deg is not None:
        reason[(reason == VISIBLE) & (obliquity > max_obliquity_deg)] = OBLIQUE
    asked = np.flatnonzero(reason == VISIBLE)
    vertices_cam = to_camera_frame(pose, mesh.vertices)
    reason[asked[is_hidden(vertices_cam, mesh.triangles, cam[asked], least)]] = HIDDEN
    return NodeView(xy, depth, reason, obliquity, camera.size_px)
