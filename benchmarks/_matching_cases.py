"""Cases for the matcher: spots, markers, camera, options of `register`, and the truth (None where no pose is right)."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "registration"))
import registration_scenes as scenes

from windmark.geometry import Camera, Pose
from windmark.geometry.rotations import hat
from windmark.registration import Registration
from windmark.scene import Detections, MarkerSet, Matching

WRONG_PX = 5.0
"""A pose that displaces a visible marker by more is wrong."""


@dataclass(frozen=True)
class Case:
    """One call of `register` and what is right."""

    detections: Detections
    markers: MarkerSet
    camera: Camera
    truth: scenes.Scene | None
    options: dict[str, Any] = field(default_factory=dict)

    def pose_right(self, result: Registration) -> bool:
        """Whether every visible marker is projected to where it is."""
        if self.truth is None:
            return False
        return scenes.pose_error_px(result.cam_from_model, self.truth, result.camera) < WRONG_PX

    def labels(self, match: Matching) -> tuple[int, int]:
        """Wrong labels and missing ones.

        A spot within three sigma of where its marker is, though it is another's or nobody's, is truly ambiguous;
        neither it nor the marker's own spot is then counted.
        """
        assert self.truth is not None
        label = self.truth.label
        seen, _ = self.truth.camera.project(self.truth.cam_from_model.apply(self.markers.xyz))
        offset = np.linalg.norm(self.detections.xy[match.detection] - seen[match.marker], axis=1)
        sigma = np.sqrt(self.detections.cov[match.detection, 0, 0])
        ambiguous = offset < 3 * sigma
        wrong = (label[match.detection] != match.marker) & ~ambiguous
        missing = np.setdiff1d(label[label >= 0], match.marker)
        spot = {int(m): j for j, m in enumerate(label) if m >= 0}
        gone = [m for m in missing if not np.isin(spot[int(m)], match.detection[ambiguous])]
        return int(wrong.sum()), len(gone)

    def focal_bound(self) -> float:
        """Smallest relative 1 sigma that a focal length can have here (Cramer-Rao, right labels, exact lens)."""
        assert self.truth is not None
        truth, true = self.truth, self.truth.label >= 0
        places = truth.cam_from_model.apply(self.markers.xyz[truth.label[true]])
        _, _, by_place, by_camera = truth.camera.project_jacobian(places)
        # d(place) / d(rotation, translation), the rotation about the middle: then all is well scaled.
        turn = -hat(places - places.mean(axis=0))
        pose = by_place @ np.concatenate([turn, np.broadcast_to(np.eye(3), turn.shape)], axis=2)
        by = np.concatenate([pose, truth.camera.focal_px * by_camera[:, :, :1]], axis=2)
        by /= np.sqrt(self.detections.cov[true, 0, 0])[:, None, None]
        return float(np.sqrt(np.linalg.inv(np.einsum("kdi,kdj->ij", by, by))[-1, -1]))


def cold(seed: int, kind: str, hidden: float, false: float, ranked: bool = False) -> Case:
    """Known focal length, no prior."""
    scene = scenes.scene(seed, kind, hidden=hidden, false=false, ranked=ranked)
    return Case(scene.detections, scene.markers, scene.camera, scene)


def with_prior(seed: int, kind: str, hidden: float, false: float) -> Case:
    """A prior that is wrong by up to 25 degrees and 20 %."""
    case = cold(seed, kind, hidden, false)
    return replace(case, options={"prior": _near(case, seed, 25.0, 0.2)})


def _near(case: Case, seed: int, angle_deg: float, scale: float) -> Pose:
    """A pose that is off by up to an angle, about the markers' centre, and a scale."""
    assert case.truth is not None
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    turn = Pose.from_rotvec(axis / np.linalg.norm(axis) * np.radians(rng.uniform(0, angle_deg)), np.zeros(3)).rotation
    centre, pose = case.markers.xyz.mean(axis=0), case.truth.cam_from_model
    rotation = pose.rotation @ turn
    place = pose.apply(centre) * np.exp(rng.uniform(-scale, scale))
    return Pose(rotation, place - rotation @ centre)


def free_focal(seed: int, kind: str, hidden: float, false: float) -> Case:
    """A focal length that is wrong by up to 30 % and free."""
    case = cold(seed, kind, hidden, false)
    factor = np.exp(np.random.default_rng(seed).uniform(-0.3, 0.3))
    camera = replace(case.camera, focal_px=case.camera.focal_px * factor)
    return replace(case, camera=camera, options={"free_focal": True})


