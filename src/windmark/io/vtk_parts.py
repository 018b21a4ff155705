"""What VTK finds in a file, as plain arrays; called through `apart`, for damaged files end the process within VTK."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.io.apart import Content
from windmark.io.errors import FileError
from windmark.io.mesh_content import mesh_content
from windmark.io.structured import structured_mesh
from windmark.io.vtk_values import point_values
from windmark.scene import Block, Mesh

READERS = {
    ".vtp": ("vtkIOXML", "vtkXMLPolyDataReader"),
    ".vtu": ("vtkIOXML", "vtkXMLUnstructuredGridReader"),
    ".vts": ("vtkIOXML", "vtkXMLStructuredGridReader"),
    ".vtm": ("vtkIOXML", "vtkXMLMultiBlockDataReader"),
    ".vtk": ("vtkIOLegacy", "vtkGenericDataObjectReader"),
}
_COUNT = re.compile(
    rb'NumberOf[A-Z][a-z]+="[ \t]*(\d+)"|^[ \t]*(?:POINTS|POLYGONS|CELLS|CELL_TYPES|LINES|VERTICES)[ \t]+(\d+)',
    re.MULTILINE,
)
_DIGITS, _MOST_PER_BYTE, _FEW = 18, 100, 2**20
"""Points and cells that a byte of the file may stand for: packed, a regular grid has ten of them in each."""


@dataclass(frozen=True)
class _Part:
    """One data set of a file; ``shape`` is None if it is not structured."""

    name: str
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    volume: NDArray[np.str_]
    shape: tuple[int, int, int] | None = None
    blanked: NDArray[np.bool_] | None = None


def vtk_content(path: str, *, values: bool) -> Content:
    """The surface of a file, see `mesh_content`; with ``values`` those at its nodes.

    Returns
    -------
    The mesh; ``columns``: names of the arrays ``column0`` ... (V,); ``left_out``

    Raises
    ------
    FileError
        For a file that VTK cannot read, whose numbers do not fit together, or that has no faces.
    """
    try:
        return _content(path, values)
    except FileError:
        raise
    except UnicodeDecodeError as error:
        raise FileError(path, f"the name {error.object[:40]!r} is not UTF-8; expected UTF-8 text") from error
    except (IndexError, AttributeError, ValueError, TypeError, OverflowError) as error:
        raise FileError(path, f"its arrays do not fit together ({error})") from error


def _content(path: str, values: bool) -> Content:
    _check_counts(path)
    with _messages() as said:
        module, name = READERS[Path(path).suffix.lower()]
        reader = getattr(__import__(f"vtkmodules.{module}", fromlist=[name]), name)()
        reader.SetFileName(os.fspath(path))
        reader.Update()
        data = reader.GetOutputDataObject(0)
        leaves = [] if data is None else list(_leaves(data))
        for leaf in leaves:
            check_cells(path, leaf)
        parts = [] if data is None else _checked_parts(path, data)
    if said:
        raise FileError(path, f"VTK cannot read it: {said[0]}")
    if not any(len(part.triangles) or part.shape for part in parts):
        raise FileError(path, f"has {sum(len(p.vertices) for p in parts)} points but no faces; expected a surface")
    unit = next((unit for leaf in leaves for unit in _field_strings(leaf, "length_unit")), "")
    mesh = replace(_joined(parts), length_unit=unit)
    content = mesh_content(path, mesh)
    if not values:
        return content
    columns, left_out = point_values(leaves)
    if any(len(column) != len(mesh.vertices) for column in columns.values()):
        raise FileError(path, f"its arrays do not have one value for each of {len(mesh.vertices)} nodes")
    content |= {f"column{k}": column for k, column in enumerate(columns.values())}
    content["columns"], content["left_out"] = list(columns), left_out
    return content


def _check_counts(path: str) -> None:
    """Refuse counts that the file has no bytes for: VTK asks for their memory first."""
    raw = Path(path).read_bytes()
    for match in _COUNT.finditer(raw):
        count = next(group for group in match.groups() if group)
        if len(count) > _DIGITS or int(count) > _MOST_PER_BYTE * len(raw) + _FEW:
            said = match[0].decode("ascii", "replace").strip()[:60]
            raise FileError(path, f"damaged: {said!r} cannot come from {len(raw)} bytes")


def check_cells(path: str, leaf: Any) -> None:
    """Refuse cells that name points or corners which are none: VTK's filters read whatever lies there."""
    if leaf.IsA("vtkPolyData"):
        cells = [leaf.GetVerts(), leaf.GetLines(), leaf.GetPolys(), leaf.GetStrips()]
    elif leaf.IsA("vtkUnstructuredGrid"):
        cells = [leaf.GetCells()]
    else:
        cells = []
    for array in cells:
        offsets, corners = _numpy(array.GetOffsetsArray()), _numpy(array.GetConnectivityArray())
        if len(offsets) and (offsets[0] or offsets[-1] != len(corners) or (np.diff(offsets) < 0).any()):
            what = f"its cells end at {offsets[-1]} of {len(corners)} corners; expected offsets that grow to the last"
            raise FileError(path, what, "offsets")
        points = leaf.GetNumberOfPoints()
        if len(corners) and (corners.min() < 0 or corners.max() >= points):
            what = f"a cell names the points {corners.min()} to {corners.max()}; expected 0 to {points - 1}"
            raise FileError(path, what, "connectivity")


