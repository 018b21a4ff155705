"""Values where they are wanted: at taps and other points, along lines on the surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io, resection
from windmark.errors import WindmarkError
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.project import Project
from windmark.pipeline.wanted import LineEntry, PointsEntry
from windmark.resection import MergedValues, MergedViews, NodeView, PointValues, SurfacePoints
from windmark.resection.sources import Prepared
from windmark.scene import Mesh

Array = NDArray[np.float64]

NO_VALUE = "no value at any of the points of"
"""Begins what is said of a list without any."""


@dataclass(frozen=True)
class PointSet:
    """Points of a job, found on the surface.

    Parameters
    ----------
    kind : "points" or "line"
    name : of the list or the line
    names : (N,) of the points; a line's count from 1
    asked : (N, 3) as they were given
    surface : where they are on the grid
    limit : how far from the surface they may be
    arc : (N,) length along a line; None of points
    """

    kind: str
    name: str
    names: NDArray[np.str_]
    asked: Array
    surface: SurfacePoints
    limit: float
    arc: Array | None = None

    @property
    def far(self) -> NDArray[np.bool_]:
        """(N,) points with a place that are too far from the surface."""
        return np.asarray(np.isfinite(self.asked).all(axis=1) & (self.surface.triangle < 0))

    @property
    def stem(self) -> str:
        """Name of its files."""
        return f"{self.kind}-{self.name}"


@dataclass(frozen=True)
class PointTable:
    """What one image says at the points of a set."""

    of: PointSet
    values: PointValues


@dataclass(frozen=True)
class MergedTable:
    """Merged values at the points of a set: ``reason`` (N,) in words, "" where there is a value; ``names`` of the
    images that ``values.source`` counts in.
    """

    of: PointSet
    values: MergedValues
    names: tuple[str, ...]
    reason: NDArray[np.str_]


def read_lists(entries: Sequence[PointsEntry], lengths: Lengths) -> list[io.PointList]:
    """The lists of points as their files have them.

    Raises
    ------
    FileError
        For a list that cannot be read, has no points, or is in another length unit.
    """
    return [lengths.points(entry.file, entry.roles) for entry in entries]


def load_points(project: Project, lists: Sequence[io.PointList], mesh: Mesh) -> tuple[PointSet, ...]:
    """Put all lists of points on the grid, outward as it is now, and cut all lines.

    Raises
    ------
    FileError
        For a line that cannot be cut or meets a gap of the surface.
    """
    found = [on_grid(entry, points, mesh) for entry, points in zip(project.points, lists, strict=True)]
    return (*found, *(_line(project.path, i, entry, mesh) for i, entry in enumerate(project.line)))


def without_value(of: PointSet, why: str) -> str:
    """What is to be said of a list of which no point has a value."""
    return f"{NO_VALUE} {of.name} ({len(of.names)}): {why}"


def lists_on_grid(entries: Sequence[PointsEntry], lengths: Lengths, mesh: Mesh) -> tuple[PointSet, ...]:
    """`read_lists`, put on the grid."""
    return tuple(on_grid(e, points, mesh) for e, points in zip(entries, read_lists(entries, lengths), strict=True))


def on_grid(entry: PointsEntry, points: io.PointList, mesh: Mesh) -> PointSet:
    """One list of points on the grid; a volume of its table that the grid has holds the point to that volume."""
    known = np.isin(points.volume, np.unique(mesh.volume))
    limit = _limit(entry.max_distance, mesh)
    surface = resection.nearest_on_surface(
        mesh, points.xyz, normal=points.normal, volume=np.where(known, points.volume, ""), max_distance=limit
    )
    return PointSet("points", entry.label, points.name, points.xyz, surface, limit)


def _line(path: Path, i: int, entry: LineEntry, mesh: Mesh) -> PointSet:
    limit = _limit(entry.max_distance, mesh)
    key = f"line[{i}]"
    try:
        line = resection.surface_line(mesh, entry.start, entry.end, n=entry.n, spacing=entry.spacing,
                                      normal=entry.normal)  # fmt: skip
    except WindmarkError as error:
        raise io.FileError(path, f"line {entry.name}: {error!s}", key) from error
    for which, gap in zip(("start", "end"), line.gaps, strict=True):
        if gap > limit:
            raise io.FileError(
                path, f"line {entry.name}: the surface along the line is {gap:.4g} away from the {which} (at most"
                f" {limit:.4g} is allowed, max_distance): the point is off the surface, or the surface has a gap"
                " between start and end", key,
            )  # fmt: skip
    surface = resection.nearest_on_surface(mesh, line.xyz, max_distance=limit)
    names = np.array([str(k + 1) for k in range(len(line.arc))])
    return PointSet("line", entry.name, names, line.xyz, surface, limit, line.arc)


def _limit(max_distance: float | None, mesh: Mesh) -> float:
    return 2e-3 * mesh.size if max_distance is None else max_distance


def image_points(
    sets: tuple[PointSet, ...], source: Prepared, mesh: Mesh, *, max_obliquity_deg: float
) -> tuple[PointTable, ...]:
    """Values of one image at all sets."""
    return tuple(
        PointTable(s, resection.point_values(source, mesh, s.asked, s.surface, max_obliquity_deg=max_obliquity_deg))
        for s in sets
    )


def merged_points(sets: tuple[PointSet, ...], merged: MergedViews) -> tuple[MergedTable, ...]:
    """Merged values at all sets."""
    out = []
    for s in sets:
        values, views = merged.at(s.surface)
        reason = _reasons(s, merged, views, np.isfinite(values.value))
        lost = reason != ""
        values = MergedValues(
            np.where(lost, np.nan, values.value), np.where(lost, np.nan, values.sigma),
            np.where(lost, -1, values.source).astype(np.int8), np.where(lost, 0, values.pictures).astype(np.int8),
        )  # fmt: skip
        out.append(MergedTable(s, values, merged.names, reason))
    return tuple(out)


def _reasons(s: PointSet, merged: MergedViews, views: tuple[NodeView, ...], known: NDArray[np.bool_]
             ) -> NDArray[np.str_]:  # fmt: skip
    """Why there is no merged value: what holds for the point itself, or what each image says."""
    codes = [resection.point_reasons(s.asked, s.surface, view) for view in views]
    words = [resection.reason_words(c) for c in codes]
    itself = codes[0] >= len(resection.REASONS)
    out = []
    for k in range(len(known)):
        if itself[k]:
            out.append(str(words[0][k]))
        elif known[k]:
            out.append("")
        else:
            out.append("; ".join(f"{n}: {w[k] or 'no_pixel'}" for n, w in zip(merged.names, words, strict=True)))
    return np.array(out, dtype=np.str_)


def point_columns(table: PointTable, column: str) -> dict[str, NDArray]:
    """An image's values at points as columns of a file; ``column``: the name of the values."""
    v = table.values
    return {**places(table.of), column: v.value, "sigma": v.sigma, "reason": v.words, "column_px": v.xy[:, 0],
            "row_px": v.xy[:, 1]}  # fmt: skip


