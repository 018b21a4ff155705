"""The deformed grid of a frame as files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.deformation import Deformation
from windmark.pipeline.deform.entries import OutputEntry
from windmark.pipeline.deform.load import Loaded
from windmark.pipeline.deform.record import FrameRecord
from windmark.pipeline.deform.values import units
from windmark.tasks.deform.task import DeformedFrame
from windmark.tasks.deform.zero import Zero, displaced_since

Array = NDArray[np.float64]

GRIDS = "grid"
"""Folder of the grids."""


def gridded(wanted: OutputEntry, frame: DeformedFrame) -> bool:
    """Whether the grid of a frame is written."""
    return bool(wanted.grid) and frame.index % wanted.every == 0


def write_grid_series(folder: Path, wanted: OutputEntry, records: Sequence[FrameRecord]) -> None:
    """The collection ``grid.pvd`` that shows all grids written in ParaView at their frames' times."""
    if "vtk" not in wanted.grid:
        return
    files = {f"{GRIDS}/{r.key}.vtp": r.time_s for r in records}
    io.write_collection(folder / "grid.pvd", [(time, file) for file, time in files.items() if (folder / file).exists()])


def write_grid(
    folder: Path, loaded: Loaded, frame: DeformedFrame, state: Deformation, mapped: Mapping[str, Array],
    zero: Zero | None = None,
) -> None:  # fmt: skip
    """Write the grid of a frame, displaced, where the project wants it (`gridded`).

    Parameters
    ----------
    folder : of the results; the files go into `GRIDS` there
    state : of the frame
    mapped : values at the grid's nodes, see `Mapper.frame`
    zero : the wind-off state that displacement and deformation are relative to; None for the grid as it is
    """
    wanted = loaded.project.output
    if not gridded(wanted, frame):
        return
    from windmark.deformation import bound_vertices

    mesh = loaded.mesh
    assert mesh is not None
    (folder / GRIDS).mkdir(exist_ok=True)
    placed = bound_vertices(state.volumes, mesh)
    moved = state.mesh(mesh, placed=placed)
    unit = loaded.project.length_unit
    if "plot3d" in wanted.grid:
        io.write_mesh(folder / GRIDS / f"{frame.key}.xyz", moved, length_unit=unit)
    if "vtk" in wanted.grid:
        shift = moved.vertices - (mesh.vertices if zero is None else zero.rest(placed, "tunnel"))
        place, cov = displaced_since(zero, state, placed, frame="model")
        fields = {
            "displacement_x": shift[:, 0], "displacement_y": shift[:, 1], "displacement_z": shift[:, 2],
            "deformation": np.linalg.norm(place, axis=1),
            "sigma_deformation": np.sqrt(np.trace(cov, axis1=1, axis2=2)),
        }  # fmt: skip
        io.write_nodes_vtk(folder / GRIDS / f"{frame.key}.vtp", moved, {**fields, **mapped},
                           units={**dict.fromkeys(fields, unit), **units(mapped)})  # fmt: skip
