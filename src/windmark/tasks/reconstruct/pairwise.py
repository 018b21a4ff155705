"""Few views with known poses: matched pair by pair, the neighbours deciding, and joined by triplets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from windmark.calibration.finish import adjoint
from windmark.epipolar import PairLinks, chain, match_known_pair
from windmark.geometry import Camera, Pose, triangulate
from windmark.scene import Detections, Tracks
from windmark.tasks.reconstruct.result import Reconstruction
from windmark.tasks.reconstruct.task import Task

Array = NDArray[np.float64]

WIDER = 0.5
"""Depths are looked for so far beyond those of the known points, as part of their range and of their extent."""


@dataclass(frozen=True)
class Linked:
    """T points (T, 3) and their links; ``tracks.view`` counts the views that were given."""

    xyz: Array
    tracks: Tracks


def by_pairs(
    spots: Sequence[Detections], cameras: Sequence[Camera], poses: Sequence[Pose], pose_cov: Sequence[Array | None],
    near: Array,
) -> Linked:  # fmt: skip
    """Links of a few views from all their pairs (`match_known_pair`), as far as third views agree (`chain`).

    With three or four views the evidence of a single point is weak; its neighbours' depths are evidence, too.
    """
    links = []
    for a, b in combinations(range(len(spots)), 2):
        step = poses[b] @ poses[a].inverse()
        if not np.linalg.norm(step.translation) > 0:
            continue
        cov = _relative_cov(step, pose_cov[a], pose_cov[b])
        pair = match_known_pair(
            spots[a], spots[b], cameras[a], cameras[b], step, pose_cov=cov,
            depth_range=_depths((poses[a], poses[b]), near),
        )  # fmt: skip
        links.append(PairLinks(a, b, pair.spot_a, pair.spot_b, np.maximum(pair.log_odds, 1e-3)))
    tracks = chain([len(s) for s in spots], links).tracks
    return _placed(tracks, spots, cameras, poses)


def open_spots(task: Task, result: Reconstruction) -> dict[str, NDArray[np.int64]]:
    """Spots of two pictures that have possible partners, none of which stands out; nothing with more pictures."""
    posed = [(k, v) for k, v in enumerate(result.views) if v.cam_from_model is not None]
    if len(posed) != 2:
        return {}
    (a, view_a), (b, view_b) = posed
    assert view_a.cam_from_model is not None
    assert view_b.cam_from_model is not None
    spots = task.detections[a], task.detections[b]
    pair = match_known_pair(
        *spots, result.cameras[view_a.camera], result.cameras[view_b.camera],
        view_b.cam_from_model @ view_a.cam_from_model.inverse(),
        depth_range=_depths((view_a.cam_from_model, view_b.cam_from_model), result.markers.xyz),
    )  # fmt: skip
    linked = [set(result.tracks.detection[result.tracks.view == v].tolist()) for v in (a, b)]
    sides = ((view_a, pair.ambiguous_a, linked[0]), (view_b, pair.ambiguous_b, linked[1]))
    return {v.name: np.array([s for s in some.tolist() if s not in mine], dtype=np.int64) for v, some, mine in sides}


def _relative_cov(step: Pose, cov_a: Array | None, cov_b: Array | None) -> Array | None:
    """Covariance of ``exp(delta) @ step`` from those of the two poses; None where both are exact."""
    if cov_a is None or cov_b is None:
        return None
    along = adjoint(step)
    return np.asarray(cov_b + along @ cov_a @ along.T)


def _depths(poses: Sequence[Pose], near: Array) -> tuple[float, float] | None:
    """Depths before the two cameras at which points may be; None where no points are known."""
    if not len(near):
        return None
    depth = np.concatenate([p.apply(near)[:, 2] for p in poses])
    room = WIDER * max(float(np.ptp(depth)), float(np.ptp(near, axis=0).max()))
    low = max(float(depth.min()) - room, 0.2 * float(depth.min()))
    return (low, float(depth.max()) + room) if depth.min() > 0 else None


def _placed(tracks: Tracks, spots: Sequence[Detections], cameras: Sequence[Camera], poses: Sequence[Pose]) -> Linked:
    """The points of tracks, those left out that have none."""
    count = int(tracks.track.max(initial=-1)) + 1
    xy, cov = np.full((len(spots), count, 2), np.nan), np.tile(np.eye(2), (len(spots), count, 1, 1))
    for v, some in enumerate(spots):
        mine = tracks.view == v
        xy[v, tracks.track[mine]] = some.xy[tracks.detection[mine]]
        cov[v, tracks.track[mine]] = some.cov[tracks.detection[mine]]
    if not count:
        return Linked(np.zeros((0, 3)), tracks)
    points = triangulate(list(cameras), list(poses), xy, cov)
    number = np.cumsum(points.valid) - 1
    kept = points.valid[tracks.track]
    return Linked(
        points.xyz[points.valid], Tracks(number[tracks.track[kept]], tracks.view[kept], tracks.detection[kept])
    )
