"""Poses from labelled spots, and cameras from them where these are only roughly known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import PoseEstimate
from windmark.calibration import Calibration, Weighted, self_calibrate
from windmark.geometry import Camera, DegenerateGeometry, Pose
from windmark.registration import pose_from_labels
from windmark.scene import Observations
from windmark.tasks.reconstruct.primaries import with_sigma
from windmark.tasks.reconstruct.task import Task

Array = NDArray[np.float64]

LABELS_FOR_A_POSE = 4
LABELLED_PX = 0.15
"""What lens and table leave of a labelled spot (1 sigma), besides its covariance: four labels show nothing of it."""
VIEWS_FOR_A_CAMERA = 3
"""Labelled pictures from which cameras are found."""
LENS_SIGMA = {"aspect": 0.01, "k1": 0.3, "k2": 0.5, "k3": 0.5, "p1": 3e-3, "p2": 3e-3, "tilt_x": 0.02, "tilt_y": 0.02,
              "shear": 0.01}  # fmt: skip
"""1 sigma of what a few labels may not show, about the given camera."""
FOCAL_SIGMA, CENTRE_SIGMA = 0.2, 0.02
"""The same of the focal length, as part of it, and of the principal point, as part of the width of the picture."""


@dataclass(frozen=True)
class Begun:
    """Poses in the primaries' frame by view with their covariances (6, 6), how each was found, and the cameras.

    Where cameras were found from labels they have a covariance, and the poses' holds it, too.
    """

    poses: dict[int, Pose]
    cov: dict[int, Array]
    how: dict[int, str]
    cameras: Mapping[str, Camera]


def from_labels(task: Task) -> Begun:
    """Poses of all views with four labels or more; with free parameters the cameras are found with them."""
    fits = {}
    for v in task.usable:
        if v not in task.given and len(task.labels[v]) >= LABELS_FOR_A_POSE:
            fit = _pose(task, v)
            if fit is not None:
                fits[v] = fit
    poses = {v: fit.cam_from_model for v, fit in fits.items()}
    found = _calibrated(task, poses) if task.free and len(poses) >= VIEWS_FOR_A_CAMERA else None
    if found is not None:
        return found
    return Begun(poses, {v: fit.cov for v, fit in fits.items()}, dict.fromkeys(poses, "labels"), task.cameras)


def _pose(task: Task, view: int) -> PoseEstimate | None:
    marks = _marks(task, [view])
    try:
        return pose_from_labels(
            marks.xy, task.primary.xyz[marks.point], task.camera(view), cov=marks.cov, seed=task.seed
        )  # fmt: skip
    except DegenerateGeometry:
        return None


def _calibrated(task: Task, poses: dict[int, Pose]) -> Begun | None:
    """Cameras and poses from the labels alone, what these do not show near the given values; None where they fail."""
    marks = _marks(task, sorted(poses))
    width = max(c.size_px[0] for c in task.cameras.values())
    focal = max(c.focal_px for c in task.cameras.values())
    prior = {**LENS_SIGMA, "focal_px": FOCAL_SIGMA * focal, "cx": CENTRE_SIGMA * width, "cy": CENTRE_SIGMA * width}
    views = [replace(v, name=str(k), cam_from_model=poses.get(k)) for k, v in enumerate(task.views)]
    result = self_calibrate(
        marks, with_sigma(task.primary), task.cameras, views, datum=Weighted(covariance=task.primary_cov),
        free=task.free, prior_sigma={p: s for p, s in prior.items() if p in task.free}, eccentricity="off",
        reject=False, seed=task.seed,
    )  # fmt: skip
    if not isinstance(result, Calibration):
        return None
    poses = {int(v.name): v.cam_from_model for v in result.views if v.cam_from_model is not None}
    cov = {int(v.name): c for v, c in zip(result.views, result.pose_cov, strict=True)}
    return Begun(poses, cov, dict.fromkeys(poses, "labels"), {**task.cameras, **result.cameras})


def _marks(task: Task, views: list[int]) -> Observations:
    """The labelled spots of some views; points are indices of primaries."""
    rows = [(v, s, m) for v in views for s, m in task.labels[v].items()]
    xy = np.stack([task.detections[v].xy[s] for v, s, _ in rows])
    cov = np.stack([task.detections[v].cov[s] for v, s, _ in rows]) + LABELLED_PX**2 * np.eye(2)
    return Observations(np.array([r[0] for r in rows]), np.array([r[2] for r in rows]), xy, cov)
