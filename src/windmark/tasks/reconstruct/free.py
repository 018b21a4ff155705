"""A reconstruction without primary markers: its frame and scale from given poses, a known distance, or the points."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.calibration import Calibration, Distance
from windmark.calibration.by_poses import by_poses
from windmark.errors import g2
from windmark.geometry import Pose
from windmark.geometry.similarity import Similarity
from windmark.scene import Doubt
from windmark.tasks.reconstruct.structure import Structure
from windmark.tasks.reconstruct.task import Refused, Task

Array = NDArray[np.float64]

HELD = 0.02
"""Given poses hold the frame where the pictures' own are so near to them, as part of the distance to the points."""
MEAN_PLANE = (
    "mean plane of the markers: the origin is their centre, z is normal to the plane that fits them and points to the "
    "cameras, x is the first camera's x axis in it"
)
UNIT_SIZE = "1 is the root mean square distance of the markers from their centre"
POSES = "that of the given poses"


def frame_words(task: Task, structure: Structure, distances: Sequence[Distance]) -> tuple[str, bool]:
    """Frame and scale in words, and whether lengths are free (in no unit)."""
    if _given(task, structure):
        return f"frame and scale: {POSES}, to which the pictures' own are fitted", False
    if distances:
        return f"frame: {MEAN_PLANE}; scale: the known distances", False
    return f"frame: {MEAN_PLANE}; free scale: {UNIT_SIZE}", True


def sigma_words(frame: str) -> str:
    """Of what the sigmas of the markers are, in a frame in words."""
    if POSES in frame:
        return "1 sigma is that in this frame, with what the pictures leave open of their own poses"
    return "1 sigma is that of the shape (inner constraints)"


def in_its_frame(task: Task, structure: Structure, distances: Sequence[Distance], names: Sequence[str]) -> Structure:
    """The structure in the frame that given poses, or else its own points, define.

    Raises
    ------
    Refused
        Where the given poses contradict the pictures, or a distance's markers are not among ``names``.
    """
    frame = _of_poses(task, structure) if _given(task, structure) else _mean_plane(structure)
    out = transformed(structure, frame)
    if not distances or _given(task, structure):
        return out
    row = {n: k for k, n in enumerate(names)}
    ratio = []
    for d in distances:
        lost = [n for n in (d.first, d.second) if n not in row]
        if lost:
            raise Refused("not_found", f"marker {lost[0]} of the known distance is not among those that were "
                          "reconstructed; label it in a picture that shows it well (image,name,x,y)")  # fmt: skip
        ratio.append(d.length / float(np.linalg.norm(out.xyz[row[d.first]] - out.xyz[row[d.second]])))
    return transformed(out, Similarity(float(np.median(ratio)), np.eye(3), np.zeros(3)))


def in_posed_frame(task: Task, structure: Structure, result: Calibration) -> tuple[Structure, Calibration, list[Doubt]]:
    """A finished structure in the frame of the given poses, with the sigmas that it has there, and what contradicts.

    As it is where no poses hold the frame.
    """
    views = _given(task, structure)
    if not views:
        return structure, result, []
    found = by_poses(result, {str(v): task.given[v] for v in views})
    doubts = []
    if not found.fits:
        far = math.degrees(found.sigma)
        names = [task.views[v].name for v in views]
        doubts = [Doubt(
            (), f"the given poses ({', '.join(names)}) contradict the pictures: beyond what these leave open they are "
            f"off by some {g2(far)} degrees each, or {g2(100 * found.sigma)} % of the distance to the markers; frame "
            "and scale are known no better than that leaves them, and the sigmas of the markers have it", "control",
        )]  # fmt: skip
    return transformed(structure, found.fit), found.calibration, doubts


def transformed(structure: Structure, frame: Similarity) -> Structure:
    """The structure in another frame; its lengths are then those of that frame."""
    poses = {v: frame.moved(pose) for v, pose in structure.poses.items()}
    scale = np.diag([1.0, 1, 1, frame.scale, frame.scale, frame.scale])
    cov = {v: scale @ c @ scale for v, c in structure.pose_cov.items()}
    return replace(structure, xyz=frame.apply(structure.xyz), poses=poses, pose_cov=cov)


