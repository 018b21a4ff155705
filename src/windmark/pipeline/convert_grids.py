"""A surface grid into another format: read, named, turned, scaled, written, read back and compared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast, get_args

import numpy as np

from windmark import io, resection
from windmark.errors import UsageError, WindmarkError
from windmark.io import GridFile
from windmark.io.fields import single_is_exact
from windmark.io.plot3d import Face
from windmark.pipeline.convert_compare import Difference, compare
from windmark.pipeline.convert_layout import read_layout, write_layout
from windmark.pipeline.convert_units import scale_to, source_unit
from windmark.scene import Block, Mesh

Record = dict[str, Any]
ORIENTATIONS = ("file", "auto")


@dataclass(frozen=True)
class GridOptions:
    """How a grid is converted.

    Parameters
    ----------
    unit, to_unit : length unit of the source where it says none, and the one wanted (the coordinates are scaled)
    volumes : volume -> zones (or volumes) of the file it is made of; what is not named is left out. Empty: all as it is
    volume_face : of a PLOT3D file of volume blocks the face that is the surface
    orientation : "file" leaves the triangles as they are, "auto" turns them outward
    from_plot3d, plot3d : layout of source and target in words, see `convert_layout.WORDS`
    values : PLOT3D function file with the values of a PLOT3D source
    """

    unit: str | None = None
    to_unit: str | None = None
    volumes: Mapping[str, tuple[str, ...]] | None = None
    volume_face: str | None = None
    orientation: str = "file"
    from_plot3d: str | None = None
    plot3d: str | None = None
    values: Path | None = None

    def __post_init__(self) -> None:
        if self.orientation not in ORIENTATIONS:
            raise UsageError(f"--orientation must be one of {', '.join(ORIENTATIONS)}, got {self.orientation!r}")
        if self.volume_face is not None and self.volume_face not in get_args(Face):
            raise UsageError(f"--volume-face must be one of {', '.join(get_args(Face))}, got {self.volume_face!r}")


def convert_grid(source: Path, target: Path, options: GridOptions) -> Record:
    """Convert one grid file; the target is written whole, and only if it reads back as the same surface.

    Returns
    -------
    What was done, in figures: formats, counts, unit and scale, what is lost, how exact it is.

    Raises
    ------
    ValueError
        For options that do not fit the files, a unit that is missing, a mesh that the format cannot hold.
    FileError
        For a file that cannot be read or written.
    """
    kind = io.written_grid_format(target)
    grid, done = _read(source, options)
    if options.plot3d is not None and kind != "PLOT3D":
        raise UsageError(f"--plot3d is for PLOT3D targets; {target} is {kind}")
    unit = source_unit(source, grid.length_unit, options.unit)
    factor, unit = scale_to(source, unit, options.to_unit)
    if kind in io.UNIT_FORMATS and not unit:
        raise UsageError(f"{source}: the file does not say its length unit, and {kind} keeps it: give --unit")
    mesh = grid.mesh
    if kind == "PLOT3D" and not mesh.blocks:
        what = f"{len(mesh.triangles)} triangles without structured blocks"
        raise UsageError(f"{source}: has {what}, and PLOT3D holds blocks only; expected another target, such as .vtp")
    if factor != 1.0:
        mesh = replace(mesh, vertices=mesh.vertices * factor)
    meant = replace(grid, mesh=mesh, length_unit=unit)
    layout = None
    if kind == "PLOT3D":
        blanked = mesh.blanked is not None and bool(mesh.blanked.any())
        exact = single_is_exact(mesh.vertices)
        layout = write_layout(options.plot3d, grid.layout, blanked, not exact, len(mesh.blocks))
    again, beside, difference = _write(target, meant, kind, layout)
    return {
        "kind": "grid", "input": source, "from": grid.format, "output": target, "to": kind, "beside": beside,
        "nodes": len(mesh.vertices), "triangles": len(mesh.triangles), "blocks": len(mesh.blocks),
        "volumes": np.unique(mesh.volume).tolist(), "values": list(grid.fields), "length_unit": unit or None,
        "scale": factor, "layout": None if layout is None else layout.words, "done": done,
        "lost": list(difference.lost), "harm": list(difference.harm),
        "size": float(np.linalg.norm(np.ptp(mesh.vertices, axis=0))), "nodes_read_back": len(again.mesh.vertices),
        "read_back_largest": difference.largest, "read_back_relative": difference.relative,
        "read_back": difference.words,
    }  # fmt: skip


def _read(source: Path, options: GridOptions) -> tuple[GridFile, list[str]]:
    """The grid with the wanted volumes and orientation, and what was done to it in words."""
    volume_of = {zone: name for name, zones in (options.volumes or {}).items() for zone in zones}
    plot3d = io.grid_format(source) == "PLOT3D"
    if options.from_plot3d is not None and not plot3d:
        raise UsageError(f"--from-plot3d is for PLOT3D files; {source} is {io.grid_format(source)}")
    layout = read_layout(source, options.from_plot3d)
    try:
        grid = io.read_grid_file(
            source, volumes=volume_of or None, volume_face=cast("Face | None", options.volume_face), layout=layout,
            values=options.values,
        )  # fmt: skip
    except io.FileError:
        raise
    except WindmarkError as error:  # a zone that the file has not
        raise io.FileError(source, str(error)) from error
    done = []
    if grid.layout is not None:
        done.append(f"read as {grid.layout.words}" + (f" ({grid.layout.note})" if grid.layout.note else ""))
    if volume_of:
        grid, dropped = _only(grid, list(volume_of.values()))
        done += [f"left out: {', '.join(dropped)}, which no --volume names"] if dropped else []
    if not len(grid.mesh.triangles):
        raise io.FileError(source, "has no triangles; expected a surface")
    if options.orientation == "auto":
        turned = resection.orient_outward(grid.mesh)
        count = int((turned.triangles != grid.mesh.triangles).any(axis=1).sum())
        grid = replace(grid, mesh=turned)
        done.append(f"turned outward: {count} of {len(turned.triangles)} triangles")
    return grid, done


def _only(grid: GridFile, wanted: list[str]) -> tuple[GridFile, list[str]]:
    """The grid of some volumes with their nodes, and the names of the others."""
    mesh = grid.mesh
    kept = np.isin(mesh.volume, wanted)
    dropped = np.unique(mesh.volume[~kept]).tolist()
    if not dropped:
        return grid, []
    inside = np.zeros(len(mesh.vertices), dtype=bool)
    inside[mesh.triangles[~kept]] = True
    blocks: tuple[Block, ...] = ()
    if mesh.blocks:  # a block is whole or not there
        starts = np.array([b.first for b in mesh.blocks])
        of_triangle = np.searchsorted(starts, mesh.triangles[:, 0], side="right") - 1
        some = [k for k in range(len(mesh.blocks)) if not (of_triangle == k).any() or kept[of_triangle == k].any()]
        inside[:] = True
        for k in some:
            inside[mesh.blocks[k].first : mesh.blocks[k].first + mesh.blocks[k].size] = False
        ends = np.cumsum([0, *(mesh.blocks[k].size for k in some)])
        blocks = tuple(replace(mesh.blocks[k], first=int(first)) for k, first in zip(some, ends, strict=False))
    else:
        inside[mesh.triangles[kept]] = False
    new = np.cumsum(~inside) - 1
    blanked = None if mesh.blanked is None else mesh.blanked[~inside]
    triangles = new[mesh.triangles[kept]].astype(np.int32)
    smaller = Mesh(mesh.vertices[~inside], triangles, mesh.volume[kept], blocks, blanked)
    fields = {name: values[~inside] for name, values in grid.fields.items()}
    return replace(grid, mesh=smaller, fields=fields), dropped


def _write(
    target: Path, meant: GridFile, kind: str, layout: io.Plot3dLayout | None
) -> tuple[GridFile, list[Path], Difference]:
    """Write, read back, compare: the target appears only if it is the same surface."""
    suffix = target.suffix.lower()
    if suffix == ".vtm":  # a file and a folder of its name, which belong together: tried elsewhere first
        with TemporaryDirectory() as place:
            io.write_grid_file(Path(place) / target.name, meant)
            again = io.read_grid_file(Path(place) / target.name)
            difference = _checked(target, meant, again)
        io.write_grid_file(target, meant)
        return again, [target.with_suffix("")], difference
    with io.atomic_path(target) as temporary:
        bare = replace(meant, fields={}) if kind == "PLOT3D" else meant  # its values are a file of their own
        io.write_grid_file(temporary, bare, layout=layout)
        again = io.read_grid_file(temporary, layout=layout)
        difference = _checked(target, meant, again)
        beside = []
        if kind == "PLOT3D" and meant.fields and layout is not None:
            beside = [target.with_suffix(".f"), target.with_suffix(".nam")]
            io.write_plot3d_function(beside[0], meant.mesh, meant.fields, units=meant.units, layout=layout)
            again = io.read_grid_file(temporary, layout=layout, values=beside[0])
            difference = _checked(target, meant, again)
    return again, beside, difference


def _checked(target: Path, meant: GridFile, again: GridFile) -> Difference:
    difference = compare(meant, again)
    if difference.problem:
        raise io.FileError(target, f"{difference.problem}; expected the same surface, so it was not written")
    return difference
