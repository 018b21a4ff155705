"""The paper's case with known truth: pictures taken by hand round a model, its markers unknown but for a few.

Observations only, no pixels: spots are the true images with noise, some missing, some false, in random order. Shared by
the tests and the benchmarks of the reconstruction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from windmark.geometry import Camera, Pose
from windmark.scene import Detections

CAMERA = Camera((3004, 2000), 3070.0, 1.0005, 1510.0, 990.0, k1=-0.045, k2=0.03, p1=3e-4, p2=-2e-4)
STEEPEST_DEG = 72.0
"""A disc seen at a flatter angle is not found."""
APART, APART_PX = 15.0, 8.0
"""Markers are painted at least so many mm apart; spots nearer to each other than this are one blob, and not found."""


@dataclass(frozen=True)
class Case:
    """Truth and spots; ``labels`` give the marker of every spot of a view, -1 for a false one.

    ``primary`` are six markers far apart, whose coordinates a user would know.
    """

    name: str
    camera: Camera
    poses: Pose
    xyz: np.ndarray
    detections: tuple[Detections, ...]
    labels: tuple[np.ndarray, ...]
    primary: np.ndarray

    @property
    def views_of(self) -> np.ndarray:
        """(N,) number of pictures with a spot of each marker."""
        every = np.concatenate(self.labels)
        return np.bincount(every[every >= 0], minlength=len(self.xyz))

    def perturbed(self, seed: int, angle_deg: float = 0.2, shift: float = 2.0) -> tuple[Pose, np.ndarray]:
        """Poses wrong by so much (1 sigma per axis, about the camera), and their covariances (V, 6, 6)."""
        sigma = np.r_[[np.radians(angle_deg)] * 3, [shift] * 3]
        views = len(self.detections)
        delta = np.random.default_rng(seed).normal(size=(views, 6)) * sigma
        return Pose.exp(delta) @ self.poses, np.broadcast_to(np.diag(sigma**2), (views, 6, 6)).copy()


def make(
    seed: int, model: str = "plate", path: str = "walk", *, views: int = 25, points: int = 100, missing: float = 0.1,
    false: float = 0.1, noise: float = 0.1, camera: Camera = CAMERA,
) -> Case:  # fmt: skip
    """One case.

    Parameters
    ----------
    model : "plate", nearly flat, 690 mm; or "model", wing and body before three walls, which hide each other
    path : "walk", pictures 5 to 12 degrees apart; or "cloud", from anywhere in front, in any order
    """
    rng = np.random.default_rng(seed)
    xyz, normal = plate(rng, 2 * points) if model == "plate" else wing_body_walls(rng, 2 * points)
    kept = _apart(xyz)[:points]
    xyz, normal = xyz[kept], normal[kept]
    reach = float(np.abs(xyz[:, :2]).max())
    stations = walk(rng, views, reach) if path == "walk" else cloud(rng, views, reach)
    poses = Pose(np.stack([p.rotation for p in stations]), np.stack([p.translation for p in stations]))
    spots, labels = zip(
        *[_seen(rng, camera, p, xyz, normal, model, missing, false, noise) for p in stations], strict=True
    )
    axes = ((1, 1, 0), (1, -1, 0), (-1, 1, 0), (-1, -1, 0), (0.2, 0, 1), (-0.2, 0, -1))
    primary: list[int] = []
    for axis in axes:
        far = np.argsort(-(xyz @ np.array(axis, float)))
        primary.append(next(int(i) for i in far if i not in primary))
    return Case(f"{model}, {path}, seed {seed}", camera, poses, xyz, spots, labels, np.array(primary))


def plate(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """A plate flat to 3 mm."""
    xyz = rng.uniform(-345, 345, (n, 3)) * [1, 0.8, 0]
    xyz[:, 2] = rng.normal(0, 3, n)
    return xyz, np.tile([0.0, 0.0, 1.0], (n, 1))


def _apart(xyz: np.ndarray) -> list[int]:
    """Points that are not too close to an earlier one."""
    kept: list[int] = []
    for i, x in enumerate(xyz):
        if not kept or np.linalg.norm(xyz[kept] - x, axis=1).min() > APART:
            kept.append(i)
    return kept


WING, BODY_RADIUS, BODY_HALF, WALL = (300.0, 90.0), 50.0, 220.0, 380.0


def wing_body_walls(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Markers on a wing (along x), a body (along y) through it, and three walls behind and beside them."""
    kind = rng.choice(5, n, p=[0.35, 0.25, 0.2, 0.1, 0.1])
    s, t = rng.uniform(-1, 1, (2, n))
    xyz, normal = np.zeros((n, 3)), np.zeros((n, 3))
    wing = kind == 0
    across = np.sign(s) * (BODY_RADIUS + 10 + np.abs(s) * (WING[0] - BODY_RADIUS - 10))
    xyz[wing] = np.stack([across, t * WING[1], 1e-4 * across**2], axis=1)[wing]
    normal[wing] = [0, 0, 1]
    body, angle = kind == 1, s * np.radians(80)
    round_it = np.stack([np.sin(angle), 0 * s, np.cos(angle)], axis=1)
    xyz[body] = (BODY_RADIUS * round_it + np.stack([0 * s, t * BODY_HALF, 0 * s], axis=1))[body]
    normal[body] = round_it[body]
    floor = kind == 2
    xyz[floor] = np.stack([s * WALL, t * 0.8 * WALL, 0 * s - 180], axis=1)[floor]
    normal[floor] = [0, 0, 1]
    for side, k in ((-1.0, 3), (1.0, 4)):
        wall = kind == k
        xyz[wall] = np.stack([0 * s + side * WALL, t * 0.8 * WALL, 100 * s - 80], axis=1)[wall]
        normal[wall] = [-side, 0, 0]
    return xyz, normal