def _mixed(seed: int, kinds: str = "ABC") -> Case:
    return cold(seed, kinds[seed % len(kinds)], *((0.0, 0.0), (0.25, 0.5), (0.5, 1.0))[seed // 3 % 3])


def clutter(seed: int) -> Case:
    """Random spots only."""
    case, rng = _mixed(seed), np.random.default_rng(seed)
    spots = rng.uniform(0, 1, (rng.integers(10, 120), 2)) * case.camera.size_px
    return replace(case, detections=Detections.make(spots, sigma_px=0.2), truth=None)


def clusters(seed: int) -> Case:
    """Random spots in five heaps."""
    case, rng = _mixed(seed), np.random.default_rng(seed)
    heaps = rng.uniform(0, 1, (5, 2)) * case.camera.size_px
    spots = heaps[rng.integers(0, 5, rng.integers(10, 120))]
    spots = np.clip(spots + rng.normal(0, 40, spots.shape), 0, np.array(case.camera.size_px) - 1)
    return replace(case, detections=Detections.make(spots, sigma_px=0.2), truth=None)


def other_model(seed: int) -> Case:
    """The picture of one model with the table of another kind."""
    case = _mixed(seed)
    return replace(case, markers=scenes.scene(seed + 5000, "BCA"[seed % 3]).markers, truth=None)


def other_wing(seed: int) -> Case:
    """The picture of one wing with the table of another one of the same design (its rows differ by 4 %)."""
    return replace(_mixed(seed, "A"), markers=scenes.scene(seed + 5000, "A").markers, truth=None)


def mirrored(seed: int) -> Case:
    """The table of the mirrored wing (B and C have a plane of symmetry)."""
    case = _mixed(seed, "A")
    flip = np.array([-1.0, 1.0, 1.0])
    return replace(
        case, markers=replace(case.markers, xyz=case.markers.xyz * flip, normal=case.markers.normal * flip), truth=None
    )


def _grid(seed: int, columns: int, rows: int, moved: float = 0.0) -> Case:
    rng = np.random.default_rng(seed)
    xyz = np.stack(np.meshgrid(np.arange(columns) * 1.0, np.arange(rows) * 1.0, [0.0]), axis=-1).reshape(-1, 3)
    xyz[rng.integers(len(xyz)), :2] += moved * np.array([1.0, 0.4])
    normal = np.tile([0.0, 0.0, 1.0], (len(xyz), 1))
    markers = MarkerSet.make([f"g{i}" for i in range(len(xyz))], xyz, normal=normal)
    camera, pose = scenes.random_view(rng, markers)
    hidden, false = ((0.0, 0.0), (0.25, 0.5), (0.5, 1.0))[seed % 3]
    scene = scenes.image_of(rng, markers, camera, pose, hidden=hidden, false=false)
    return Case(scene.detections, markers, camera, scene)


def regular_grid(seed: int) -> Case:
    """A grid of 6 x 4 or 5 x 5: any pose has an equal."""
    return replace(_grid(seed, *((6, 4), (5, 5))[seed % 2]), truth=None)


def grid_with_prior(seed: int) -> Case:
    """A grid of 6 x 4, up to 80 % hidden, with a prior that rules out its turns but not its shifts."""
    case, rng = _grid(seed, 6, 4), np.random.default_rng(seed)
    assert case.truth is not None
    keep = rng.random(len(case.detections)) > rng.choice([0.0, 0.3, 0.6])
    spots = case.detections.take(keep)
    truth = replace(case.truth, detections=spots, label=case.truth.label[keep])
    prior = {"prior": _near(case, seed, 10.0, 0.1), "prior_max_angle_deg": 20.0}
    return replace(case, detections=spots, truth=truth, options=prior)


def nearly_regular_grid(seed: int) -> Case:
    """A grid of 6 x 4 with one marker moved."""
    return _grid(seed, 6, 4, 0.3)


def wrong_focal(seed: int) -> Case:
    """A focal length that is wrong by 20 % and taken for true: no pose is right, but labels may be."""
    case = _mixed(seed)
    return replace(case, camera=replace(case.camera, focal_px=case.camera.focal_px * (0.8, 1.2)[seed % 2]))


def unranked(seed: int) -> Case:
    """700 false spots among the true ones, in random order."""
    case, rng = _mixed(seed), np.random.default_rng(seed)
    assert case.truth is not None
    order = rng.permutation(len(case.detections) + 700)
    spots = np.concatenate([case.detections.xy, rng.uniform(0, 1, (700, 2)) * case.camera.size_px])[order]
    label = np.concatenate([case.truth.label, np.full(700, -1)])[order]
    detections = Detections.make(spots, sigma_px=0.2)
    return replace(case, detections=detections, truth=replace(case.truth, detections=detections, label=label))


def large(seed: int, ranked: bool) -> Case:
    """500 markers on a wavy sheet, half of them hidden if the spots are ranked (10 % if not), and 2,000 spots."""
    rng = np.random.default_rng(seed)
    xy = np.empty((0, 2))
    while len(xy) < 500:
        p = rng.uniform(0, 1, 2) * [2.0, 1.5]
        if not len(xy) or np.hypot(*(xy - p).T).min() > 0.035:
            xy = np.vstack([xy, p])
    x, y = xy.T
    slope = -0.3 * np.cos(3 * x) * np.cos(2 * y), 0.2 * np.sin(3 * x) * np.sin(2 * y)
    xyz, normal = np.stack([x, y, 0.1 * np.sin(3 * x) * np.cos(2 * y)], 1), np.stack([*slope, np.ones(500)], 1)
    markers = MarkerSet.make([f"m{i:03d}" for i in range(500)], xyz, normal=normal)
    camera, pose = scenes.random_view(rng, markers, size_px=(2560, 2000), tilt_max_deg=50)
    scene = scenes.image_of(rng, markers, camera, pose, hidden=0.5 if ranked else 0.1, ranked=True)
    more = 2000 - len(scene.detections)
    order = np.arange(2000) if ranked else rng.permutation(2000)
    spots = np.concatenate([scene.detections.xy, rng.uniform(0, 1, (more, 2)) * camera.size_px])[order]
    label = np.concatenate([scene.label, np.full(more, -1)])[order]
    detections = Detections.make(spots, sigma_px=0.2)
    return Case(detections, markers, camera, replace(scene, detections=detections, label=label))
