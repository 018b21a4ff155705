"""Poses to begin with: given, from labels, from rough coordinates, or from the pictures alone."""

from __future__ import annotations

import numpy as np

from windmark.geometry import DegenerateGeometry, Pose
from windmark.pipeline.reconstruct.grow import from_nothing, grow, refined
from windmark.pipeline.reconstruct.structure import LEAST_VIEWS_ASSOCIATED, Structure, compact, linked
from windmark.pipeline.reconstruct.task import Task
from windmark.registration import Registration, pose_from_labels, prepare, register
from windmark.scene import MarkerSet

LABELS_FOR_A_POSE = 4
LABELLED_PX = 0.15
"""What lens and table leave of a labelled spot (1 sigma), besides its covariance: four labels show nothing of it."""
GIVEN_SIGMA = (0.0035, 0.002)
"""1 sigma of given poses: radians, and part of the distance to the primaries. Worse ones are not used."""


def beginning(task: Task, rough: MarkerSet | None) -> tuple[Structure, dict[int, str]]:
    """A structure of all views that can be had, and how each view was found.

    Raises
    ------
    Refused
        Where there is none.
    """
    usable = task.usable
    poses, cov, how = _known_poses(task, rough)
    if len(poses) >= LEAST_VIEWS_ASSOCIATED:
        nothing = np.zeros(0, np.int64)
        start = Structure(task.primary.xyz, nothing, nothing, nothing, poses, cov, task.cameras)
        first = compact(linked(task, start))
        structure = refined(task, first) if len(first.point) else None
        if structure is not None:
            return grow(task, structure, how, usable)
    return from_nothing(task, usable)


def _known_poses(task: Task, rough: MarkerSet | None) -> tuple[dict[int, Pose], dict[int, np.ndarray], dict[int, str]]:
    """Poses in the primaries' frame with their covariances, and where they are from."""
    poses, cov, how = {}, {}, {}
    centre = task.primary.xyz.mean(axis=0)
    layout = None if rough is None else prepare(rough)
    for v in task.usable:
        camera, spots = task.camera(v), task.detections[v]
        if v in task.given:
            far = float(np.linalg.norm(task.given[v].apply(centre)))
            sigma = np.repeat([GIVEN_SIGMA[0], GIVEN_SIGMA[1] * far], 3)
            poses[v], cov[v], how[v] = task.given[v], np.diag(sigma**2), "given"
            continue
        if len(task.labels[v]) >= LABELS_FOR_A_POSE:
            spot, marker = np.array(list(task.labels[v])), np.array(list(task.labels[v].values()))
            wider = spots.cov[spot] + LABELLED_PX**2 * np.eye(2)
            try:
                found = pose_from_labels(
                    spots.xy[spot], task.primary.xyz[marker], camera, cov=wider, seed=task.seed
                )  # fmt: skip
            except DegenerateGeometry:
                continue
            poses[v], cov[v], how[v] = found.cam_from_model, found.cov, "labels"
        elif rough is not None:
            answer = register(spots, rough, camera, layout=layout, seed=task.seed)
            if isinstance(answer, Registration):
                poses[v], cov[v], how[v] = answer.cam_from_model, answer.cov, "register"
    return poses, cov, how
