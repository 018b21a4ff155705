"""Tecplot ASCII files: one zone per structured block, or finite-element triangles.

Tecplot's text has no NaN. Missing values are written as a fill value that the file names itself
(``DATASETAUXDATA NanValue``), and a last variable ``valid`` is 0 at nodes where any value is missing,
ready for value blanking. `tecplot_read.read_tecplot` turns the fill value back into NaN.

Source: Tecplot 360 Data Format Guide, chapter 4 (ASCII Data).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.io.atomic import atomic_path
from windmark.io.fields import LENGTH, axis_labels, checked_fields, label, single_is_exact, written_by
from windmark.io.numbers_text import format_rows
from windmark.scene import Mesh

RESERVED = ("x", "y", "z", "iblank", "valid")


def write_tecplot(
    path: str | os.PathLike[str],
    mesh: Mesh,
    fields: Mapping[str, ArrayLike] | None = None,
    *,
    units: Mapping[str, str] | None = None,
    title: str = "windmark",
    fill: float = -9999.0,
) -> None:
    """Write a mesh and values per node as a Tecplot ASCII file.

    A mesh with blocks becomes one ordered zone per block, under the block's name and in its own I, J, K;
    any other one zone of triangles per volume, which share their nodes. Variables are x, y, z, then
    ``iblank`` if the mesh has blanked nodes (0: not used), the fields, and ``valid`` if any value is missing.
    Numbers have nine digits: float32 survives exactly; double coordinates get 17.

    Parameters
    ----------
    path : the file, usually ``.dat`` or ``.tec``
    mesh : the mesh
    fields : name -> (V,) values, NaN where there is none
    units : name -> unit, and "length" -> that of the coordinates, written into the variables' names
    title : the data set's title
    fill : written instead of NaN

    Raises
    ------
    ValueError
        For wrong fields, or a ``fill`` that a value has already.
    FileError
        Where the file cannot be written; then nothing is.
    """
    arrays = checked_fields(mesh, fields or {}, units, RESERVED)
    if not np.isfinite(fill):
        raise UsageError(f"fill: must be a finite number, for Tecplot's text knows no other, got {fill}")
    names = axis_labels(units)
    xyz = mesh.vertices
    columns: list[NDArray[Any]] = [_filled("coordinate", xyz[:, k], fill) for k in range(3)]
    formats = ["%.9g" if single_is_exact(xyz) else "%.17g"] * 3
    if mesh.blanked is not None:
        names, columns, formats = [*names, "iblank"], [*columns, (~mesh.blanked).astype(int)], [*formats, "%d"]
    for name, values in arrays.items():
        names, columns, formats = (
            [*names, label(name, units)],
            [*columns, _filled(name, values, fill)],
            [*formats, "%.9g"],
        )
    valid = np.all([np.isfinite(a) for a in arrays.values()], axis=0) if arrays else np.ones(len(xyz), dtype=bool)
    if not valid.all():
        names, columns, formats = [*names, "valid"], [*columns, valid.astype(int)], [*formats, "%d"]
    with atomic_path(path) as temporary, open(temporary, "wb") as stream:
        stream.write(_head(title, names, fill, (units or {}).get(LENGTH, "")))
        if mesh.blocks:
            _write_blocks(stream, mesh, columns, formats)
        else:
            _write_triangles(stream, mesh, columns, formats)


def _filled(name: str, values: NDArray[Any], fill: float) -> NDArray[Any]:
    """Values with ``fill`` where they are not finite."""
    missing = ~np.isfinite(values)
    if not missing.any():
        return values
    if equals_fill(values, fill).any():
        raise UsageError(f"fill: {fill} is a value of {name!r}; choose a number that no value has")
    return np.where(missing, values.dtype.type(fill), values)


def equals_fill(values: NDArray[Any], fill: float) -> NDArray[np.bool_]:
    """Where values are the fill value, to the nine digits in which they are written."""
    with np.errstate(over="ignore"):
        return values.astype(np.float32) == np.float32(fill)


def _quoted(text: str) -> str:
    """A string as Tecplot reads it back: on one line, without its own quotes."""
    return '"' + " ".join(text.replace('"', "'").split()) + '"'


def _head(title: str, names: list[str], fill: float, length_unit: str) -> bytes:
    lines = [
        f"TITLE = {_quoted(title)}",
        f"VARIABLES = {' '.join(map(_quoted, names))}",
        f'DATASETAUXDATA NanValue = "{fill:.9g}"',
        f"DATASETAUXDATA Program = {_quoted(written_by())}",
    ]
    if length_unit:
        lines.append(f"DATASETAUXDATA LengthUnit = {_quoted(length_unit)}")
    return ("\n".join(lines) + "\n").encode()


def _write_blocks(stream: BinaryIO, mesh: Mesh, columns: list[NDArray[Any]], formats: list[str]) -> None:
    block_of = np.searchsorted([b.first for b in mesh.blocks], mesh.triangles[:, 0], side="right") - 1
    for k, block in enumerate(mesh.blocks):
        i, j, n = block.shape_ijk
        zone = f"ZONE T = {_quoted(block.name)}, I = {i}, J = {j}, K = {n}, ZONETYPE = ORDERED, DATAPACKING = POINT\n"
        stream.write(zone.encode())
        volume = np.unique(mesh.volume[block_of == k])
        if len(volume) == 1 and volume[0] != block.name:
            stream.write(f"AUXDATA Volume = {_quoted(str(volume[0]))}\n".encode())
        stream.write(format_rows([c[block.first : block.first + block.size] for c in columns], formats))


def _write_triangles(stream: BinaryIO, mesh: Mesh, columns: list[NDArray[Any]], formats: list[str]) -> None:
    for k, volume in enumerate(np.unique(mesh.volume)):
        triangles = mesh.triangles[mesh.volume == volume]
        share = f", VARSHARELIST = ([1-{len(columns)}] = 1)" if k else ""
        zone = f"ZONE T = {_quoted(str(volume))}, N = {len(mesh.vertices)}, E = {len(triangles)}, "
        stream.write(f"{zone}ZONETYPE = FETRIANGLE, DATAPACKING = POINT{share}\n".encode())
        if not k:
            stream.write(format_rows(columns, formats))
        stream.write(format_rows([triangles[:, c] + 1 for c in range(3)], ["%d"] * 3))
