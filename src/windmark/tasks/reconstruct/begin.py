"""Poses to begin with: given, from labels, from rough coordinates, or from the pictures alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from windmark.geometry import triangulate
from windmark.registration import Registration, prepare, register
from windmark.scene import MarkerSet
from windmark.tasks.reconstruct.free import meeting_point
from windmark.tasks.reconstruct.grow import from_nothing, grow, refined
from windmark.tasks.reconstruct.labelled import Begun, from_labels
from windmark.tasks.reconstruct.matched import PairMatcher
from windmark.tasks.reconstruct.structure import Structure, compact, linked
from windmark.tasks.reconstruct.task import Task
from windmark.tasks.reconstruct.ties import with_ties

GIVEN_SIGMA = (0.0035, 0.002)
"""1 sigma of given poses: radians, and part of the distance to the primaries. Worse ones are not used."""
EXACT, ENOUGH = (0.01, 0.05, 1.0), 0.3
"""They are taken for so much better at first, which is enough if it links this part of the spots."""


def beginning(task: Task, rough: MarkerSet | None, match: PairMatcher) -> tuple[Structure, dict[int, str]]:
    """A structure of all views that can be had, and how each view was found.

    Raises
    ------
    Refused
        Where there is none.
    """
    usable = task.usable
    known = _known_poses(task, rough)
    if len(known.poses) >= 2:
        structure = _begun(task, known)
        if structure is not None:
            return grow(task, structure, known.how, usable, match)
    return from_nothing(task, usable, match)


def _begun(task: Task, known: Begun) -> Structure | None:
    """The spots of known views linked: given poses are believed at first, and taken for rough where that fails."""
    nothing = np.zeros(0, np.int64)
    best: Structure | None = None
    for part in EXACT if "given" in known.how.values() else (1.0,):
        cov = {v: c * (part**2 if known.how[v] == "given" else 1.0) for v, c in known.cov.items()}
        # A calibration's cameras and poses err together; added up, their covariances would blur everything.
        cameras = {
            name: c if c.cov is None or part == 1.0 else replace(c, cov=c.cov * part**2)
            for name, c in known.cameras.items()
        }
        start = Structure(task.primary.xyz, nothing, nothing, nothing, known.poses, cov, cameras)
        first = _with_labels(task, compact(linked(task, start)))
        structure = refined(task, first) if len(first.point) else None
        if structure is not None and (best is None or len(structure.point) > len(best.point)):
            best = structure
        if best is not None and len(best.point) > ENOUGH * sum(len(task.detections[v]) for v in known.poses):
            break
    return best


def _with_labels(task: Task, structure: Structure) -> Structure:
    """Two pictures: spots of the same name are one marker, whether or not their neighbours say so."""
    if len(task.usable) != 2 or len(structure.posed) != 2:
        return structure
    a, b = structure.posed
    names = sorted(task.ties[a].keys() & task.ties[b].keys())
    tie_a, tie_b = (np.array([task.ties[v][n] for n in names], dtype=np.int64) for v in (a, b))
    partner = dict(zip(structure.point[structure.view == a].tolist(), structure.spot[structure.view == a].tolist(),
                       strict=True))  # fmt: skip
    in_b = structure.view == b
    old = [(partner[p], s) for p, s in zip(structure.point[in_b].tolist(), structure.spot[in_b].tolist(), strict=True)]
    spot_a, spot_b = (np.array([o[k] for o in old], dtype=np.int64) for k in (0, 1))
    spot_a, spot_b = with_ties(spot_a, spot_b, tie_a, tie_b)
    spots, cameras = task.detections, [task.camera(v) for v in (a, b)]
    points = triangulate(
        cameras, [structure.poses[v] for v in (a, b)], np.stack([spots[a].xy[spot_a], spots[b].xy[spot_b]]),
        np.stack([spots[a].cov[spot_a], spots[b].cov[spot_b]]),
    )  # fmt: skip
    good = np.flatnonzero(points.valid)
    number = np.tile(np.arange(len(good)), 2)
    return replace(
        structure, xyz=points.xyz[good], point=number, view=np.repeat([a, b], len(good)),
        spot=np.concatenate([spot_a[good], spot_b[good]]),
    )  # fmt: skip


def _known_poses(task: Task, rough: MarkerSet | None) -> Begun:
    """Poses in the primaries' frame that are given, follow from labels, or from rough coordinates."""
    known = from_labels(task)
    given = [task.given[v] for v in task.given]
    centre = task.primary.xyz.mean(axis=0) if len(task.primary) else np.zeros(3)
    if not len(task.primary) and len(given) > 1:
        centre = meeting_point(given)
    for v in set(task.usable) & set(task.given):
        pose = task.given[v]
        far = float(np.linalg.norm(pose.apply(centre)))
        sigma = np.repeat([GIVEN_SIGMA[0], GIVEN_SIGMA[1] * far], 3)
        known.poses[v], known.cov[v], known.how[v] = pose, np.diag(sigma**2), "given"
    if rough is not None:
        layout = prepare(rough)
        for v in task.usable:
            if v in known.poses:
                continue
            camera = known.cameras[task.views[v].camera]
            answer = register(task.detections[v], rough, camera, layout=layout, seed=task.seed)
            if isinstance(answer, Registration):
                known.poses[v], known.cov[v], known.how[v] = answer.cam_from_model, answer.cov, "register"
    return known
