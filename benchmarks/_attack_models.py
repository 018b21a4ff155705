"""Models of the attacks, written apart from those of the registration tests: other shapes, other layouts, other sizes.

Lengths are in metres, one model is about 0.2 to 30 of them. The front of every model is +z, so that a camera on that
side sees most of its markers.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "registration"))
import bent_scenes  # noqa: F401  (the attacks take it from here)
import registration_scenes as scenes

from windmark.scene import MarkerSet

Array = NDArray[np.float64]
LEAST_APART = 0.04
"""Markers of a random layout are so far apart at least, as part of the layout's size."""


def table(xyz: Array, normal: Array | None = None, sigma: float | None = None) -> MarkerSet:
    """Markers with made-up names."""
    return MarkerSet.make([f"m{i:03d}" for i in range(len(xyz))], xyz, normal=normal, sigma=sigma)


def moved(markers: MarkerSet, xyz: Array) -> MarkerSet:
    """The same markers at other places (N, 3)."""
    return MarkerSet.make(markers.name, xyz, normal=markers.normal, sigma=markers.sigma, radius=markers.radius)


def without_normals(markers: MarkerSet) -> MarkerSet:
    """The same markers, their normals unknown."""
    return MarkerSet.make(markers.name, markers.xyz, sigma=markers.sigma, radius=markers.radius)


def scattered(rng: np.random.Generator, count: int, size: tuple[float, float]) -> Array:
    """(count, 2) random places in a rectangle, none too near to another."""
    least, places = LEAST_APART * max(size), [rng.uniform(0, 1, 2) * size]
    while len(places) < count:
        p = rng.uniform(0, 1, 2) * size
        if np.hypot(*(np.array(places) - p).T).min() > least:
            places.append(p)
    return np.array(places)


def building(rng: np.random.Generator) -> MarkerSet:
    """Two faces of a tower, 4 x 7 discs each, 30 m high; the edge between them looks at the camera."""
    u, v = np.meshgrid(np.arange(4) * 2.5 + 1.5, np.arange(7) * 4.0 + 2.0, indexing="ij")
    flat = np.stack([u.ravel(), v.ravel()], axis=1)
    faces, normals = [], []
    for sign in (-1.0, 1.0):
        place = flat + rng.normal(0, 0.15, flat.shape)
        c = np.sqrt(0.5)
        faces.append(np.stack([sign * c * place[:, 0], place[:, 1], -c * place[:, 0]], axis=1))
        normals.append(np.tile([sign * c, 0.0, c], (len(place), 1)))
    return table(np.concatenate(faces), np.concatenate(normals))


def fuselage(rng: np.random.Generator) -> MarkerSet:
    """A cylinder of 0.12 m radius with a tapered nose: eleven rings of up to nine discs on the upper 200 degrees."""
    along = np.linspace(0, 1.5, 11)
    xyz, normal = [], []
    for x in along:
        radius = 0.12 * min(1.0, 0.35 + 1.3 * x)
        turn = np.radians(np.linspace(-100, 100, 9)) + rng.normal(0, 0.04, 9)
        keep = rng.random(9) < 0.6
        ring = np.stack([np.full(9, x) + rng.normal(0, 0.012, 9), np.sin(turn) * radius, np.cos(turn) * radius], axis=1)
        xyz.append(ring[keep])
        normal.append(np.stack([np.zeros(9), np.sin(turn), np.cos(turn)], axis=1)[keep])
    return table(np.concatenate(xyz), np.concatenate(normal))


def rake_plate(rng: np.random.Generator) -> MarkerSet:
    """A flat plate with 30 scattered discs, and a rake of eight that stand on posts of 3 to 15 cm."""
    flat = scattered(rng, 30, (0.8, 0.5))
    x = np.linspace(0.1, 0.7, 8) + rng.normal(0, 0.015, 8)
    rake = np.stack([x, 0.25 + rng.normal(0, 0.03, 8), rng.uniform(0.03, 0.15, 8)], axis=1)
    xyz = np.concatenate([np.column_stack([flat, np.zeros(30)]), rake])
    return table(xyz, np.tile([0.0, 0.0, 1.0], (38, 1)))


