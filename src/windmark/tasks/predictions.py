"""Where markers are expected in an image: from a camera with a pose, or from the detections of a frame before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.detection import Guided, detect_at
from windmark.detection.template.result import Frame
from windmark.errors import DataError
from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.scene import Detections, MarkerSet

Array = NDArray[np.float64]

OBLIQUE_COS = 0.1  # a disc seen under more than 84 degrees is a line
COLOUR_FRAMES = 16
"""What the noise's correlation does to a marker's covariance is found anew after so many frames: it changes slowly."""


@dataclass(frozen=True)
class Predictions:
    """M expected markers.

    Parameters
    ----------
    name : M names, "" where unknown
    row : (M,) where they stand in the table or list that they come from
    xy : (M, 2) centres of the imaged ellipses in pixels
    axes_px, angle : (M, 2), (M,) half axes (large first) and direction of the first, radians
    eccentricity_px : (M, 2) centres less the images of the discs' centres, 0 where a disc is not known; None: unknown
    """

    name: tuple[str, ...]
    row: NDArray[np.int64]
    xy: Array
    axes_px: Array
    angle: Array
    eccentricity_px: Array | None = None

    def __len__(self) -> int:
        return len(self.name)

    def take(self, index: NDArray[np.int64]) -> Predictions:
        """Those of an index array, in its order."""
        names = tuple(self.name[k] for k in index.tolist())
        off = None if self.eccentricity_px is None else self.eccentricity_px[index]
        return Predictions(names, self.row[index], self.xy[index], self.axes_px[index], self.angle[index], off)


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
    has_normal = np.isfinite(normal)
    form = cam_from_markers.rotate_form(markers.curvature)
    seen = imaged_ellipse(camera, center, np.where(has_normal, normal, ray), markers.radius, form)
    known = np.asarray(np.isfinite(seen.xy).all(axis=1))
    unsized = facing & ~np.isfinite(markers.radius)
    if radius_px is None and unsized.any():
        raise DataError(f"marker {markers.name[unsized][0]} has no radius: give one in pixels (--radius)")
    fallback = np.nan if radius_px is None else radius_px
    xy = np.asarray(np.where(known[:, None], seen.xy, seen.center_xy))
    axes = np.where(known[:, None], seen.axes_px, fallback)
    keep = np.asarray(facing & camera.in_image(xy) & np.isfinite(axes).all(axis=1))
    angle = np.where(known, seen.angle, 0.0)
    row = np.flatnonzero(keep)
    off = np.where(known[:, None] & has_normal.all(axis=1, keepdims=True), seen.eccentricity_px, 0.0)
    return Predictions(tuple(markers.name[row].tolist()), row, xy[row], axes[row], angle[row], off[row])


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
        raise DataError("the spots have neither axes nor radius: give a radius in pixels (--radius)")
    return Predictions(tuple(names), np.arange(len(names)), spots.xy, axes, angle)


@dataclass(frozen=True)
class Known:
    """What an image of a sequence tells the next one.

    Parameters
    ----------
    frame : blur and noise
    colour : (N, 2, 2) of all markers, see `detect_at`; NaN where not known yet
    age : frames since it was found
    """

    frame: Frame
    colour: Array
    age: int = 0


def look_again(
    image: NDArray[np.generic], expected: Predictions, marker: NDArray[np.int64], count: int, known: Known | None,
    **options: object,
) -> tuple[Guided, Known]:  # fmt: skip
    """`look` in the next image of a sequence, and what that tells the one after it.

    Parameters
    ----------
    marker : (M,) which of `count` markers is expected
    known : what the image before told; None for the first one
    """
    stale = known is None or known.age + 1 >= COLOUR_FRAMES
    frame = None if known is None else known.frame
    found = look(
        image, expected, frame=frame, colour=None if known is None or stale else known.colour[marker], **options
    )
    if known is None or stale or found.frame is not frame:
        colour, age = np.full((count, 2, 2), np.nan), 0
    else:
        colour, age = known.colour.copy(), known.age + 1
    there = np.flatnonzero(found.found)
    colour[marker[there]] = found.colour[there]
    return found, Known(found.frame, colour, age)


def look(image: NDArray[np.generic], expected: Predictions, **options: object) -> Guided:
    """`detect_at` for predictions."""
    axes = np.maximum(expected.axes_px, 0.5)
    return detect_at(image, expected.xy, axes_px=axes, angle=expected.angle, **options)  # type: ignore[arg-type]
