"""Read and write the model's surface grid in any of the known formats."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from windmark.errors import UsageError
from windmark.io.cart3d import read_cart3d, write_cart3d
from windmark.io.errors import LARGEST, FileError, reading
from windmark.io.fields import LENGTH
from windmark.io.netcdf import read_nodes_netcdf, write_nodes_netcdf
from windmark.io.obj import read_obj, write_obj
from windmark.io.plot3d import Face, read_plot3d, write_plot3d
from windmark.io.ply import read_ply, write_ply
from windmark.io.stl import read_stl, write_stl
from windmark.io.structured import Volumes, only_named, rename_volumes
from windmark.io.tecplot import write_tecplot
from windmark.io.tecplot_read import read_tecplot
from windmark.io.vtk_read import VTK_SUFFIXES, read_vtk
from windmark.io.vtk_write import SUFFIXES as VTK_WRITTEN
from windmark.io.vtk_write import write_nodes_vtk
from windmark.scene import Mesh
from windmark.scene.shown import PATH, check_kinds

PLOT3D_SUFFIXES = (".grid", ".grd", ".g", ".x", ".xyz", ".p3d", ".p3dfmt", ".fmt", ".unf")
"""Extensions under which `write_mesh` writes PLOT3D; any file that is nothing else is read as PLOT3D."""
TECPLOT_SUFFIXES = (".dat", ".tec")
GRID_SUFFIXES = (*PLOT3D_SUFFIXES, *TECPLOT_SUFFIXES, ".stl", ".obj", ".ply", ".tri", *VTK_WRITTEN, ".nc")
"""All extensions that `write_mesh` writes."""
_HEAD_BYTES = 4096
_COMMENT = re.compile(rb"^(?:#|comment)\s+length unit:\s*(\S+)\s*$", re.MULTILINE)
_MARK = "\x01"


def read_mesh(
    path: str | os.PathLike[str], *, volumes: Volumes = None, volume_face: Face | None = None, only: bool = False
) -> Mesh:
    """Read a surface grid: PLOT3D, Tecplot ASCII, STL, OBJ, PLY, Cart3D, VTK family, windmark's NetCDF.

    The content decides where it names its format, then the extension; what is left is taken for PLOT3D.

    Parameters
    ----------
    path : the file
    volumes : one volume name for the whole mesh, or {name in the file: volume} for some of its parts. Names in the
        file are those of blocks (PLOT3D: zone01 ...), zones, solids, groups; "model" where there is none
    volume_face : for PLOT3D files of volume blocks: the face that is the model, e.g. "kmin"
    only : parts that ``volumes`` does not name take no part: their nodes stay, whatever they are (NaN too), but they
        have no triangles

    Returns
    -------
    The surface in the file's own unit; ``length_unit`` is what the file says, "" where it does not.

    Raises
    ------
    ValueError
        For a name in ``volumes`` that the file has not, or ``volume_face`` with another format.
    FileError
        For a damaged file, one without faces, or nodes in use at NaN or infinity.

    Examples
    --------
    >>> import tempfile
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     wm.write_mesh(f"{folder}/plate.stl", plate)
    ...     read = wm.read_mesh(f"{folder}/plate.stl", volumes="plate")
    >>> read.triangle_normals().tolist(), read.volume.tolist()
    ([[0.0, 0.0, 2.0], [0.0, 0.0, 2.0]], ['plate', 'plate'])
    """
    if only and isinstance(volumes, Mapping):
        # A part that is not named may have the name of a volume: a mark tells them apart.
        marked = _read(path, {part: _MARK + name for part, name in volumes.items()}, volume_face, True)
        found, which = np.unique(marked.volume, return_inverse=True)
        names = np.array([str(name).removeprefix(_MARK) for name in found], dtype=np.str_)
        return replace(marked, volume=names[which])
    return _read(path, volumes, volume_face, False)


def _read(path: str | os.PathLike[str], volumes: Volumes, volume_face: Face | None, only: bool) -> Mesh:
    kind = grid_format(path)
    if kind == "PLOT3D":
        return read_plot3d(path, volumes=volumes, volume_face=volume_face, only=only)
    if volume_face is not None:
        raise UsageError(f"volume_face: is for PLOT3D volume blocks; {path} is another format")
    mesh = _READERS[kind](path, volumes)
    if kind in ("OBJ", "PLY"):
        mesh = replace(mesh, length_unit=_unit_in_comment(path))
    if only:
        mesh = only_named(mesh, volumes)
    return checked_nodes(path, mesh, only=only)


def _unit_in_comment(path: str | os.PathLike[str]) -> str:
    """The unit of length in a comment at the head of an OBJ or PLY file, as `write_mesh` writes it."""
    with reading(path), open(path, "rb") as stream:
        found = _COMMENT.search(stream.read(_HEAD_BYTES))
    return found[1].decode("utf-8", "replace") if found else ""


def checked_nodes(path: str | os.PathLike[str], mesh: Mesh, *, only: bool = False) -> Mesh:
    """The same mesh if every node (with ``only``: each in a triangle) is a number up to `LARGEST`; else `FileError`."""
    bad = np.asarray(~(np.abs(mesh.vertices) <= LARGEST).all(axis=1))
    if only:
        bad &= np.isin(np.arange(len(mesh.vertices)), mesh.used)
    if mesh.blanked is not None:
        bad &= ~mesh.blanked
    if bad.any():
        node = int(np.argmax(bad))
        where = ", ".join(f"{v:g}" for v in mesh.vertices[node])
        what = f"node {node} (from 0) is at ({where})"
        raise FileError(path, f"{what}; expected finite coordinates of at most {LARGEST:g}")
    return mesh


def grid_format(path: str | os.PathLike[str]) -> str:
    """The format in which `read_mesh` reads a file, one of `GRID_FORMATS`; "PLOT3D" for what is nothing else.

    Raises
    ------
    FileError
        For a file that cannot be read, and binary Tecplot and misnamed VTK files, which are not read.
    """
    with reading(path), open(path, "rb") as stream:
        head = stream.read(_HEAD_BYTES)
    suffix = Path(path).suffix.lower()
    first = head.lstrip()[:64].upper()
    if suffix == ".stl" or (first.startswith(b"SOLID") and b"facet" in head):
        return "STL"
    if suffix == ".obj":
        return "OBJ"
    if suffix == ".ply" or first.startswith((b"PLY\n", b"PLY\r")):
        return "PLY"
    if suffix == ".tri":
        return "Cart3D"
    if suffix in VTK_SUFFIXES:
        return "VTK"
    if head.startswith(b"\x89HDF\r\n\x1a\n") or suffix == ".nc":
        return "NetCDF"
    if head.startswith(b"#!TDV"):
        raise FileError(path, "is a binary Tecplot file; expected Tecplot ASCII (write data file as ASCII)")
    if first.startswith((b"# VTK", b"<VTKFILE", b"<?XML")):
        raise FileError(path, f"looks like a VTK file; expected its name to end in one of {VTK_SUFFIXES}")
    if first.startswith((b"TITLE", b"VARIABLES", b"ZONE", b"#")):
        return "Tecplot"
    return "PLOT3D"


def _read_netcdf(path: str | os.PathLike[str], volumes: Volumes) -> Mesh:
    mesh = read_nodes_netcdf(path)[0]
    found, which = np.unique(mesh.volume, return_inverse=True)
    names = np.array(rename_volumes([str(n) for n in found], volumes), dtype=np.str_)
    return replace(mesh, volume=names[which])


_READERS: dict[str, Callable[[str | os.PathLike[str], Volumes], Mesh]] = {
    "STL": lambda path, volumes: read_stl(path, volumes=volumes),
    "OBJ": lambda path, volumes: read_obj(path, volumes=volumes),
    "PLY": lambda path, volumes: read_ply(path, volumes=volumes),
    "Cart3D": lambda path, volumes: read_cart3d(path, volumes=volumes),
    "VTK": lambda path, volumes: read_vtk(path, volumes=volumes),
    "NetCDF": _read_netcdf,
    "Tecplot": lambda path, volumes: read_tecplot(path, volumes=volumes)[0],
}
GRID_FORMATS = ("PLOT3D", *_READERS)


def write_mesh(path: str | os.PathLike[str], mesh: Mesh, *, length_unit: str = "") -> None:
    """Write a mesh in the format of the extension.

    PLOT3D (.grid, .x, .xyz, .g ..., meshes with blocks only), Tecplot ASCII (.dat, .tec), STL, OBJ, PLY,
    Cart3D (.tri, text), VTK (.vtp, .vtm, .vtu, legacy .vtk), NetCDF (.nc). Volumes survive in Tecplot, OBJ, VTK and
    NetCDF, as numbers in Cart3D. Triangles of blocks that were turned round survive in all but PLOT3D, Tecplot and
    .vtm, which hold blocks only.

    Parameters
    ----------
    path : the file
    mesh : the mesh
    length_unit : unit of the coordinates, written where the format has a place for it (not in PLOT3D, STL, Cart3D)

    Raises
    ------
    ValueError
        For an unknown extension, or a mesh that the format cannot hold.
    FileError
        Where the file cannot be written; then nothing is.

    Examples
    --------
    >>> import tempfile
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], "plate")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     wm.write_mesh(f"{folder}/plate.vtp", plate, length_unit="mm")
    ...     again = wm.read_mesh(f"{folder}/plate.vtp")
    >>> again  # this format keeps the volumes and the unit
    Mesh(nodes=4, triangles=2, volumes=plate, unit=mm)
    """
    check_kinds("write_mesh", path=(path, PATH), mesh=(mesh, Mesh))
    suffix, units = Path(path).suffix.lower(), {LENGTH: length_unit}
    if suffix in PLOT3D_SUFFIXES:
        write_plot3d(path, mesh)
    elif suffix in TECPLOT_SUFFIXES:
        write_tecplot(path, mesh, units=units)
    elif suffix == ".stl":
        write_stl(path, mesh)
    elif suffix == ".obj":
        write_obj(path, mesh, length_unit=length_unit)
    elif suffix == ".tri":
        write_cart3d(path, mesh)
    elif suffix == ".ply":
        write_ply(path, mesh, length_unit=length_unit)
    elif suffix in VTK_WRITTEN:
        write_nodes_vtk(path, mesh, units=units)
    elif suffix == ".nc":
        write_nodes_netcdf(path, mesh, units=units)
    else:
        raise UsageError(f"path: {path} must end in one of {GRID_SUFFIXES}")