def delta(rng: np.random.Generator) -> MarkerSet:
    """A delta wing with a little camber: five rays from the apex, and six discs on either side of a fin."""
    xyz, normal = [], []
    for ray in np.radians([-24.0, -12.0, 1.0, 12.0, 24.0]):
        r = np.linspace(0.25, 1.0, 7) + rng.normal(0, 0.025, 7)
        x, y = r * np.cos(ray), r * np.sin(ray)
        xyz.append(np.stack([x, y, 0.05 * x - 0.08 * y**2], axis=1))
        normal.append(np.stack([np.full(7, -0.05), 0.16 * y, np.ones(7)], axis=1))
    for side in (-1.0, 1.0):
        place = scattered(rng, 6, (0.25, 0.2))
        xyz.append(np.stack([0.75 + place[:, 0], np.full(6, 0.004 * side), 0.06 + place[:, 1]], axis=1))
        normal.append(np.tile([0.0, side, 0.35], (6, 1)))
    return table(np.concatenate(xyz), np.concatenate(normal))


def field(rng: np.random.Generator) -> MarkerSet:
    """150 discs in a box as deep as it is wide, their normals unknown."""
    return table(rng.uniform(-0.5, 0.5, (150, 3)))


def flat_wing(rng: np.random.Generator) -> MarkerSet:
    """A tapered plate with 28 discs in near-regular rows; exactly flat."""
    s, c = np.meshgrid(np.linspace(0, 1, 7), (np.arange(4) + 0.5) / 4, indexing="ij")
    s, c = (s + rng.normal(0, 0.01, s.shape)).ravel(), (c + rng.normal(0, 0.02, c.shape)).ravel()
    xyz = np.stack([0.4 * s + (0.5 - 0.25 * s) * c, s, np.zeros_like(s)], axis=1)
    return table(xyz, np.tile([0.0, 0.0, 1.0], (28, 1)))


def aircraft(rng: np.random.Generator, irregular: float) -> MarkerSet:
    """A symmetric aircraft (half span 1): 16 discs on either wing and fin, so much (1 sigma) off exact symmetry."""
    place = scattered(rng, 16, (0.5, 0.85))
    y = 0.12 + place[:, 1]
    right = np.stack([place[:, 0] + 0.4 * y, y, 0.12 * y + rng.uniform(0, 0.05, 16)], axis=1)
    up = np.stack([rng.normal(0, 0.05, 16), np.full(16, -0.12), np.ones(16)], axis=1)
    left = right * [1, -1, 1] + rng.normal(0, irregular, right.shape)
    return table(np.concatenate([right, left]), np.concatenate([up, up * [1, -1, 1]]))


def rows(rng: np.random.Generator, count: int, *, apart: float, relief: float, jitter: float = 0.25) -> MarkerSet:
    """Two parallel rows of discs, length 1: so far apart, so much relief, the second row ``count`` places later.

    ``jitter`` (of the pitch) makes the places along the rows irregular; 0 is an exact pitch.
    """
    x = np.tile(np.arange(count) / (count - 1), 2)
    x += rng.normal(0, jitter / count, x.shape) if jitter else 0.0
    y = np.repeat([0.0, apart], count) + rng.normal(0, 0.01 * jitter, x.shape)
    z = rng.normal(0, relief, x.shape) if relief else np.zeros_like(x)
    return table(np.stack([x, y, z], axis=1), np.tile([0.0, 0.0, 1.0], (len(x), 1)))


def grid(columns: int, rows: int) -> MarkerSet:
    """An exact grid of pitch 1, column by column."""
    u, v = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    xyz = np.stack([u.ravel(), v.ravel(), np.zeros(u.size)], axis=1).astype(float)
    return table(xyz, np.tile([0.0, 0.0, 1.0], (len(xyz), 1)))


SOLID: tuple[Callable[[np.random.Generator], MarkerSet], ...] = (
    scenes.wing_and_body, scenes.wind_tunnel, building, fuselage, rake_plate, delta, field,
)  # fmt: skip
"""Models with depth."""
FLAT: tuple[Callable[[np.random.Generator], MarkerSet], ...] = (scenes.wing, flat_wing)
"""Models with little depth or none."""


def some(rng: np.random.Generator, kinds: tuple[Callable[[np.random.Generator], MarkerSet], ...]) -> MarkerSet:
    """One of the kinds."""
    return kinds[rng.integers(len(kinds))](rng)
