"""Where markers are expected in an image: from a camera with a pose, or from the detections of a frame before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.detection import Guided, detect_at
from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.scene import Detections, MarkerSet

Array = NDArray[np.float64]

OBLIQUE_COS = 0.1  # a disc seen under more than 84 degrees is a line


@dataclass(frozen=True)
class Predictions:
    """M expected markers.

    Parameters
    ----------
    name : M names, "" where unknown
    xy : (M, 2) centres of the imaged ellipses in pixels
    axes_px, angle : (M, 2), (M,) half axes (large first) and direction of the first, radians
    """

    name: tuple[str, ...]
    xy: Array
    axes_px: Array
    angle: Array

    def __len__(self) -> int:
        return len(self.name)


def from_camera(
    camera: Camera, cam_from_markers: Pose, markers: MarkerSet, radius_px: float | None = None
) -> Predictions:
    """The ellipses of the markers that face the camera and whose centres are in the image.

    A marker without normal counts as facing and is expected round; one without radius needs `radius_px`.

    Raises
    ------
    ValueError
        When a radius is needed and not given.
    """
    center, normal = cam_from_markers.apply(markers.xyz), cam_from_markers.rotate(markers.normal)
    ray = -center / np.linalg.norm(center, axis=1, keepdims=True)
    facing = np.asarray(~((normal * ray).sum(axis=1) <= OBLIQUE_COS) & (center[:, 2] > 0))
    seen = imaged_ellipse(camera, center, np.where(np.isfinite(normal), normal, ray), markers.radius)
    known = np.asarray(np.isfinite(seen.xy).all(axis=1))
    unsized = facing & ~np.isfinite(markers.radius)
    if radius_px is None and unsized.any():
        raise ValueError(f"marker {markers.name[unsized][0]} has no radius: give one in pixels (--radius)")
    fallback = np.nan if radius_px is None else radius_px
    xy = np.asarray(np.where(known[:, None], seen.xy, seen.center_xy))
    axes = np.where(known[:, None], seen.axes_px, fallback)
    keep = np.asarray(facing & camera.in_image(xy) & np.isfinite(axes).all(axis=1))
    angle = np.where(known, seen.angle, 0.0)
    return Predictions(tuple(markers.name[keep].tolist()), xy[keep], axes[keep], angle[keep])


def from_detections(spots: Detections, names: list[str], radius_px: float | None = None) -> Predictions:
    """What was seen before: the same ellipses at the same places.

    Raises
    ------
    ValueError
        When a spot has neither axes nor radius and no radius is given.
    """
    axes, angle = spots.axes_px.copy(), spots.angle.copy()
    plain = ~(np.isfinite(axes).all(axis=1) & np.isfinite(angle))
    axes[plain], angle[plain] = spots.radius_px[plain, None], 0.0
    if radius_px is not None:
        axes = np.where(np.isfinite(axes), axes, radius_px)
    if not np.isfinite(axes).all():
        raise ValueError("the spots have neither axes nor radius: give a radius in pixels (--radius)")
    return Predictions(tuple(names), spots.xy, axes, angle)


def look(image: NDArray[np.generic], expected: Predictions, **options: object) -> Guided:
    """`detect_at` for predictions."""
    axes = np.maximum(expected.axes_px, 0.5)
    return detect_at(image, expected.xy, axes_px=axes, angle=expected.angle, **options)  # type: ignore[arg-type]
