"""Points, poses and which spot is which point, while the reconstruction grows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.calibration import Calibration, Distance, NotCalibrated, self_calibrate
from windmark.calibration.datum import Datum
from windmark.epipolar import associate
from windmark.geometry import Camera, Pose
from windmark.scene import Detections, MarkerSet, Observations, Tracks, View
from windmark.tasks.reconstruct.pairwise import by_pairs
from windmark.tasks.reconstruct.task import Task

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAST_VIEWS_ASSOCIATED = 3
"""Views with which spots are linked by geometry alone."""
MOST_VIEWS_PAIRED, LINKED = 4, 0.5
"""With so few views pairs are matched where less than this part of the spots that might be linked was."""


@dataclass(frozen=True)
class Structure:
    """A reconstruction in any frame, not yet complete.

    Parameters
    ----------
    xyz : (N, 3) points
    point, view, spot : (K,) links: which point is which spot in which view (of the task)
    poses : {view: cam_from_model}
    pose_cov : {view: (6, 6)}; empty before the first adjustment
    cameras : by name
    asked : links (view, spot) with which every picture that is to have a pose was asked again (`again`), and stays
    """

    xyz: Array
    point: Ints
    view: Ints
    spot: Ints
    poses: Mapping[int, Pose]
    pose_cov: Mapping[int, Array]
    cameras: Mapping[str, Camera]
    asked: frozenset[tuple[int, int]] = frozenset()

    @property
    def links(self) -> frozenset[tuple[int, int]]:
        """Spots (view, spot) that belong to a point."""
        return frozenset(zip(self.view.tolist(), self.spot.tolist(), strict=True))

    @property
    def posed(self) -> list[int]:
        """Views with a pose, in order."""
        return sorted(self.poses)

    def with_view(self, view: int, pose: Pose, spot: Ints, point: Ints) -> Structure:
        """One view more, with its links."""
        return replace(
            self, poses={**self.poses, view: pose}, point=np.concatenate([self.point, point]),
            view=np.concatenate([self.view, np.full(len(point), view)]), spot=np.concatenate([self.spot, spot]),
        )  # fmt: skip

    def observations(self, task: Task) -> Observations:
        """The links as observations; views are those of the task."""
        xy = np.stack([task.detections[v].xy[s] for v, s in zip(self.view, self.spot, strict=True)])
        cov = np.stack([task.detections[v].cov[s] for v, s in zip(self.view, self.spot, strict=True)])
        return Observations(self.view, self.point, xy, cov)


def adjusted(
    task: Task, structure: Structure, datum: Datum, free: Sequence[str] = (), names: Sequence[str] | None = None,
    table: MarkerSet | None = None, distances: Sequence[Distance] = (),
    prior_sigma: Mapping[str, float] | None = None,
) -> tuple[Structure, Calibration] | NotCalibrated:  # fmt: skip
    """The structure after one adjustment of everything, without the links and points that do not fit.

    ``names`` (N,) are those of the points and ``table`` holds the known ones among them, for the datum;
    ``prior_sigma`` is that of free interior parameters round those of the structure's cameras. Where there
    are only two pictures nothing is left out: a point has one observation more than unknowns then, and which of its two
    marks is wrong cannot be known; that links fit was decided by their epipolar distance.
    """
    if not len(structure.point):
        return NotCalibrated("no spot is linked", "too_few")
    posed = structure.posed
    place = {v: k for k, v in enumerate(posed)}
    every = structure.observations(task)
    observations = replace(every, view=np.array([place[v] for v in every.view], dtype=np.int64))
    views = [View(str(v), task.views[v].camera, str(v), structure.poses[v]) for v in posed]
    markers = _markers(structure, names, table)
    result = self_calibrate(
        observations, markers, structure.cameras, views, datum=datum, free=free, distances=distances,
        prior_sigma=prior_sigma, eccentricity="off", reject=len(task.usable) > 2, seed=task.seed,
    )  # fmt: skip
    if isinstance(result, NotCalibrated):
        thin = _undetermined(structure, markers, result) if len(task.usable) == 2 else np.zeros(0, np.int64)
        if not len(thin):
            return result
        rest = ~np.isin(structure.point, thin)
        fewer = replace(structure, point=structure.point[rest], view=structure.view[rest], spot=structure.spot[rest])
        return adjusted(task, fewer, datum, free, names, table, distances, prior_sigma)
    kept = rows_of(markers.name, result)
    xyz = structure.xyz.copy()
    xyz[kept] = result.markers.xyz
    view, point, spot = (column[result.used] for column in marks_of(structure, kept, result))
    poses = {int(v.name): v.cam_from_model for v in result.views if v.cam_from_model is not None}
    cov = {int(v.name): c for v, c in zip(result.views, result.pose_cov, strict=True)}
    return Structure(xyz, point, view, spot, poses, cov, {**structure.cameras, **result.cameras}), result


def _undetermined(structure: Structure, markers: MarkerSet, no: NotCalibrated) -> Ints:
    """Points that an adjustment names as not determined: lines of sight that hardly cross."""
    named = {w.removeprefix("marker ") for w in no.weak}
    used = np.unique(structure.point)
    return np.array([p for p in used.tolist() if str(markers.name[p]) in named], dtype=np.int64)


def rows_of(names: Sequence[str] | NDArray[np.str_], result: Calibration) -> Ints:
    """Index of each marker of a result among the ``names`` of the points it was made from."""
    row = {str(n): i for i, n in enumerate(names)}
    return np.array([row[str(n)] for n in result.markers.name], dtype=np.int64)


def marks_of(structure: Structure, kept: Ints, result: Calibration) -> tuple[Ints, Ints, Ints]:
    """View, point and spot (of the task) of every mark of an adjustment of ``structure``, left out ones included.

    ``kept`` are the points that are the result's markers.
    """
    number = np.array([int(v.name) for v in result.views], dtype=np.int64)
    view, point = number[result.observations.view], kept[result.observations.point]
    # A point has one spot in a view: by both in one number.
    given, asked = (v * len(structure.xyz) + p for v, p in ((structure.view, structure.point), (view, point)))
    order = np.argsort(given)
    at = order[np.searchsorted(given[order], asked)]
    assert (given[at] == asked).all()
    return view, point, structure.spot[at]


def linked(task: Task, structure: Structure) -> Structure:
    """All spots of the posed views linked anew by geometry alone (`epipolar.associate`).

    With two views nothing checks the pairs that were matched, and the structure stays, if there are any. Where few
    views leave most points undecided they are matched pair by pair (`by_pairs`).
    """
    posed = structure.posed
    if len(posed) < 2 or (len(posed) < LEAST_VIEWS_ASSOCIATED and len(structure.point)):
        return structure
    spots = [_widened(task.detections[v], structure.cameras[task.views[v].camera]) for v in posed]
    cameras = [structure.cameras[task.views[v].camera] for v in posed]
    poses = [structure.poses[v] for v in posed]
    cov = np.stack([structure.pose_cov[v] for v in posed]) if structure.pose_cov else None
    near = structure.xyz[np.unique(structure.point)] if len(structure.point) else structure.xyz
    best = structure
    if len(posed) >= LEAST_VIEWS_ASSOCIATED:
        found = associate(
            spots, cameras, Pose(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])),
            pose_cov=cov, points_near=near if len(near) else None,
        )  # fmt: skip
        moved = [Pose(found.poses.rotation[k], found.poses.translation[k]) for k in range(len(posed))]
        best = _structure(structure, found.xyz, found.tracks, moved, found.pose_cov)
    wanted = max(len(structure.point), sum(map(len, spots)) / 2)
    if len(posed) <= MOST_VIEWS_PAIRED and len(best.point) < LINKED * wanted:
        pairs = by_pairs(spots, cameras, poses, [None] * len(posed) if cov is None else list(cov), near)
        if len(pairs.tracks.track) > len(best.point):
            best = _structure(structure, pairs.xyz, pairs.tracks, poses, cov)
    return best


def _structure(old: Structure, xyz: Array, tracks: Tracks, poses: Sequence[Pose], cov: Array | None) -> Structure:
    """The views of a structure with other points and links; ``tracks.view`` counts the posed views."""
    posed = old.posed
    return Structure(
        xyz, tracks.track, np.array(posed, dtype=np.int64)[tracks.view], tracks.detection,
        dict(zip(posed, poses, strict=True)), {} if cov is None else dict(zip(posed, cov, strict=True)), old.cameras,
    )  # fmt: skip


def _widened(spots: Detections, camera: Camera) -> Detections:
    """Spots with what the camera's covariance, where it has one, does to their lines of sight."""
    if camera.cov is None:
        return spots
    rays = camera.unproject(spots.xy)
    known = np.asarray(np.isfinite(rays).all(axis=1))
    slope = camera.project_jacobian(np.where(known[:, None], rays, [0.0, 0.0, 1.0]))[3]
    return Detections.make(spots.xy, cov=spots.cov + slope @ camera.cov @ slope.transpose(0, 2, 1))


def compact(structure: Structure) -> Structure:
    """Only the points that have links, numbered anew."""
    used, point = np.unique(structure.point, return_inverse=True)
    return replace(structure, xyz=structure.xyz[used], point=point.astype(np.int64))


def point_names(count: int) -> list[str]:
    """Names of points while there are no others."""
    return [f"p{k:05d}" for k in range(count)]


def _markers(structure: Structure, names: Sequence[str] | None, table: MarkerSet | None) -> MarkerSet:
    n = len(structure.xyz)
    name = point_names(n) if names is None else list(names)
    xyz, sigma = structure.xyz.copy(), np.full((n, 3), np.nan)
    if table is not None:
        row = {m: k for k, m in enumerate(name)}
        for k, m in enumerate(table.name):
            if str(m) in row:
                xyz[row[str(m)]], sigma[row[str(m)]] = table.xyz[k], table.sigma[k]
    return MarkerSet.make(name, xyz, sigma=sigma, length_unit="" if table is None else table.length_unit)