def labelled_names(task: Task, structure: Structure) -> list[str]:
    """Names of the points: those of labels where there are any, numbers for the others.

    Raises
    ------
    Refused
        Where one name is on several points, or one point has several names.
    """
    votes: dict[int, Counter[str]] = {}
    name_of = [{s: n for n, s in ties.items()} for ties in task.ties]
    for v, s, p in zip(structure.view.tolist(), structure.spot.tolist(), structure.point.tolist(), strict=True):
        if s in name_of[v]:
            votes.setdefault(p, Counter())[name_of[v][s]] += 1
    names = [f"s{k:0{max(3, len(str(len(structure.xyz))))}d}" for k in range(1, len(structure.xyz) + 1)]
    taken: dict[str, int] = {}
    for point, count in votes.items():
        name = count.most_common(1)[0][0]
        if len(count) > 1 or name in taken:
            raise Refused(
                "not_found", f"the labels {', '.join(sorted(count))} are on one marker, or {name} is on several: "
                "labels are wrong, or pictures of a regular layout were linked with a shift",
            )  # fmt: skip
        taken[name] = point
        names[point] = name
    return names


def meeting_point(poses: Sequence[Pose]) -> Array:
    """The point nearest to the cameras' axes; where these hardly meet, ten times their distance away."""
    axis, centre = np.stack([p.rotation[2] for p in poses]), np.stack([p.center for p in poses])
    across = np.eye(3) - axis[:, :, None] * axis[:, None, :]
    base = float(np.linalg.norm(centre - centre.mean(axis=0), axis=1).max())
    guess = centre.mean(axis=0) + 10 * base * axis.mean(axis=0)
    weak = 1e-3 * np.eye(3)
    return np.linalg.solve(across.sum(axis=0) + weak, np.einsum("vij,vj->i", across, centre) + weak @ guess)


def _given(task: Task, structure: Structure) -> list[int]:
    """Views of a structure whose pose was given, where these are enough for a frame with a scale."""
    views = [v for v in structure.posed if v in task.given]
    return views if len(views) >= 2 else []


def _of_poses(task: Task, structure: Structure) -> Similarity:
    """The similarity that takes the structure's cameras to the given ones."""
    views = _given(task, structure)
    own, given = [structure.poses[v] for v in views], [task.given[v] for v in views]
    u, _, vt = np.linalg.svd(sum(g.rotation.T @ o.rotation for g, o in zip(given, own, strict=True)))
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    a, b = np.stack([o.center for o in own]), np.stack([g.center for g in given])
    size = [float(np.sqrt(((c - c.mean(axis=0)) ** 2).sum())) for c in (a, b)]
    scale = size[1] / size[0]
    frame = Similarity(scale, rotation, b.mean(axis=0) - scale * rotation @ a.mean(axis=0))
    out = transformed(structure, frame)
    off, far = [], []
    for v in views:
        place = task.given[v].apply(out.xyz)
        off.append(np.linalg.norm(out.poses[v].apply(out.xyz) - place, axis=1))
        far.append(np.linalg.norm(place, axis=1))
    part = float(np.median(np.array(off) / np.array(far)))
    if part > HELD:
        raise Refused(
            "poses", f"the pictures contradict the given poses: with these the markers would be {100 * part:.1f} % of "
            f"their distance off (at most {100 * HELD:.0f} %)",
        )  # fmt: skip
    return frame


def _mean_plane(structure: Structure) -> Similarity:
    """See `MEAN_PLANE` and `UNIT_SIZE`."""
    centre = structure.xyz.mean(axis=0)
    off = structure.xyz - centre
    normal = np.linalg.svd(off, full_matrices=False)[2][2]
    cameras = np.stack([p.center for p in structure.poses.values()])
    if ((cameras - centre) @ normal).sum() < 0:
        normal = -normal
    x = structure.poses[structure.posed[0]].rotation[0]
    x = x - (x @ normal) * normal
    if np.linalg.norm(x) < 1e-6:
        x = np.cross(structure.poses[structure.posed[0]].rotation[1], normal)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(normal, x), normal])
    scale = 1 / float(np.sqrt((off**2).sum(axis=1).mean()))
    return Similarity(scale, rotation, -scale * rotation @ centre)