def hidden(eye: np.ndarray, xyz: np.ndarray) -> np.ndarray:
    """Which of the points wing or body hide from a station."""
    ray = xyz - eye
    with np.errstate(divide="ignore", invalid="ignore"):
        at = -eye[2] / ray[:, 2]
        hit = eye + at[:, None] * ray
        wing = (at > 0) & (at < 0.98) & (np.abs(hit[:, 0]) < WING[0]) & (np.abs(hit[:, 1]) < WING[1])
        a, b = (ray[:, [0, 2]] ** 2).sum(axis=1), ray[:, [0, 2]] @ eye[[0, 2]]
        root = b**2 - a * (eye[[0, 2]] @ eye[[0, 2]] - BODY_RADIUS**2)
        first = (-b - np.sqrt(np.maximum(root, 0))) / a
    body = (root > 0) & (first > 0) & (first < 0.98) & (np.abs(eye[1] + first * ray[:, 1]) < BODY_HALF)
    return np.asarray(wing | body)


def walk(rng: np.random.Generator, views: int, reach: float) -> list[Pose]:
    """Along a winding path in front of the model, 5 to 12 degrees from picture to picture, some roll."""
    out, here = [], np.radians([-30.0, -30.0])
    heading = rng.uniform(0.1, 0.5)
    for _ in range(views):
        step = np.radians(rng.uniform(5, 12))
        ahead = here + step * np.array([np.cos(heading), np.sin(heading)])
        for _ in range(12):
            if np.linalg.norm(ahead) <= np.radians(45):
                break
            heading += 0.6
            ahead = here + step * np.array([np.cos(heading), np.sin(heading)])
        here = ahead
        heading += rng.normal(0, 0.25)
        out.append(_station(rng, reach, here[0], here[1], rng.normal(0, np.radians(10))))
    return out


