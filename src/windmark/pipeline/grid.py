"""The grid as a job uses it: the wanted volumes, turned outward."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from windmark import io, resection
from windmark.errors import WindmarkError, g2
from windmark.geometry import Camera, Pose, surface_curvature
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.project_entries import GridEntry
from windmark.scene import MarkerSet, Mesh

ROUGH = 0.01
"""Part of the surface's size within which rough coordinates are of markers that lie on it."""


def read_grid(entry: GridEntry, lengths: Lengths, cameras: Sequence[tuple[Camera, Pose]] = ()) -> Mesh:
    """Read a grid, keep the wanted volumes and orient it (see `oriented`).

    Nodes stay as they are in the file, so results can be written in its order; those of other volumes
    are in no triangle any more, and nothing depends on where they are.

    Raises
    ------
    FileError
        When the file cannot be read, has no such zone, or is in another length unit.
    """
    return oriented(read_surface(entry, lengths), entry, cameras)


def read_surface(entry: GridEntry, lengths: Lengths) -> Mesh:
    """As `read_grid`, with the orientation that the file gives."""
    volume_of = {zone: name for name, zones in (entry.volumes or {}).items() for zone in zones}
    try:
        return lengths.mesh(entry.file, volumes=volume_of or None, volume_face=entry.volume_face, only=bool(volume_of))
    except io.FileError:
        raise
    except WindmarkError as error:  # a zone that the file has not, a face of a grid that has no volume blocks
        raise io.FileError(entry.file, str(error)) from error


def oriented(mesh: Mesh, entry: GridEntry, cameras: Sequence[tuple[Camera, Pose]] = ()) -> Mesh:
    """The grid with its triangles turned to the air, unless the entry says that the file is right.

    ``cameras`` with their poses tell the air side of what they see: the inside of walls, the outside of the model.
    """
    return mesh if entry.orientation == "file" else resection.orient_outward(mesh, cameras=cameras)


def sides_words(mesh: Mesh, turned: Mesh, entry: GridEntry) -> list[str]:
    """What is to be said of parts without thickness of which nothing tells which zone is which side.

    ``mesh`` is as the file has it, ``turned`` as `oriented` made it.
    """
    if entry.orientation == "file":
        return []
    return [
        f"{a} and {b} lie on each other, the two sides of a part without thickness, and nothing tells which of them is "
        "which side: their windings are alike, or those of other zones differ; the values of either may be the other's"
        for a, b in resection.sides_in_doubt(mesh, turned)
    ]


def with_curvature(markers: MarkerSet, mesh: Mesh | None, reach: float | None = None) -> MarkerSet:
    """The markers with the curvature of the surface that they lie on: their discs' images are not centred on them.

    ``reach``: how far from it they may be that lie on it; None: their radius.
    """
    if mesh is None:
        return markers
    if resection.wound_both_ways(mesh):  # nodes on the other side of a thin part are told by their normals
        mesh = resection.orient_outward(mesh)
    form = surface_curvature(mesh.vertices, mesh.triangles, markers.xyz, markers.normal, markers.radius, reach=reach)
    return replace(markers, curvature=form)


def curved_by(markers: MarkerSet, grid: Path, lengths: Lengths) -> tuple[MarkerSet, str]:
    """`with_curvature` by a grid that is given for nothing else, and what is to be said of it ("": nothing).

    Tables may be rough: the surface bends beside a marker's true place much as at it, so what is near counts as on it.

    Raises
    ------
    FileError
        When the grid cannot be read, is in another unit, or can do nothing: no marker has a normal and a radius, or
        none lies near the surface.
    """
    mesh = lengths.mesh(grid)
    known = np.isfinite(markers.normal).all(axis=1) & np.isfinite(markers.radius)
    if not known.any():
        raise io.FileError(grid, "does nothing for the markers: none of the table has a normal and a radius")
    model = known & (markers.role != "wall")
    asked = np.flatnonzero(model if model.any() else known)  # walls are on no grid of a model, but on one of walls
    reach = max(ROUGH * mesh.size, float(markers.radius[known].max()))
    near = resection.nearest_on_surface(mesh, markers.xyz[asked], max_distance=reach)
    flat = int((near.triangle < 0).sum())
    said = f"{flat} of {len(asked)} markers are over {g2(reach)} {lengths.unit} off its surface"
    said += "; their discs count as flat"
    if flat == len(asked):
        raise io.FileError(grid, f"does nothing for the markers: {said}")
    return with_curvature(markers, mesh, reach), said if flat else ""
