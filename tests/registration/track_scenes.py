"""Sequences of virtual images with known labels: a model that moves smoothly, jumps, or is gone for a while.

The tests of tracking and their benchmark share them; nothing here uses the code under test.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import registration_scenes as scenes
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Speed:
    """Largest motion per frame."""

    deg: float
    percent: float
    px: float


SLOW, MEDIUM, FAST = Speed(0.1, 0.1, 1.0), Speed(1.0, 1.0, 10.0), Speed(4.0, 4.0, 40.0)
PERIOD = (18.0, 40.0)
"""Frames of one swing."""


def swing(
    rng: np.random.Generator, camera: Camera, start: Pose, centre: Array, speed: Speed, frames: int
) -> list[Pose]:
    """A smooth motion about a pose: rotation, distance and place swing, each with its own period and direction."""
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    turn, period, phase = rng.uniform(0, 2 * np.pi), rng.uniform(*PERIOD, 3), rng.uniform(0, 2 * np.pi, 3)
    depth = start.apply(centre)[2]
    across = np.array([np.cos(turn), np.sin(turn), 0.0]) * speed.px * depth / camera.focal_px
    k = np.arange(frames)[:, None]
    wave = (np.sin(2 * np.pi * k / period + phase) - np.sin(phase)) * period / (2 * np.pi)
    poses = []
    for a, b, c in wave:
        r = Pose.from_rotvec(np.radians(speed.deg) * a * axis, np.zeros(3)).rotation @ start.rotation
        place = start.apply(centre) * np.exp(0.01 * speed.percent * b) + across * c
        poses.append(Pose(r, place - r @ centre))
    return poses


def jumped(rng: np.random.Generator, pose: Pose, camera: Camera, centre: Array, size: Speed) -> Pose:
    """A pose knocked by up to this much."""
    axis = rng.normal(size=3)
    r = Pose.from_rotvec(axis / np.linalg.norm(axis) * np.radians(rng.uniform(0, size.deg)), np.zeros(3)).rotation
    place = pose.apply(centre)
    turn, far = rng.uniform(0, 2 * np.pi), rng.uniform(0, size.px) * place[2] / camera.focal_px
    moved = place * np.exp(rng.uniform(-0.01, 0.01) * size.percent) + far * np.array([np.cos(turn), np.sin(turn), 0.0])
    return Pose(r @ pose.rotation, moved - r @ pose.rotation @ centre)


def markers_of(rng: np.random.Generator, kind: str) -> MarkerSet:
    """Markers of kind A, A0, B, C or a grid of 6 x 4 (G), which any pose has an equal of."""
    if kind == "G":
        xyz = np.stack(np.meshgrid(np.arange(6) * 0.2, np.arange(4) * 0.2, [0.0]), axis=-1).reshape(-1, 3)
        return MarkerSet.make([f"g{i}" for i in range(24)], xyz, normal=np.tile([0.0, 0.0, 1.0], (24, 1)))
    if kind in ("B", "C"):
        return scenes.wing_and_body(rng) if kind == "B" else scenes.wind_tunnel(rng)
    return scenes.wing(rng, jitter=0.0 if kind == "A0" else 0.04)


def sequence(
    seed: int, kind: str, speed: Speed, *, frames: int = 30, hidden: float = 0.0, false: float = 0.0,
    jumps: tuple[int, ...] = (), empty: tuple[int, ...] = (), jump: Speed | None = None, k1: float = 0.0,
) -> list[scenes.Scene]:  # fmt: skip
    """Images of a moving model; hidden markers and false spots change from image to image.

    At the frames ``jumps`` the model is knocked by up to ``jump``; the frames ``empty`` show false spots only.
    """
    rng = np.random.default_rng(seed)
    markers = markers_of(rng, kind)
    camera, pose = scenes.random_view(rng, markers, k1=k1)
    centre = markers.xyz.mean(axis=0)
    parts, first = [], pose
    for start, stop in zip((0, *jumps), (*jumps, frames), strict=True):
        part = swing(rng, camera, first, centre, speed, stop - start)
        parts.extend(part)
        first = jumped(rng, part[-1], camera, centre, jump or Speed(10.0, 10.0, 100.0))
    noise, made = rng.uniform(0.1, 0.3), []
    for k, one in enumerate(parts):
        scene = scenes.image_of(rng, markers, camera, one, hidden=hidden, false=false, noise_px=noise)
        if k in empty:
            clutter = scene.detections.take(scene.label < 0)
            scene = scenes.Scene(clutter, markers, camera, one, np.full(len(clutter), -1))
        made.append(scene)
    return made