def merged_columns(table: MergedTable, column: str) -> dict[str, NDArray]:
    """Merged values at points as columns of a file; ``column``: the name of the values."""
    v = table.values
    image = np.array(["", *table.names], dtype=np.str_)[v.source.astype(int) + 1]
    return {**places(table.of), column: v.value, "sigma": v.sigma, "reason": table.reason, "image": image,
            "images": v.pictures}  # fmt: skip


def places(s: PointSet) -> dict[str, NDArray]:
    """Name, place as it was asked for, place on the surface and how far apart they are."""
    head: dict[str, NDArray] = {"name": s.names}
    if s.arc is not None:
        head = {"point": np.arange(1, len(s.arc) + 1), "arc": s.arc}
    at = s.surface
    return {
        **head, "x": s.asked[:, 0], "y": s.asked[:, 1], "z": s.asked[:, 2], "moved": at.distance,
        "on_x": at.xyz[:, 0], "on_y": at.xyz[:, 1], "on_z": at.xyz[:, 2],
    }  # fmt: skip


def point_units(length_unit: str, column: str, unit: str) -> dict[str, str]:
    """Units of these columns."""
    lengths = dict.fromkeys(("arc", "x", "y", "z", "moved", "on_x", "on_y", "on_z"), length_unit)
    return {"length": length_unit, **lengths, column: unit, "sigma": unit, "column_px": "px",
            "row_px": "px"}  # fmt: skip
