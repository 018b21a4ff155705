"""What is exactly true of each marker in an image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.geometry.discs import tangent
from windmark.scene import MarkerSet, Mesh
from windmark.synth.screen import Rays, Screen, sample_offsets

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

VISIBLE_FRACTION = 0.9
"""Share of the disc that must be seen for a marker to count as visible."""

OWN_SURFACE = 1.5
"""A hit on the marker's volume within this many radii of its centre is the surface that carries it."""

_SAMPLES = 91


@dataclass(frozen=True)
class MarkerTruth:
    """N markers of one image, in the order of the marker set.

    Parameters
    ----------
    xy : (N, 2) projection of the disc's centre in pixels, NaN where it has none; it may lie outside the image
    ellipse_xy : (N, 2) centroid of the disc's image (what a detector measures), lens included
    axes_px, angle : (N, 2), (N,) half axes (large first) and direction from x towards y of the ellipse
        with the second moments of the disc's image
    depth : (N,) z in the camera's frame
    tilt : (N,) angle between the normal and the direction to the camera, radians
    facing, in_image : (N,) tilt below 90 degrees; centre inside the image
    fraction : (N,) share of the disc that is in the image and not hidden, 0 where not facing
    visible : (N,) facing, in the image and fraction >= `VISIBLE_FRACTION`
    """

    xy: Array
    ellipse_xy: Array
    axes_px: Array
    angle: Array
    depth: Array
    tilt: Array
    facing: Mask
    in_image: Mask
    fraction: Array
    visible: Mask

    def __len__(self) -> int:
        return len(self.xy)


def marker_truth(
    markers: MarkerSet, camera: Camera, cam_from_markers: Pose, mesh: Mesh | None = None, screen: Screen | None = None
) -> MarkerTruth:
    """Project markers exactly.

    Parameters
    ----------
    markers : with radius and normal (NaN radius or normal: no ellipse, always facing)
    camera, cam_from_markers : the view
    mesh : what may hide the markers, in the markers' frame; None: nothing hides them
    screen : the same mesh already before the camera, saves time
    """
    center = cam_from_markers.apply(markers.xyz)
    normal = cam_from_markers.rotate(markers.normal)
    xy, _ = camera.project(center)
    toward = -(center * normal).sum(axis=1) / np.linalg.norm(center, axis=1)
    tilt = np.arccos(np.clip(toward, -1, 1))
    facing = ~(toward <= 0) & (center[:, 2] > 0)
    in_image = camera.in_image(xy)
    seen = imaged_ellipse(camera, center, normal, markers.radius, cam_from_markers.rotate_form(markers.curvature))
    if mesh is not None and screen is None:
        screen = Screen.of(mesh, camera, cam_from_markers, Rays.of(camera).bend)
    fraction = _fractions(markers, camera, center, normal, facing, screen)
    visible = facing & in_image & (fraction >= VISIBLE_FRACTION)
    return MarkerTruth(xy, seen.xy, seen.axes_px, seen.angle, center[:, 2], tilt, facing, in_image, fraction, visible)


def _fractions(
    markers: MarkerSet, camera: Camera, center: Array, normal: Array, facing: Mask, screen: Screen | None
) -> Array:
    """Share of each disc's samples that are in the image and whose nearest surface is the disc's own."""
    k = np.arange(_SAMPLES)
    # Vogel's spiral: equal areas round the disc.
    rho, phi = np.sqrt((k + 0.5) / _SAMPLES)[:, None], (k * np.pi * (3 - np.sqrt(5)))[:, None]
    out = np.zeros(len(markers))
    code = None if screen is None else screen.volume_code(markers.volume)
    for m in np.flatnonzero(facing):
        radius = np.nan_to_num(markers.radius[m])
        a = tangent(normal[m : m + 1])[0] if np.isfinite(normal[m]).all() else np.zeros(3)
        b = np.cross(normal[m], a) if a.any() else a
        points = center[m] + radius * rho * (np.cos(phi) * a + np.sin(phi) * b)
        xy, valid = camera.project(points)
        seen = valid & camera.in_image(xy)
        if screen is not None and code is not None and seen.any():
            # A marker of unknown radius still has to lie on its surface: within a thousandth of the distance.
            gate = OWN_SURFACE * radius if radius > 0 else 1e-3 * center[m, 2]
            seen &= _own(screen, points, xy, seen, center[m], code[m], gate)
        out[m] = seen.mean()
    return out


def _own(screen: Screen, points: Array, xy: Array, seen: Mask, center: Array, code: int, gate: float) -> Mask:
    """Whether the ray of each point meets the disc's own surface first."""
    from windmark.synth._kernels import cast

    x, y = xy[seen, 0], xy[seen, 1]
    box = screen.boxes
    near = (box[:, 0] <= x.max() + 1) & (box[:, 1] >= x.min() - 1) & (box[:, 2] <= y.max() + 1)
    index = np.flatnonzero(near & (box[:, 3] >= y.min() - 1))
    count = len(points)
    ray = np.zeros((1, count, 6))
    ray[0, :, :2] = points[:, :2] / points[:, 2:]
    hit, depth = np.full((count, 1), -1, np.int32), np.full((count, 1), np.inf)
    everywhere = np.tile(np.array([0, count - 1, 0, 0], np.int32), (len(index), 1))
    cast(
        screen.vertices,
        screen.triangles[index],
        everywhere,
        np.arange(count, dtype=np.int32)[None],
        ray,
        *sample_offsets(1),
        hit,
        depth,
    )
    found = hit[:, 0] >= 0
    where = np.where(found, depth[:, 0], 0.0)[:, None] * np.concatenate([ray[0, :, :2], np.ones((count, 1))], axis=1)
    own = np.zeros(count, dtype=bool)
    own[found] = screen.code[index[hit[found, 0]]] == code
    return own & (np.linalg.norm(where - center, axis=1) <= gate)
