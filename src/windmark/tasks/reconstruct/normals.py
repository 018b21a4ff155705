"""Normals and radii of reconstructed markers, from the ellipses that they are imaged as."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.calibration.disc_shapes import discs_of_ellipses
from windmark.geometry import Camera
from windmark.scene import Detections, MarkerSet, Tracks, View

Array = NDArray[np.float64]

MOST_DEG = 10.0
"""Normals with a larger standard deviation are none: they say less than the shape of any model."""


def with_normals(
    markers: MarkerSet, tracks: Tracks, detections: Sequence[Detections], views: Sequence[View],
    cameras: Mapping[str, Camera],
) -> tuple[MarkerSet, Array]:  # fmt: skip
    """Markers with normals and radii where their ellipses tell them, and the normals' sigma (N,) in degrees, else NaN.

    Normals are those of `calibration.disc_shapes`: a marker needs ellipses in three views, from directions that tell
    the disc from its mirror image.
    """
    slope, ellipses = np.full((len(tracks.track), 2, 3), np.nan), np.full((len(tracks.track), 3), np.nan)
    towards = np.zeros((len(markers), 3))
    for v, (spots, view) in enumerate(zip(detections, views, strict=True)):
        mine = np.flatnonzero(tracks.view == v)
        if view.cam_from_model is None or not len(mine):
            continue
        point, spot, pose = tracks.track[mine], tracks.detection[mine], view.cam_from_model
        arm = pose.center - markers.xyz[point]
        towards[point] += arm / np.linalg.norm(arm, axis=1, keepdims=True)
        slope[mine] = cameras[view.camera].project_jacobian(pose.apply(markers.xyz[point]))[2] @ pose.rotation
        ellipses[mine] = np.column_stack([spots.axes_px[spot], spots.angle[spot]])
    if not np.isfinite(ellipses).all(axis=1).any():
        return markers, np.full(len(markers), np.nan)
    discs = discs_of_ellipses(ellipses, tracks.track, slope, towards)
    known = np.degrees(discs.sigma) < MOST_DEG
    normal = np.where(known[:, None] & ~np.isfinite(markers.normal), discs.normal, markers.normal)
    radius = np.where(known & ~np.isfinite(markers.radius), discs.radius, markers.radius)
    return replace(markers, normal=normal, radius=radius), np.where(known, np.degrees(discs.sigma), np.nan)
