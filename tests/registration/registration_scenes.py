"""Virtual images with known labels: a wing, a wing with a body, both in a tunnel; hidden markers, false spots.

The tests of the registration room and its benchmark share them; nothing here uses the code under test
except the nouns (cameras, poses, tables, results).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.registration import Registration
from windmark.scene import Detections, MarkerSet

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """One image: spots in random order, ``label[j]`` the marker of spot j or -1."""

    detections: Detections
    markers: MarkerSet
    camera: Camera
    cam_from_model: Pose
    label: NDArray[np.int64]


def wing(rng: np.random.Generator, *, rows: int = 4, columns: int = 6, jitter: float = 0.04) -> MarkerSet:
    """A: near-regular rows on a nearly flat, swept and tapered wing (span 1); jitter 0 is A0, exactly regular."""
    span, chord = np.meshgrid(np.arange(columns) / (columns - 1), (np.arange(rows) + 0.5) / rows, indexing="ij")
    s = (span + rng.normal(0, jitter / (columns - 1), span.shape)).ravel()
    c = (chord + rng.normal(0, jitter / rows, chord.shape)).ravel()
    x = 0.35 * s + (0.45 - 0.2 * s) * c
    z = 0.03 * (1 - (2 * c - 1) ** 2) + 0.03 * s
    slope = -0.03 * 4 * (2 * c - 1) / (0.45 - 0.2 * s)
    normal = np.stack([-slope, np.full_like(s, -0.03), np.ones_like(s)], axis=-1)
    return MarkerSet.make([f"w{i:02d}" for i in range(len(s))], np.stack([x, s, z], axis=-1), normal=normal)


def wing_and_body(rng: np.random.Generator) -> MarkerSet:
    """B: 60 markers, 2 x 15 on a wing of each side and 30 on the upper half of a round body."""
    half = wing(rng, rows=3, columns=5)
    right = half.xyz + np.array([0.3, 0.12, 0.0])
    left = right * [1, -1, 1] + rng.normal(0, 0.004, right.shape)
    n_right, n_left = half.normal, half.normal * [1, -1, 1]
    along, turn = np.meshgrid(np.linspace(-0.3, 1.3, 10), np.radians([-60.0, 0.0, 60.0]), indexing="ij")
    along = (along + rng.normal(0, 0.01, along.shape)).ravel()
    turn = (turn + rng.normal(0, 0.05, turn.shape)).ravel()
    radial = np.stack([np.zeros_like(turn), np.sin(turn), np.cos(turn)], axis=-1)
    body = np.stack([along, np.zeros_like(along), np.zeros_like(along)], axis=-1) + 0.1 * radial
    xyz, normal = np.concatenate([right, left, body]), np.concatenate([n_right, n_left, radial])
    return MarkerSet.make([f"b{i:02d}" for i in range(len(xyz))], xyz, normal=normal)


def wind_tunnel(rng: np.random.Generator) -> MarkerSet:
    """C: 150 markers, B in a test section: 60 on the floor behind it and 15 on each of two side walls."""
    model = wing_and_body(rng)
    x, y = np.meshgrid(np.linspace(-0.6, 1.8, 10), np.linspace(-1.4, 1.4, 6), indexing="ij")
    floor = np.stack([x, y, np.full_like(x, -0.5)], axis=-1).reshape(-1, 3)
    x, z = np.meshgrid(np.linspace(-0.6, 1.8, 5), np.linspace(-0.3, 0.7, 3), indexing="ij")
    wall = np.stack([x, np.full_like(x, 1.6), z], axis=-1).reshape(-1, 3)
    xyz = np.concatenate([floor, wall, wall * [1, -1, 1]])
    normal = np.repeat([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [0.0, 1.0, 0.0]], [60, 15, 15], axis=0)
    # Within the wall's plane.
    xyz += rng.normal(0, 0.06, xyz.shape) * (normal == 0)
    xyz, normal = np.concatenate([model.xyz, xyz]), np.concatenate([model.normal, normal])
    return MarkerSet.make([f"c{i:03d}" for i in range(len(xyz))], xyz, normal=normal)


def random_view(rng: np.random.Generator, markers: MarkerSet, *, fov_deg: tuple[float, float] = (10, 60),
                tilt_max_deg: float = 60, size_px: tuple[int, int] = (1280, 1000), k1: float = 0.0,
                ) -> tuple[Camera, Pose]:  # fmt: skip
    """A camera that faces the model: any roll, 45 to 100 % of the image filled."""
    fov = np.radians(rng.uniform(*fov_deg))
    focal = size_px[0] / (2 * np.tan(fov / 2))
    camera = Camera(size_px, focal, k1=k1)
    tilt, turn = np.radians(rng.uniform(0, tilt_max_deg)), rng.uniform(0, 2 * np.pi)
    towards = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    middle = 0.5 * (markers.xyz.min(axis=0) + markers.xyz.max(axis=0))
    size = np.linalg.norm(np.ptp(markers.xyz, axis=0))
    distance = size * focal / (rng.uniform(0.6, 1.0) * np.hypot(*size_px) * 0.8)
    up = rng.normal(size=3)
    pose = Pose.look_at(middle + distance * towards, middle + rng.normal(0, 0.03, 3) * size, up)
    return camera, pose


def visible(markers: MarkerSet, camera: Camera, pose: Pose) -> tuple[Array, NDArray[np.bool_]]:
    """Projections, and which markers a detector would see: in the image and not at grazing incidence."""
    xy, ok = camera.project(pose.apply(markers.xyz))
    to_eye = pose.center - markers.xyz
    cosine = np.einsum("ij,ij->i", markers.normal, to_eye) / np.linalg.norm(to_eye, axis=1)
    return xy, ok & camera.in_image(xy) & ~(cosine < np.cos(np.radians(75)))


def image_of(rng: np.random.Generator, markers: MarkerSet, camera: Camera, pose: Pose, *, hidden: float = 0.0,
             false: float = 0.0, noise_px: float | None = None, ranked: bool = False) -> Scene:  # fmt: skip
    """Spots of the visible markers less a hidden fraction, plus false spots (a fraction of the visible number)."""
    xy, seen = visible(markers, camera, pose)
    index = np.flatnonzero(seen)
    clutter = rng.uniform(0, 1, (round(false * len(index)), 2)) * camera.size_px - 0.5
    index = rng.permutation(index)[: len(index) - round(hidden * len(index))]
    noise = rng.uniform(0.1, 0.3) if noise_px is None else noise_px
    spots = np.concatenate([xy[index] + rng.normal(0, noise, (len(index), 2)), clutter])
    label = np.concatenate([index, np.full(len(clutter), -1)])
    order = np.arange(len(spots)) if ranked else rng.permutation(len(spots))
    return Scene(Detections.make(spots[order], sigma_px=max(noise, 0.02)), markers, camera, pose, label[order])


def scene(seed: int, kind: str = "A", **options: float) -> Scene:
    """A random image of kind A, A0, B or C."""
    rng = np.random.default_rng(seed)
    if kind in ("B", "C"):
        markers = wing_and_body(rng) if kind == "B" else wind_tunnel(rng)
    else:
        markers = wing(rng, jitter=0.0 if kind == "A0" else 0.04)
    camera, pose = random_view(rng, markers)
    return image_of(rng, markers, camera, pose, **options)


def pose_error_px(result_pose: Pose, scene: Scene, camera: Camera | None = None) -> float:
    """Largest displacement of a visible marker between the found pose (and camera) and the true one, in pixels."""
    true, seen = visible(scene.markers, scene.camera, scene.cam_from_model)
    found, _ = (camera or scene.camera).project(result_pose.apply(scene.markers.xyz))
    error = np.linalg.norm(found - true, axis=1)[seen]
    return float(np.where(np.isnan(error), np.inf, error).max())


def wrong_labels(matching_detection: Array, matching_marker: Array, scene: Scene) -> int:
    """How many pairs of a matching are not the truth."""
    return int((scene.label[matching_detection.astype(int)] != matching_marker).sum())


def whitened_error(found: Registration, scene: Scene) -> Array:
    """Error of pose (and focal length, if that was free) in units of its covariance: (6,) or (7,) of sigma 1.

    Distance and focal length grow together; where they are known to some percent only, their product with the small
    rest is far from linear. So the error is taken as rotation, direction of the model's centre, and logarithms of its
    depth and of the focal length, and the covariance is brought to them.
    """
    middle = scene.markers.xyz.mean(axis=0)
    pose, true = found.cam_from_model, scene.cam_from_model
    here, there = pose.apply(middle), true.apply(middle)
    x, y, z = here
    direction = np.array([[1 / z, 0, -x / z**2], [0, 1 / z, -y / z**2], [0, 0, 1 / z]])
    change = np.eye(len(found.cov))
    change[3:6, :3] = direction @ -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    change[3:6, 3:6] = direction
    error = [*(true @ pose.inverse()).log()[:3], *(there / there[2] - here / z)[:2], np.log(there[2] / z)]
    if len(found.cov) == 7:
        change[6, 6] = 1 / found.camera.focal_px
        error.append(np.log(scene.camera.focal_px / found.camera.focal_px))
    root = np.linalg.cholesky(change @ found.cov @ change.T)
    return np.asarray(np.linalg.solve(root, error))


@dataclass(frozen=True)
class RigScene:
    """Images of several cameras at once, and where the cameras and the model are in the frame of the rig."""

    views: tuple[Scene, ...]
    cam_from_rig: tuple[Pose, ...]
    rig_from_model: Pose

    def arguments(self) -> tuple[list[Detections], MarkerSet, list[Camera], list[Pose]]:
        """What `register_rig` is given."""
        spots, cameras = [v.detections for v in self.views], [v.camera for v in self.views]
        return spots, self.views[0].markers, cameras, list(self.cam_from_rig)


def rig_scene(seed: int, kind: str = "A", cameras: int = 3, apart_deg: tuple[float, float] = (20, 60),
              **options: float) -> RigScene:  # fmt: skip
    """Random images of kind A, B or C by cameras that see the model from directions so far apart, any lens."""
    rng = np.random.default_rng(seed)
    markers = {"A": wing, "B": wing_and_body, "C": wind_tunnel}[kind](rng)
    middle = 0.5 * (markers.xyz.min(axis=0) + markers.xyz.max(axis=0))
    chosen: list[tuple[Camera, Pose]] = []
    directions: list[Array] = []
    while len(chosen) < cameras:
        camera, pose = random_view(rng, markers)
        towards = (pose.center - middle) / np.linalg.norm(pose.center - middle)
        if all(apart_deg[0] < np.degrees(np.arccos(towards @ other)) < apart_deg[1] for other in directions):
            chosen.append((camera, pose))
            directions.append(towards)
    rig_from_model = Pose.from_rotvec(rng.normal(size=3), rng.normal(size=3))
    views = tuple(image_of(rng, markers, camera, pose, **options) for camera, pose in chosen)
    return RigScene(views, tuple(pose @ rig_from_model.inverse() for _, pose in chosen), rig_from_model)
