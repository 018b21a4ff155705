"""What of a grid is wall: it does not move with the model, whose pose then says nothing of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from windmark import io, resection
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.project_entries import GridEntry
from windmark.scene import MarkerSet, Mesh


def wall_volumes(table: Path | None, grid: GridEntry, mesh: Mesh, lengths: Lengths) -> tuple[str, ...]:
    """The volumes of the grid that bear markers of role "wall" and none of the model, by the whole table of markers.

    None without a table, and where the project names the volumes that take part itself.

    Raises
    ------
    FileError
        For a volume that bears both: what of it moves cannot be told.
    """
    if table is None or grid.volumes is not None:
        return ()
    every = lengths.markers(table, None)
    wall, model = _borne(mesh, every.with_role("wall")), _borne(mesh, every.with_role("model", "primary", "secondary"))
    if both := sorted(set(wall) & set(model)):
        what = (
            f"volume {both[0]!r} bears markers of walls ({wall[both[0]]}) and of the model ({model[both[0]]}), so the "
            "wall would move with the model; expected the model's own parts to be named (volumes, --volume), or a grid "
            "in which walls are parts of their own"
        )
        raise io.FileError(grid.file, what)
    return tuple(sorted(wall))


def _borne(mesh: Mesh, markers: MarkerSet) -> dict[str, str]:
    """The volumes on which markers lie, each with the name of one of them."""
    if not len(markers) or not len(mesh.triangles):
        return {}
    on = resection.nearest_on_surface(mesh, markers.xyz).triangle
    found = np.flatnonzero(on >= 0)
    return dict(zip(mesh.volume[on[found]].tolist(), markers.name[found].tolist(), strict=True))


def without(mesh: Mesh, volumes: tuple[str, ...]) -> Mesh:
    """The mesh as if some volumes were not in its file: their nodes stay, in no triangle."""
    keep = ~np.isin(mesh.volume, volumes)
    return mesh if keep.all() else replace(mesh, triangles=mesh.triangles[keep], volume=mesh.volume[keep])


def walls_note(volumes: tuple[str, ...], where: str) -> str:
    """What is said of them."""
    return f"walls by the markers on them, which do not move with the model: {', '.join(volumes)}; left out of {where}"
