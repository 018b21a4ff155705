"""Write meshes and values per node as VTK files for ParaView.

VTK's writers do not report a full disk reliably (some end the process), so files are made in memory
and written by Python.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.io.added import atomic_folder
from windmark.io.atomic import atomic_path
from windmark.io.fields import LENGTH, checked_fields, label, single_is_exact, written_by
from windmark.scene import Block, Mesh

RESERVED = ("iblank", "volume", "vtkghosttype")
SUFFIXES = (".vtp", ".vtm", ".vtk", ".vtu")
_HIDDEN_POINT = 2  # vtkDataSetAttributes::HIDDENPOINT, the bit of vtkGhostType that hides a node
_COMPRESSION = 1  # zlib level: higher ones take twice the time for a tenth of the size


def write_nodes_vtk(
    path: str | os.PathLike[str],
    mesh: Mesh,
    fields: Mapping[str, ArrayLike] | None = None,
    *,
    units: Mapping[str, str] | None = None,
) -> None:
    """Write a mesh and values per node for ParaView: binary, compressed, NaN where there is no value.

    Parameters
    ----------
    path : ``.vtp`` or ``.vtk`` (legacy; one surface with all nodes in the mesh's order), ``.vtu`` (the same as an
        unstructured grid, without blocks) or ``.vtm`` (one piece per block, each a structured grid, or per volume for
        a mesh without blocks; the pieces are in a folder of the file's name)
    mesh : the mesh
    fields : name -> (V,) values
    units : name -> unit, written into the arrays' names, and "length" -> that of the coordinates, written as
        field data ``length_unit``

    Raises
    ------
    ValueError
        For wrong fields or another extension.
    FileError
        Where a file cannot be written; then nothing is.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise UsageError(f"path: {path} must end in one of {SUFFIXES}")
    length_unit = (units or {}).get(LENGTH, "")
    arrays = {label(n, units): a for n, a in checked_fields(mesh, fields or {}, units, RESERVED).items()}
    if suffix == ".vtm":
        _write_multi_block(Path(path), mesh, arrays, length_unit)
        return
    surface = _poly_data(mesh, arrays, length_unit)
    data = _legacy(surface) if suffix == ".vtk" else _xml(_unstructured(surface) if suffix == ".vtu" else surface)
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def _write_multi_block(path: Path, mesh: Mesh, arrays: dict[str, NDArray[Any]], length_unit: str) -> None:
    pieces: list[tuple[str, str, bytes]] = []
    for k, block in enumerate(mesh.blocks):
        pieces.append((block.name, f"{k:03d}.vts", _xml(_structured_grid(mesh, block, arrays, length_unit))))
    for k, volume in enumerate(() if mesh.blocks else np.unique(mesh.volume)):
        keep = mesh.volume == volume
        used, corners = np.unique(mesh.triangles[keep], return_inverse=True)
        part = Mesh.make(mesh.vertices[used], corners.reshape(-1, 3).astype(np.int32), str(volume))
        piece = _poly_data(part, {n: a[used] for n, a in arrays.items()}, length_unit)
        pieces.append((str(volume), f"{k:03d}.vtp", _xml(piece)))
    index = "".join(
        f'    <DataSet index="{k}" name="{_escaped(name)}" file="{_escaped(path.stem)}/{file}"/>\n'
        for k, (name, file, _) in enumerate(pieces)
    )
    with atomic_path(path) as temporary:
        temporary.write_text(
            '<?xml version="1.0"?>\n<VTKFile type="vtkMultiBlockDataSet" version="1.0">\n'
            f"  <vtkMultiBlockDataSet>\n{index}  </vtkMultiBlockDataSet>\n</VTKFile>\n",
            encoding="utf-8",
        )
        with atomic_folder(path.with_suffix("")) as folder:
            for _, file, data in pieces:
                (folder / file).write_bytes(data)


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace('"', "&quot;")


def _xml(data: Any) -> bytes:
    """A VTK XML file in memory."""
    from vtkmodules import vtkIOXML

    kind = data.GetClassName().removeprefix("vtk")  # PolyData, StructuredGrid, UnstructuredGrid
    writer = getattr(vtkIOXML, f"vtkXML{kind}Writer")()
    writer.SetInputData(data)
    writer.WriteToOutputStringOn()
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    writer.SetHeaderTypeToUInt64()
    writer.SetCompressorTypeToZLib()
    writer.SetCompressionLevel(_COMPRESSION)
    writer.Write()
    text: str | bytes = writer.GetOutputString()
    return text if isinstance(text, bytes) else text.encode()


def _legacy(surface: Any) -> bytes:
    """A legacy VTK file (binary) in memory."""
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter

    writer = vtkPolyDataWriter()
    writer.SetInputData(surface)
    writer.SetFileTypeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    text: str | bytes = writer.GetOutputStdString()  # text only where every byte is
    return text if isinstance(text, bytes) else text.encode()


def _unstructured(surface: Any) -> Any:
    """The same triangles as an unstructured grid, without the blocks' shapes, which would mean nothing there."""
    from vtkmodules.vtkCommonDataModel import VTK_TRIANGLE, vtkUnstructuredGrid

    data = vtkUnstructuredGrid()
    data.SetPoints(surface.GetPoints())
    data.SetCells(VTK_TRIANGLE, surface.GetPolys())
    data.GetPointData().ShallowCopy(surface.GetPointData())
    data.GetCellData().ShallowCopy(surface.GetCellData())
    data.GetFieldData().ShallowCopy(surface.GetFieldData())
    for name in ("block_shapes", "block_names"):
        data.GetFieldData().RemoveArray(name)
    return data


def _array(name: str, values: NDArray[Any]) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk

    out = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
    out.SetName(name)
    return out


def _strings(name: str, values: list[str]) -> Any:
    from vtkmodules.vtkCommonCore import vtkStringArray

    out = vtkStringArray()
    out.SetName(name)
    for value in values:
        out.InsertNextValue(value)
    return out


def _points(vertices: NDArray[np.float64]) -> Any:
    from vtkmodules.vtkCommonCore import vtkPoints

    xyz = vertices.astype(np.float32) if single_is_exact(vertices) else vertices
    out = vtkPoints()
    out.SetData(_array("Points", xyz))
    return out


def _add_common(data: Any, arrays: dict[str, NDArray[Any]], used: NDArray[np.bool_] | None, length_unit: str) -> None:
    for name, values in arrays.items():
        data.GetPointData().AddArray(_array(name, values))
    if used is not None:
        data.GetPointData().AddArray(_array("iblank", used.astype(np.uint8)))
    data.GetFieldData().AddArray(_strings("written_by", [written_by()]))
    if length_unit:
        data.GetFieldData().AddArray(_strings("length_unit", [length_unit]))


def _poly_data(mesh: Mesh, arrays: dict[str, NDArray[Any]], length_unit: str) -> Any:
    """All nodes and triangles; the volumes' names and the blocks as field data, from which `read_vtk` restores them."""
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    data = vtkPolyData()
    data.SetPoints(_points(mesh.vertices))
    cells = vtkCellArray()
    offsets = np.arange(0, 3 * len(mesh.triangles) + 1, 3, dtype=np.int64)
    cells.SetData(
        numpy_to_vtkIdTypeArray(offsets, deep=True),
        numpy_to_vtkIdTypeArray(mesh.triangles.astype(np.int64).ravel(), deep=True),
    )
    data.SetPolys(cells)
    _add_common(data, arrays, None if mesh.blanked is None else ~mesh.blanked, length_unit)
    names, of_triangle = np.unique(mesh.volume, return_inverse=True)
    data.GetCellData().AddArray(_array("volume", of_triangle.astype(np.int32)))
    data.GetFieldData().AddArray(_strings("volume_names", [str(n) for n in names]))
    if mesh.blocks:
        shapes = np.array([b.shape_ijk for b in mesh.blocks], dtype=np.int32)
        data.GetFieldData().AddArray(_array("block_shapes", shapes))
        data.GetFieldData().AddArray(_strings("block_names", [b.name for b in mesh.blocks]))
    return data


def _structured_grid(mesh: Mesh, block: Block, arrays: dict[str, NDArray[Any]], length_unit: str) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkStructuredGrid

    nodes = slice(block.first, block.first + block.size)
    data = vtkStructuredGrid()
    data.SetDimensions(*block.shape_ijk)
    data.SetPoints(_points(mesh.vertices[nodes]))
    used = None if mesh.blanked is None else ~mesh.blanked[nodes]
    _add_common(data, {n: a[nodes] for n, a in arrays.items()}, used, length_unit)
    if used is not None:
        data.GetPointData().AddArray(_array("vtkGhostType", np.where(used, 0, _HIDDEN_POINT).astype(np.uint8)))
    volume = np.unique(mesh.volume[(mesh.triangles[:, 0] >= nodes.start) & (mesh.triangles[:, 0] < nodes.stop)])
    if len(volume) == 1:
        data.GetFieldData().AddArray(_strings("volume_names", [str(volume[0])]))
    return data