def _leaves(data: Any) -> Iterator[Any]:
    """The data sets with points, in the order of `_parts`."""
    if data.IsA("vtkMultiBlockDataSet"):
        for k in range(data.GetNumberOfBlocks()):
            if data.GetBlock(k) is not None:
                yield from _leaves(data.GetBlock(k))
    else:
        yield data


def _checked_parts(path: str | os.PathLike[str], data: Any) -> list[_Part]:
    """The surfaces, whose triangles name nodes that are there."""
    parts = list(_parts(path, data, "model"))
    for part in parts:
        if len(part.triangles) and (part.triangles.min() < 0 or part.triangles.max() >= len(part.vertices)):
            raise FileError(
                path, f"a cell names a node that is none; expected 0 to {len(part.vertices) - 1}", part.name
            )
    return parts


@contextmanager
def _messages() -> Iterator[list[str]]:
    """Catch VTK's error messages, which go to the screen otherwise and stop nothing."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    before, verbosity = vtkOutputWindow.GetInstance(), vtkLogger.GetCurrentVerbosityCutoff()
    window = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    said: list[str] = []
    try:
        yield said
    finally:
        vtkOutputWindow.SetInstance(before)
        vtkLogger.SetStderrVerbosity(vtkLogger.ConvertToVerbosity(verbosity))
        lines = [line.strip() for line in _output(window).splitlines() if line.strip()]
        # "ERROR: In file.cxx, line n", then "vtkClass (0x...): what happened".
        said += [b.split("): ", 1)[-1] for a, b in pairwise([*lines, ""]) if a.upper().startswith("ERROR") and b]


def _output(window: Any) -> str:
    """VTK's messages repeat what stands in the file, which need not be UTF-8."""
    try:
        text = window.GetOutput()
    except UnicodeDecodeError as error:
        text = error.object
    return text.decode("utf-8", "backslashreplace") if isinstance(text, bytes) else str(text)


def _parts(path: str | os.PathLike[str], data: Any, name: str) -> Iterator[_Part]:
    """The surfaces of a data object."""
    if data.IsA("vtkMultiBlockDataSet"):
        for k in range(data.GetNumberOfBlocks()):
            info = data.GetMetaData(k) if data.HasMetaData(k) else None
            inner = info.Get(data.NAME()) if info is not None and info.Has(data.NAME()) else f"block{k + 1:02d}"
            if data.GetBlock(k) is not None:
                yield from _parts(path, data.GetBlock(k), inner)
    elif data.IsA("vtkStructuredGrid"):
        yield from _structured(path, data, name)
    elif data.IsA("vtkPolyData"):
        yield from _poly_data(data, name)
    elif data.IsA("vtkUnstructuredGrid"):
        yield _surface(data, name)
    else:
        raise FileError(path, f"holds a {data.GetClassName()}; expected a surface")


def _numpy(array: Any) -> NDArray[Any]:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    out: NDArray[Any] = vtk_to_numpy(array)
    return out


def _vertices(data: Any) -> NDArray[np.float64]:
    if data.GetPoints() is None:
        return np.zeros((0, 3))
    return _numpy(data.GetPoints().GetData()).astype(np.float64)


def _blanked(data: Any) -> NDArray[np.bool_] | None:
    array = data.GetPointData().GetArray("iblank")
    return None if array is None else _numpy(array) == 0


def _field_strings(data: Any, name: str) -> list[str]:
    """The texts of a field array; numbers are none. `UnicodeDecodeError` where VTK has only bytes."""
    array = data.GetFieldData().GetAbstractArray(name)
    if array is None or not array.IsA("vtkStringArray"):
        return []
    values = [array.GetValue(k) for k in range(array.GetNumberOfValues())]
    return [value.decode("utf-8") if isinstance(value, bytes) else value for value in values]


def _structured(path: str | os.PathLike[str], data: Any, name: str) -> Iterator[_Part]:
    shape: list[int] = [0, 0, 0]
    data.GetDimensions(shape)
    if min(shape) > 1:
        raise FileError(path, f"a structured grid of {tuple(shape)} nodes is a volume; expected a surface", name)
    volume = np.array((_field_strings(data, "volume_names") or [name])[:1], dtype=np.str_)
    none = np.zeros((0, 3), dtype=np.int64)
    yield _Part(name, _vertices(data), none, volume, (shape[0], shape[1], shape[2]), _blanked(data))


