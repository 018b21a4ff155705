"""Where the markers are painted: near-regular rows, as an engineer lays them out by hand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from windmark.scene import MarkerSet
from windmark.synth.patch import Patch
from windmark.synth.wing import HalfModel

Array = NDArray[np.float64]


def rows_layout(
    shape: HalfModel,
    patches: Mapping[str, Patch],
    rng: np.random.Generator,
    *,
    upper: tuple[int, int] = (6, 4),
    lower: tuple[int, int] = (2, 2),
    body: int = 6,
    floor: tuple[int, int] = (3, 3),
    side: int = 2,
    jitter: float = 4.0,
    radius: float = 2.5,
    wall_radius: float = 4.0,
) -> MarkerSet:
    """Markers on wing (W..), body (B..) and walls (T..), named and exact.

    Parameters
    ----------
    shape, patches : the half model and its blocks (`HalfModel.patches`)
    upper, lower : (rows along the span, columns along the chord) on the two surfaces of the wing;
        those of the lower surface are hidden from a camera above the wing
    body : markers on the body, the last one underneath
    floor : (columns along x, rows along y) on the floor
    side : markers on the side wall, at least 0
    jitter : standard deviation of the hand's error along the surface, clipped at two of them; 0 gives
        a regular layout, which a matcher may find ambiguous
    radius, wall_radius : radii of the discs on the model and on the walls

    Returns
    -------
    MarkerSet
        Centres lie on the mesh's flat triangles, normals are those of the smooth surface.
    """
    root, span = shape.wing_root, shape.span
    parts = []
    for name, (rows, columns) in (("wing_upper", upper), ("wing_lower", lower)):
        y, xc = np.meshgrid(
            np.linspace(shape.body_radius + 0.06 * span, 0.955 * span, rows), np.linspace(0.15, 0.83, columns)
        )
        y = y.T.ravel() + _hand(rng, jitter, y.size)
        xc = xc.T.ravel() + _hand(rng, jitter, y.size) / shape.chord(y)
        s = np.arccos(1 - 2 * np.clip(xc, 0.06, 0.94)) / np.pi
        parts.append(patches[name].place(s, np.clip((y - root) / (span - root), 0, 1)))
    wing = sum(len(xyz) for xyz, _ in parts)
    parts.append(_on_body(shape, patches["body"], rng, body, jitter))
    parts.append(_on_floor(shape, patches["floor"], rng, floor, jitter))
    parts.append(_on_side(shape, patches["side"], rng, side, jitter))
    xyz, normal = (np.concatenate([p[k] for p in parts]) for k in (0, 1))
    walls = len(xyz) - wing - body
    names = [f"{letter}{k + 1:02d}" for letter, n in (("W", wing), ("B", body), ("T", walls)) for k in range(n)]
    return MarkerSet.make(
        names,
        xyz,
        radius=np.repeat([radius, radius, wall_radius], [wing, body, walls]),
        normal=normal,
        volume=np.repeat(["wing", "body", "wall"], [wing, body, walls]),
        role=np.repeat(["model", "model", "wall"], [wing, body, walls]),
    )


def _hand(rng: np.random.Generator, jitter: float, n: int) -> Array:
    return jitter * np.clip(rng.standard_normal(n), -2, 2)


def _on_body(
    shape: HalfModel, patch: Patch, rng: np.random.Generator, count: int, jitter: float
) -> tuple[Array, Array]:
    """Two staggered rows above the wing, the last marker underneath."""
    length = shape.body_tail - shape.body_nose
    s = np.linspace(0.16, 0.84, count) + _hand(rng, jitter, count) / length
    t = np.where(np.arange(count) % 2 == 0, 0.15, 0.31) + _hand(rng, jitter, count) / (np.pi * shape.body_radius)
    if count:
        t[-1] = 0.8
    return patch.place(np.clip(s, 0, 1), np.clip(t, 0, 1))


def _on_floor(
    shape: HalfModel, patch: Patch, rng: np.random.Generator, counts: tuple[int, int], jitter: float
) -> tuple[Array, Array]:
    """A grid under the model; a wing above hides some of it."""
    width = shape.wall_x[1] - shape.wall_x[0]
    x, y = np.meshgrid(
        np.linspace(shape.body_nose + 0.1 * width, shape.body_tail, counts[0]),
        np.linspace(0.2, 0.78, counts[1]) * shape.floor_width,
    )
    s = (x.ravel() + _hand(rng, 4 * jitter, x.size) - shape.wall_x[0]) / width
    t = (y.ravel() + _hand(rng, 4 * jitter, x.size)) / shape.floor_width
    return patch.place(s, t)


def _on_side(
    shape: HalfModel, patch: Patch, rng: np.random.Generator, count: int, jitter: float
) -> tuple[Array, Array]:
    """A row high on the side wall, above the body."""
    width, height = shape.wall_x[1] - shape.wall_x[0], shape.wall_top - shape.floor_z
    x = np.linspace(shape.body_nose + 0.12 * width, shape.body_tail - 0.1 * width, count)
    s = (0.55 * shape.wall_top - shape.floor_z + _hand(rng, jitter, count)) / height
    t = (x + _hand(rng, jitter, count) - shape.wall_x[0]) / width
    return patch.place(s, t)
