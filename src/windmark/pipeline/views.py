"""Virtual cameras that frame a surface: a top view, a side view, the reference image's PoV."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import DataError
from windmark.geometry import Camera, Pose

MARGIN = 0.03
"""Empty border of a framed view, fraction of the image."""


def frame_view(
    xyz: NDArray[np.float64],
    *,
    direction: ArrayLike,
    up: ArrayLike,
    size_px: tuple[int, int],
    fov_deg: float = 2.0,
) -> tuple[Camera, Pose]:
    """A perfect camera that looks along ``direction`` and just holds all points ``xyz`` (N, 3).

    A narrow field of view (2 degrees) is nearly a parallel projection, so lengths can be measured in
    the picture: one pixel is ``distance / focal_px`` length units at the middle of the points.

    Raises
    ------
    ValueError
        When there are no points, or ``up`` is parallel to ``direction``.
    """
    if not len(xyz):
        raise DataError("frame_view: there are no points to frame")
    width, height = size_px
    camera = perfect_camera(size_px, fov_deg)
    focal = camera.focal_px
    ahead = np.asarray(direction, dtype=float)
    turned = Pose.look_at(np.zeros(3), ahead, up)
    p = turned.rotate(xyz)
    half_x, half_y = (1 - 2 * MARGIN) * width / (2 * focal), (1 - 2 * MARGIN) * height / (2 * focal)
    # A point p is inside when |p.x - c.x| <= half_x (p.z - c.z), the same for y: each bound is linear in
    # the camera's place c, so the nearest such c follows from the extremes of x +- half_x z.
    right, left = (p[:, 0] - half_x * p[:, 2]).max(), (p[:, 0] + half_x * p[:, 2]).min()
    low, high = (p[:, 1] - half_y * p[:, 2]).max(), (p[:, 1] + half_y * p[:, 2]).min()
    near = p[:, 2].min()
    z = min((left - right) / (2 * half_x), (high - low) / (2 * half_y), near - 1e-3 * (np.ptp(p) or 1.0))
    center = np.array([(left + right) / 2, (low + high) / 2, z])
    return camera, Pose(turned.rotation, -center)


def perfect_camera(size_px: tuple[int, int], fov_deg: float) -> Camera:
    """A camera without a lens' faults; ``fov_deg`` is the full horizontal field of view."""
    return Camera(size_px=size_px, focal_px=size_px[0] / (2 * np.tan(np.radians(fov_deg) / 2)))


def units_per_px(camera: Camera, cam_from_model: Pose, xyz: NDArray[np.float64]) -> float:
    """Length units per pixel of a view at the mean depth of the points before it; NaN where none is."""
    depth = cam_from_model.apply(xyz)[:, 2]
    depth = depth[depth > 0]
    return float(np.mean(depth) / camera.focal_px) if len(depth) else float("nan")