def cloud(rng: np.random.Generator, views: int, reach: float) -> list[Pose]:
    """From 6 to 50 degrees off the normal, on any side, rolled in any way."""
    out = []
    for _ in range(views):
        off, around = np.radians(rng.uniform(6, 50)), rng.uniform(0, 2 * np.pi)
        out.append(_station(rng, reach, off * np.cos(around), off * np.sin(around), rng.uniform(0, 2 * np.pi)))
    return out


def _station(rng: np.random.Generator, reach: float, east: float, north: float, roll: float) -> Pose:
    """A camera so many radians off the normal, the field filled."""
    off = float(np.hypot(east, north))
    way = np.array([east, north]) / max(off, 1e-9)
    distance = reach * CAMERA.focal_px / 1000 * rng.uniform(1.05, 1.3)
    eye = distance * np.array([*(np.sin(off) * way), np.cos(off)])
    up = np.array([np.sin(roll), np.cos(roll), 0.1])
    return Pose.look_at(eye, rng.normal(0, 0.03 * reach, 3), up)


def _seen(
    rng: np.random.Generator, camera: Camera, pose: Pose, xyz: np.ndarray, normal: np.ndarray, model: str,
    missing: float, false: float, noise: float,
) -> tuple[Detections, np.ndarray]:  # fmt: skip
    xy, valid = camera.project(pose.apply(xyz))
    towards = pose.center - xyz
    cosine = (towards * normal).sum(axis=1) / np.linalg.norm(towards, axis=1)
    seen = valid & camera.in_image(np.where(valid[:, None], xy, -9.0)) & (cosine > np.cos(np.radians(STEEPEST_DEG)))
    if model != "plate":
        seen &= ~hidden(pose.center, xyz)
    apart = np.linalg.norm(xy[:, None] - xy[None], axis=2) + 1e9 * np.eye(len(xyz))
    seen &= np.where(seen[None], apart, 1e9).min(axis=1) > APART_PX
    seen &= rng.random(len(xyz)) >= missing
    true = np.flatnonzero(seen)
    wrong = rng.uniform(-0.5, np.array(camera.size_px) - 0.5, (round(false * len(true)), 2))
    places = np.concatenate([xy[true] + rng.normal(0, noise, (len(true), 2)), wrong])
    label = np.concatenate([true, np.full(len(wrong), -1)])
    shuffled = rng.permutation(len(label))
    return Detections.make(places[shuffled], sigma_px=noise), label[shuffled]


@dataclass(frozen=True)
class Count:
    """Links of tracks against the truth.

    Parameters
    ----------
    tracks : tracks found
    right, wrong : links of the track's own marker, and others
    missed : spots of tracked markers that are in no track
    lost : markers with three spots or more that have no track
    false : tracks of which not even half of the spots are one marker's, or second ones of a marker
    """

    tracks: int
    right: int
    wrong: int
    missed: int
    lost: int
    false: int


def judge(track: np.ndarray, label: np.ndarray, views_of: np.ndarray, least: int = 3) -> Count:
    """Compare links (track, true label of the spot) with the truth."""
    tracks = int(track.max(initial=-1)) + 1
    votes = np.zeros((tracks, len(views_of) + 1), dtype=int)
    np.add.at(votes, (track, np.where(label < 0, len(views_of), label)), 1)
    own = votes[:, :-1].argmax(axis=1) if tracks else np.zeros(0, int)
    most = votes[np.arange(tracks), own]
    order = np.argsort(-most, kind="stable")
    first = np.zeros(tracks, bool)
    first[order[np.unique(own[order], return_index=True)[1]]] = True
    good = first & (2 * most > votes.sum(axis=1))
    right = int(most[good].sum())
    has = np.zeros(len(views_of), bool)
    has[own[good]] = True
    return Count(
        tracks, right, int(votes.sum()) - right, int(views_of[has].sum()) - right,
        int(((views_of >= least) & ~has).sum()), int((~good).sum()),
    )  # fmt: skip
