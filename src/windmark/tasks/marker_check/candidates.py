"""Places where a marker could be moved to or added: on the surface, between the markers that are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g3
from windmark.scene import MarkerSet, Mesh
from windmark.tasks.marker_check.stage import Stage

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NEIGHBOURS = 6
PARTS = (0.35, 0.5)
"""How far towards a neighbour a marker is moved."""
TURNED = 0.8
"""Cosine of the angle between the normals of neighbours on one piece of surface."""
CLEAR, CLEAR_RADII = 0.3, 4.0
"""A new place is at least this part of the typical spacing, and so many radii, away from other markers."""
MOST = 240
"""Candidates that are weighed; more are thinned out evenly."""


@dataclass(frozen=True, eq=False)
class Change:
    """One marker moved, or one added.

    Parameters
    ----------
    name : the marker; of an added one its new name
    place, normal : (3,) where it is to be, and the surface's normal there (NaN where unknown)
    old : (3,) where it is; None for an added one
    near : the markers between which it lies then
    """

    name: str
    place: Array
    normal: Array
    old: Array | None
    near: tuple[str, ...]

    @property
    def kind(self) -> str:
        """One of move and add."""
        return "add" if self.old is None else "move"

    def words(self, unit: str) -> str:
        """What to do."""
        if self.old is None:
            return f"add a marker at ({_numbers(self.place)}) {unit}, between {' and '.join(self.near)}"
        step = self.place - self.old
        return (
            f"move {self.name} by ({_numbers(step)}) {unit}, {g3(np.linalg.norm(step))} {unit} towards"
            f" {' and '.join(self.near)}"
        )

    def apply(self, markers: MarkerSet) -> MarkerSet:
        """The layout with the change made."""
        if self.old is not None:
            k = markers.name.tolist().index(self.name)
            xyz, normal = markers.xyz.copy(), markers.normal.copy()
            xyz[k], normal[k] = self.place, self.normal
            return replace(markers, xyz=xyz, normal=normal)
        like = markers.name.tolist().index(self.near[0])  # radius, volume and role are its neighbour's
        rows: dict[str, Any] = {name: [*column, column[like]] for name, column in markers.columns.items()}
        rows["name"][-1], rows["xyz"][-1], rows["normal"][-1] = self.name, self.place, self.normal
        return replace(markers, **{name: np.array(values) for name, values in rows.items()})  # type: ignore[arg-type]


def candidates(stage: Stage, kind: str, fixed: Sequence[str] = ()) -> list[Change]:
    """Changes worth a thought: "move" or "add"; markers named in ``fixed`` stay where they are."""
    markers = stage.markers
    spacing, pairs = _neighbours(markers)
    model = markers.role != "wall"
    found: list[Change] = []
    new = _new_name(markers)
    for i, j in pairs:
        if not (model[i] and model[j]):
            continue
        if kind == "add" and i < j:
            found.append(_between(stage, i, j, 0.5, None, new))
        if kind == "move" and markers.name[i] not in fixed:
            found += [_between(stage, i, j, part, i, str(markers.name[i])) for part in PARTS]
    found = [change for change in found if _is_clear(change, markers, spacing)]
    return found[:: max(1, -(-len(found) // MOST))]


def _neighbours(markers: MarkerSet) -> tuple[float, list[tuple[int, int]]]:
    """Typical distance of nearest neighbours, and ordered pairs of neighbours on one piece of surface."""
    from scipy.spatial import cKDTree

    k = min(NEIGHBOURS + 1, len(markers))
    distance, index = cKDTree(markers.xyz).query(markers.xyz, k=k)
    spacing = float(np.median(distance[:, 1]))
    pairs = set()
    for i in range(len(markers)):
        for j in index[i, 1:]:
            one_way = (markers.normal[i] * markers.normal[j]).sum()
            if i != j and not one_way < TURNED and np.linalg.norm(markers.xyz[i] - markers.xyz[j]) < 3 * spacing:
                pairs |= {(i, int(j)), (int(j), i)}
    return spacing, sorted(pairs)


def _between(stage: Stage, i: int, j: int, part: float, moved: int | None, name: str) -> Change:
    """A place on the surface a part of the way from one marker to another."""
    markers = stage.markers
    a, b = markers.xyz[i], markers.xyz[j]
    normal = (1 - part) * markers.normal[i] + part * markers.normal[j]
    normal = normal / np.linalg.norm(normal)
    place = (1 - part) * a + part * b
    bulge = part * (1 - part) / 2 * float((markers.normal[j] - markers.normal[i]) @ (b - a))
    if np.isfinite(bulge):
        # The chord of a curved surface runs below it; by the turn of the normals, to second order, this much.
        place = place + bulge * normal
    if stage.mesh is not None:
        place, normal = on_mesh(stage.mesh, place, normal)
    near = (str(markers.name[j]),) if moved is not None else (str(markers.name[i]), str(markers.name[j]))
    return Change(name, place, normal, None if moved is None else markers.xyz[moved], near)


def on_mesh(mesh: Mesh, place: Array, normal: Array) -> tuple[Array, Array]:
    """The point of the surface next to a place, along its normal if that meets the surface nearby, and its normal.

    The normal of the triangle is turned to the side of the given one; (3,) each.
    """
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    close = np.argsort((((a + b + c) / 3 - place) ** 2).sum(axis=1))[:200]
    points, distance = _closest_on_triangles(a[close], b[close], c[close], place)
    best = int(np.argmin(distance))
    n = np.cross(b[close[best]] - a[close[best]], c[close[best]] - a[close[best]])
    n = n / max(float(np.linalg.norm(n)), 1e-300)
    if np.isfinite(normal).all() and n @ normal < 0:
        n = -n
    return points[best], n if np.isfinite(normal).all() else normal


def _closest_on_triangles(a: Array, b: Array, c: Array, p: Array) -> tuple[Array, Array]:
    """(T, 3) nearest points of triangles to a point, and (T,) distances: inside, or on one of the edges."""
    n = np.cross(b - a, c - a)
    n = n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-300)
    flat = p - ((p - a) * n).sum(axis=1, keepdims=True) * n
    inside = np.ones(len(a), bool)
    choices = [flat]
    for u, v in ((a, b), (b, c), (c, a)):
        inside &= (np.cross(v - u, flat - u) * n).sum(axis=1) >= 0
        along = ((p - u) * (v - u)).sum(axis=1) / np.maximum(((v - u) ** 2).sum(axis=1), 1e-300)
        choices.append(u + np.clip(along, 0, 1)[:, None] * (v - u))
    points = np.stack(choices)
    distance = np.linalg.norm(points - p, axis=2)
    distance[0, ~inside] = np.inf
    best = distance.argmin(axis=0)
    every = np.arange(len(a))
    return points[best, every], distance[best, every]


def _is_clear(change: Change, markers: MarkerSet, spacing: float) -> bool:
    others = markers.xyz if change.old is None else markers.xyz[markers.name != change.name]
    apart = float(np.linalg.norm(others - change.place, axis=1).min(initial=np.inf))
    radius = float(np.nan_to_num(markers.radius).max(initial=0.0))
    return apart >= max(CLEAR * spacing, CLEAR_RADII * radius)


def _new_name(markers: MarkerSet) -> str:
    taken = set(markers.name.tolist())
    return next(name for k in range(1, len(taken) + 2) if (name := f"NEW{k:02d}") not in taken)


def _numbers(v: Array) -> str:
    largest = float(np.abs(v).max())
    return ", ".join(f"{0.0 if abs(x) < 5e-4 * largest else x:.4g}" for x in v)
