"""A grid file with all that it holds beside the surface: values at the nodes, units, how it is stored."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.io.errors import FileError
from windmark.io.fields import LENGTH, split_label
from windmark.io.mesh import PLOT3D_SUFFIXES, TECPLOT_SUFFIXES, checked_nodes, grid_format, read_mesh, write_mesh
from windmark.io.netcdf import read_nodes_netcdf, write_nodes_netcdf
from windmark.io.plot3d import Face, detect_plot3d, read_plot3d, write_plot3d
from windmark.io.plot3d_detect import candidates, load
from windmark.io.plot3d_function import read_plot3d_function, write_plot3d_function
from windmark.io.plot3d_layout import Plot3dLayout
from windmark.io.structured import Volumes, rename_volumes
from windmark.io.tecplot import write_tecplot
from windmark.io.tecplot_read import read_tecplot_nodes
from windmark.io.vtk_read import read_vtk_nodes
from windmark.io.vtk_write import SUFFIXES as VTK_SUFFIXES
from windmark.io.vtk_write import write_nodes_vtk
from windmark.scene import Mesh

UNIT_FORMATS = ("Tecplot", "OBJ", "PLY", "VTK", "NetCDF")
"""Formats with a place for the length unit."""


@dataclass(frozen=True)
class GridFile:
    """What a grid file holds.

    Parameters
    ----------
    mesh : the surface, in the file's order
    format : one of `GRID_FORMATS`
    length_unit : of the coordinates, "" where the file does not say
    fields : name -> (V,) values at the nodes
    units : name -> unit of a field, where one is known
    layout : how a PLOT3D file is stored, None for others
    left_out : what of the file is not here, in words
    """

    mesh: Mesh
    format: str
    length_unit: str = ""
    fields: Mapping[str, NDArray[np.floating]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    layout: Plot3dLayout | None = None
    left_out: tuple[str, ...] = ()


def read_grid_file(
    path: str | os.PathLike[str],
    *,
    volumes: Volumes = None,
    volume_face: Face | None = None,
    layout: Plot3dLayout | None = None,
    values: str | os.PathLike[str] | None = None,
) -> GridFile:
    """As `read_mesh`, with the values at the nodes and the units that the file holds.

    Parameters
    ----------
    path, volumes, volume_face : as of `read_mesh`
    layout : of a PLOT3D file, where sizes and numbers do not decide
    values : PLOT3D function file that belongs to the grid; its names are those of the ``.nam`` file beside it

    Raises
    ------
    ValueError
        For ``layout``, ``values`` or ``volume_face`` with another format, or a volume that the file has not.
    FileError
        For a damaged file.
    """
    kind = grid_format(path)
    if kind != "PLOT3D" and not (layout is None and values is None and volume_face is None):
        given = next(n for n, v in (("layout", layout), ("values", values), ("volume_face", volume_face)) if v)
        raise UsageError(f"{given}: is for PLOT3D files; {path} is {kind}")
    if kind == "PLOT3D":
        mesh = read_plot3d(path, volumes=volumes, volume_face=volume_face, layout=layout)
        fields = {} if values is None else read_plot3d_function(values, mesh)
        units: dict[str, str] = {}
        for name in list(fields):
            short, unit = split_label(name)
            fields[short] = fields.pop(name)
            units |= {short: unit} if unit else {}
        return GridFile(mesh, kind, "", fields, units, layout or detect_plot3d(path))
    if kind == "Tecplot":
        mesh, fields, units = read_tecplot_nodes(path, volumes=volumes)
        return GridFile(checked_nodes(path, mesh), kind, units.pop(LENGTH, ""), fields, units)
    if kind == "VTK":
        mesh, fields, units, left_out = read_vtk_nodes(path, volumes=volumes)
        return GridFile(checked_nodes(path, mesh), kind, units.pop(LENGTH, ""), fields, units, None, left_out)
    if kind == "NetCDF":
        mesh, fields, units, history = read_nodes_netcdf(path)
        found, which = np.unique(mesh.volume, return_inverse=True)
        names = np.array(rename_volumes([str(n) for n in found], volumes), dtype=np.str_)
        mesh = replace(mesh, volume=names[which])
        left_out = ("the history of the values",) if history else ()
        return GridFile(checked_nodes(path, mesh), kind, units.pop(LENGTH, ""), fields, units, None, left_out)
    mesh = read_mesh(path, volumes=volumes)
    return GridFile(mesh, kind, mesh.length_unit)


def written_grid_format(path: str | os.PathLike[str]) -> str:
    """The format that `write_grid_file` takes by the extension, one of `GRID_FORMATS`; "" for an unknown one."""
    suffix = Path(path).suffix.lower()
    if suffix in PLOT3D_SUFFIXES:
        return "PLOT3D"
    if suffix in TECPLOT_SUFFIXES:
        return "Tecplot"
    if suffix in VTK_SUFFIXES:
        return "VTK"
    return {".stl": "STL", ".obj": "OBJ", ".ply": "PLY", ".tri": "Cart3D", ".nc": "NetCDF"}.get(suffix, "")


def write_grid_file(path: str | os.PathLike[str], grid: GridFile, *, layout: Plot3dLayout | None = None) -> list[Path]:
    """Write a grid in the format of the extension, with its values and units where the format has a place.

    Values go with PLOT3D grids as a function file of the same name (``.f``) and its names (``.nam``).

    Returns
    -------
    The files beside ``path`` that were written.

    Raises
    ------
    ValueError
        For an unknown extension, a mesh or values that the format cannot hold.
    FileError
        Where a file cannot be written.
    """
    kind, units = written_grid_format(path), {**grid.units, LENGTH: grid.length_unit}
    if kind == "PLOT3D":
        write_plot3d(path, grid.mesh, layout=layout)
        if not grid.fields:
            return []
        beside = Path(path).with_suffix(".f")
        if beside == Path(path):
            raise UsageError(f"path: {path} must not end in .f, which is for the values")
        kept = Plot3dLayout() if layout is None else layout
        write_plot3d_function(beside, grid.mesh, grid.fields, units=grid.units, layout=kept)
        return [beside, beside.with_suffix(".nam")]
    if kind == "Tecplot":
        write_tecplot(path, grid.mesh, grid.fields, units=units)
    elif kind == "VTK":
        write_nodes_vtk(path, grid.mesh, grid.fields, units=units)
    elif kind == "NetCDF":
        write_nodes_netcdf(path, grid.mesh, grid.fields, units=units)
    else:
        write_mesh(path, grid.mesh, length_unit=grid.length_unit)
    return []


def fitting_layouts(path: str | os.PathLike[str]) -> list[Plot3dLayout]:
    """Every layout that the sizes in a PLOT3D grid allow, whatever its numbers say.

    Raises
    ------
    FileError
        For a file that cannot be read.
    """
    found = [candidate.layout for candidate in candidates(load(path), "grid")]
    if not found:
        detect_plot3d(path)  # says what is wrong
        raise FileError(path, "fits no layout of PLOT3D")
    return found
