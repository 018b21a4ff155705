"""How well a pose will be known from each direction, from the covariance of its adjustment alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.geometry.rotations import hat
from windmark.tasks.marker_check.stage import Stage, in_sight

Array = NDArray[np.float64]

FEWEST = 4
SAME = 1e-9  # smallest over largest eigenvalue of the scaled information below which a pose is not determined


@dataclass(frozen=True, eq=False)
class PoseSigma:
    """1 sigma of the pose per direction (D,); NaN where the markers in sight do not determine it.

    Parameters
    ----------
    surface_px : of the place of the markers in sight in the image, per coordinate: the worst one of them
    rotation_deg : about the axis that is known worst
    across, along : of the model's middle, across (the worse way) and along the line of sight, length unit
    """

    surface_px: Array
    rotation_deg: Array
    across: Array
    along: Array


def pose_sigmas(stage: Stage, directions: Array) -> PoseSigma:
    """Sigma of the pose of a camera in each direction, each marker in sight counting with its chance to be seen."""
    fill = float(np.mean(stage.settings.fill))
    rows = [_pose_sigma(stage, stage.pose(d, 0.0, fill)) for d in directions]
    return PoseSigma(*np.array(rows).reshape(-1, 4).T)


def _pose_sigma(stage: Stage, pose: Pose) -> tuple[float, float, float, float]:
    nothing = (float("nan"),) * 4
    _, seen = stage.seen(pose)
    if seen.sum() < FEWEST:
        return nothing
    middle = pose.apply(stage.middle)
    jacobian = _jacobian(stage, pose, stage.markers.xyz[seen], middle)
    weight = (1 - stage.settings.hidden_percent / 100) / stage.settings.noise_px**2
    information = weight * np.einsum("nip,niq->pq", jacobian, jacobian)
    scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information * scale * scale[:, None]
    size = np.linalg.eigvalsh(scaled)
    if not size[0] > SAME * size[-1]:
        return nothing
    cov = np.linalg.inv(scaled) * scale * scale[:, None]
    placed = np.einsum("nip,pq,niq->n", jacobian, cov, jacobian) / 2
    rotation = np.sqrt(np.linalg.eigvalsh(cov[:3, :3])[-1])
    across = np.sqrt(np.linalg.eigvalsh(cov[3:5, 3:5])[-1])
    return float(np.sqrt(placed.max())), float(np.degrees(rotation)), float(across), float(np.sqrt(cov[5, 5]))


def _jacobian(stage: Stage, pose: Pose, xyz: Array, middle: Array) -> Array:
    """(n, 2, 6) of the images by [rotation, translation], the model turned about its middle in the camera frame."""
    cam = pose.apply(xyz)
    by_point = stage.camera.project_jacobian(cam)[2]
    turned = np.stack([-hat(p) for p in cam - middle])
    return np.concatenate([by_point @ turned, by_point], axis=2)


def seen_by_direction(stage: Stage, directions: Array) -> NDArray[np.bool_]:
    """(D, N) markers in sight from each direction, hidden by the grid or not."""
    fill = float(np.mean(stage.settings.fill))
    rows = []
    for d in directions:
        pose = stage.pose(d, 0.0, fill)
        rows.append(in_sight(stage.markers.xyz, stage.markers.normal, stage.camera, pose,
                             stage.settings.max_obliquity_deg)[1])  # fmt: skip
    return np.array(rows)
