"""Results per node as NetCDF-4: the mesh, the fields with their units, and how they were made."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.io.apart import Content, read_apart
from windmark.io.bounded import check_unpacked
from windmark.io.errors import FileError
from windmark.io.fields import LENGTH, checked_fields, written_by
from windmark.io.mesh_content import check_names, content_mesh, mesh_content
from windmark.io.netcdf_write import Variable, write_variables
from windmark.io.recordings.hdf import check_stored
from windmark.scene import Block, Mesh

RESERVED = ("vertices", "triangles", "triangle_volume", "volume", "blanked", "block", "block_shape", "block_first",
            "node", "triangle", "component", "corner", "ijk")  # fmt: skip
_CONVENTIONS = (
    "vertices(node, component) are in length_unit; triangles(triangle, corner) index them from 0, counter-clockwise "
    "seen from outside; triangle_volume(triangle) indexes volume; a block is the block_shape nodes from block_first "
    "on, i fastest; every other variable has one value per node, in the unit of its attribute units, "
    "NaN where the node has none"
)


def write_nodes_netcdf(
    path: str | os.PathLike[str],
    mesh: Mesh,
    fields: Mapping[str, ArrayLike] | None = None,
    *,
    units: Mapping[str, str] | None = None,
    history: Mapping[str, Any] | None = None,
) -> None:
    """Write mesh and values per node as a NetCDF-4 file (compressed; opens with ``xarray.open_dataset``).

    Parameters
    ----------
    path : the file, usually ``.nc``
    mesh : the mesh, kept whole: nodes, triangles, volumes, blocks, blanked nodes
    fields : name -> (V,) values, NaN where there is none
    units : name -> unit, written as the attribute ``units`` of the variable, and "length" -> that of the coordinates
    history : how the values were made (options, inputs, dates); written as JSON in the attribute ``history``

    Raises
    ------
    ValueError
        For wrong fields, names with a slash, or a history that JSON cannot hold.
    FileError
        Where the file cannot be written; then nothing is.
    """
    arrays = checked_fields(mesh, fields or {}, units, RESERVED)
    slashed = [name for name in arrays if "/" in name]
    if slashed:
        raise UsageError(f"fields: the names {slashed} hold a slash, which NetCDF keeps for groups")
    length_unit = (units or {}).get(LENGTH, "")
    variables = _mesh_variables(mesh, length_unit)
    for name, values in arrays.items():
        variables[name] = (("node",), values, {"units": (units or {}).get(name, "")})
    attributes = {
        "title": "values at the nodes of a surface grid",
        "source": written_by(),
        "conventions": _CONVENTIONS,
        "length_unit": length_unit,
        "history": _json(history),
    }
    write_variables(path, variables, attributes)


def _json(history: Mapping[str, Any] | None) -> str:
    try:
        return json.dumps(dict(history or {}), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ValueError(f"history: {error}; expected what JSON can hold") from error


def _mesh_variables(mesh: Mesh, length_unit: str) -> dict[str, Variable]:
    names, of_triangle = np.unique(mesh.volume, return_inverse=True)
    out: dict[str, Variable] = {
        "vertices": (("node", "component"), mesh.vertices, {"units": length_unit}),
        "triangles": (("triangle", "corner"), mesh.triangles, {}),
        "triangle_volume": (("triangle",), of_triangle.astype(np.int32), {}),
        "volume": (("volume",), names.astype(object), {}),
    }
    if mesh.blanked is not None:
        out["blanked"] = (("node",), mesh.blanked.astype(np.int8), {})
    if mesh.blocks:
        out["block"] = (("block",), np.array([b.name for b in mesh.blocks], dtype=object), {})
        out["block_shape"] = (("block", "ijk"), np.array([b.shape_ijk for b in mesh.blocks], dtype=np.int32), {})
        out["block_first"] = (("block",), np.array([b.first for b in mesh.blocks], dtype=np.int64), {})
    return out


def read_nodes_netcdf(
    path: str | os.PathLike[str],
) -> tuple[Mesh, dict[str, NDArray[np.floating]], dict[str, str], dict[str, Any]]:
    """Read what `write_nodes_netcdf` has written.

    Returns
    -------
    mesh, fields (name -> (V,) values), units (name -> unit, where one was given, and "length"), history

    Raises
    ------
    FileError
        For a file that is no such file.
    """
    content = read_apart("windmark.io.netcdf:netcdf_content", path)
    fields = {name: content[f"field{k}"] for k, name in enumerate(content["fields"])}
    mesh, units, history = content_mesh(content), content["units"], content["history"]
    return mesh, fields, {name: unit for name, unit in units.items() if unit}, history


def netcdf_content(path: str) -> Content:
    """What stands in the file, as `read_apart` takes it: HDF5 follows damaged chains for ever, or ends the process."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            _check_sizes(path, file)
            mesh = _read_mesh(path, file)
            fields = {
                name: file[name][()]
                for name, variable in file.items()
                if name not in RESERVED and variable.shape == (len(mesh.vertices),)
            }
            units = {name: _text(file[name].attrs.get("units", "")) for name in fields}
            units[LENGTH] = mesh.length_unit
            history = json.loads(_text(file.attrs["history"]))
    except (FileError, MemoryError):
        raise
    except Exception as error:  # HDF5 and its layers report damage in many ways
        said = " ".join(str(error).split())[:300]
        raise FileError(path, f"expected a NetCDF file of node values by windmark ({said})") from error
    content = mesh_content(path, mesh) | {f"field{k}": values for k, values in enumerate(fields.values())}
    return {**content, "fields": list(fields), "units": units, "history": history}


def _check_sizes(path: str, file: Any) -> None:
    import h5py

    for name, variable in file.items():
        is_dimension = _text(variable.attrs.get("NAME", "")).startswith("This is a netCDF dimension but not a")
        if isinstance(variable, h5py.Dataset) and variable.shape is not None and not is_dimension:
            check_stored(path, variable, name)
            size = variable.dtype.itemsize * math.prod(variable.shape)
            check_unpacked(path, size, variable.id.get_storage_size(), name)


def _read_mesh(path: str, file: Any) -> Mesh:
    names = [_text(name) for name in file["volume"][()]]
    check_names(path, names, "volume")
    volume = np.array(names, dtype=np.str_)[file["triangle_volume"][()]]
    blanked = file["blanked"][()] != 0 if "blanked" in file else None
    blocks: tuple[Block, ...] = ()
    if "block_shape" in file:
        columns = (file[name][()].tolist() for name in ("block", "block_shape", "block_first"))
        blocks = tuple(Block(_text(name), (i, j, k), first) for name, (i, j, k), first in zip(*columns, strict=True))
    unit = _text(file.attrs["length_unit"])
    return Mesh(file["vertices"][()], file["triangles"][()], volume, blocks, blanked, unit)


def _text(value: str | bytes) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)
