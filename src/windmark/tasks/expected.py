"""What the next image of a sequence is expected to show: how far from their predictions, and how large."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.geometry.rotations import hat
from windmark.registration import Registration
from windmark.registration.task import MIN_COUNT
from windmark.scene import Detections, MarkerSet
from windmark.scene.units import common_ratio
from windmark.tasks.predictions import Predictions, from_camera

Array = NDArray[np.float64]


def imaged_size(spots: Detections, answer: Registration, markers: MarkerSet, radius_px: float) -> float:
    """Radii of discs that were found in a whole image over those by table, pose and camera; 1 where these are unknown.

    ``radius_px`` : of markers of unknown radius
    """
    expected = from_camera(answer.camera, answer.cam_from_model, markers, radius_px)
    by_table = np.full(len(markers), np.nan)
    by_table[expected.row] = np.sqrt(expected.axes_px.prod(axis=1))
    by_table[~np.isfinite(markers.radius)] = np.nan
    imaged = np.asarray(spots.radius_px)[answer.matching.detection]
    return common_ratio(imaged / by_table[answer.matching.marker], imaged, MIN_COUNT).ratio


def of_size(expected: Predictions, markers: MarkerSet, size: float) -> Predictions:
    """Predictions with the table's radii ``size`` times as large: discs are never quite what a table says."""
    by_table = np.isfinite(markers.radius[expected.row])
    return replace(expected, axes_px=np.where(by_table[:, None], size, 1.0) * expected.axes_px)


def prediction_sigma_px(camera: Camera, pose: Pose, cov: Array, markers: MarkerSet) -> float:
    """1 sigma per coordinate of the predicted places in the image, that of the worst tenth of the markers in view."""
    places = pose.apply(markers.xyz)
    xy, valid, by_place, _ = camera.project_jacobian(places)
    seen = valid & camera.in_image(xy)
    if not seen.any():
        return np.inf
    by_pose = np.concatenate([-hat(places[seen]), np.broadcast_to(np.eye(3), (int(seen.sum()), 3, 3))], axis=2)
    j = by_place[seen] @ by_pose
    variance = np.diagonal(j @ cov @ np.swapaxes(j, 1, 2), axis1=1, axis2=2).max(axis=1)
    return float(np.sqrt(np.quantile(variance, 0.9)))