def _poly_data(data: Any, name: str) -> Iterator[_Part]:
    """A surface; one that `write_nodes_vtk` has written comes back in its blocks."""
    vertices, blanked = _vertices(data), _blanked(data)
    triangles, cells = _triangles(data)
    volume = _volumes(data, data.GetCellData(), cells, name)
    shapes, blocks = data.GetFieldData().GetArray("block_shapes"), _field_strings(data, "block_names")
    if shapes is None:
        yield _Part(name, vertices, triangles, volume, None, blanked)
        return
    first = 0
    for (i, j, k), block in zip(_numpy(shapes).tolist(), blocks, strict=True):
        end = first + i * j * k
        own = (triangles[:, 0] >= first) & (triangles[:, 0] < end)
        used = None if blanked is None else blanked[first:end]
        yield _Part(block, vertices[first:end], triangles[own] - first, volume[own], (i, j, k), used)
        first = end


def _triangles(data: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(T, 3) triangles of a vtkPolyData and (T,) the cell each comes from."""
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter

    cells = _with_ids(data.GetCellData(), data.GetNumberOfCells(), "windmark_cell")
    split = vtkTriangleFilter()
    split.SetInputData(data)
    split.PassVertsOff()
    split.PassLinesOff()
    split.Update()
    out = split.GetOutput()
    cells.RemoveArray("windmark_cell")
    if not out.GetNumberOfCells():
        return np.zeros((0, 3), dtype=np.int64), np.zeros(0, dtype=np.int64)
    connectivity = _numpy(out.GetPolys().GetConnectivityArray()).reshape(-1, 3).astype(np.int64)
    return connectivity, _numpy(out.GetCellData().GetArray("windmark_cell")).astype(np.int64)


def _with_ids(attributes: Any, count: int, name: str) -> Any:
    """Number the cells or points, to find them again behind a filter."""
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray

    ids = numpy_to_vtkIdTypeArray(np.arange(count, dtype=np.int64), deep=True)
    ids.SetName(name)
    attributes.AddArray(ids)
    return attributes


def _volumes(data: Any, cells: Any, of_triangle: NDArray[np.int64], name: str) -> NDArray[np.str_]:
    """The volume of each triangle, as `write_nodes_vtk` has written it, else ``name`` for all."""
    ids, names = cells.GetArray("volume"), _field_strings(data, "volume_names")
    if ids is None or not names:
        return np.full(len(of_triangle), name)
    return np.array(names)[_numpy(ids)[of_triangle]]


def _surface(data: Any, name: str) -> _Part:
    """The outside of solid cells, and flat cells as they are, on the nodes of the file."""
    from vtkmodules.vtkFiltersGeometry import vtkGeometryFilter

    _with_ids(data.GetPointData(), data.GetNumberOfPoints(), "windmark_point")
    outside = vtkGeometryFilter()
    outside.SetInputData(data)
    outside.MergingOff()
    outside.Update()
    surface = outside.GetOutput()
    if not surface.GetNumberOfCells():
        return _Part(name, _vertices(data), np.zeros((0, 3), dtype=np.int64), np.zeros(0, dtype=np.str_))
    triangles, cells = _triangles(surface)
    node = _numpy(surface.GetPointData().GetArray("windmark_point"))
    data.GetPointData().RemoveArray("windmark_point")
    volume = _volumes(data, surface.GetCellData(), cells, name)
    return _Part(name, _vertices(data), node[triangles].astype(np.int64), volume, None, _blanked(data))


def _joined(parts: list[_Part]) -> Mesh:
    """All parts as one mesh, with blocks if all are structured."""
    starts = np.cumsum([0, *(len(p.vertices) for p in parts)]).tolist()
    vertices = np.concatenate([p.vertices for p in parts])
    blanked = None
    if any(p.blanked is not None for p in parts):
        blanked = np.concatenate([np.zeros(len(p.vertices), bool) if p.blanked is None else p.blanked for p in parts])
    full = [_with_triangles(part) for part in parts]
    triangles = np.concatenate([p.triangles + s for p, s in zip(full, starts, strict=False)]).astype(np.int32)
    volume = np.concatenate([p.volume for p in full])
    blocks = tuple(Block(p.name, p.shape, s) for p, s in zip(full, starts, strict=False) if p.shape)
    return Mesh(vertices, triangles, volume, blocks if len(blocks) == len(parts) else (), blanked)


def _with_triangles(part: _Part) -> _Part:
    """Triangulate a structured part that the file has not as triangles."""
    if not part.shape or len(part.triangles) == len(part.volume):
        return part
    mesh = structured_mesh(
        part.vertices, (Block(part.name, part.shape, 0),), part.blanked, volumes=part.volume.tolist()
    )
    return _Part(part.name, part.vertices, mesh.triangles.astype(np.int64), mesh.volume, part.shape, part.blanked)
