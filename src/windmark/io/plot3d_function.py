"""PLOT3D function files: values per node in the order of the grid, with their names beside in a ``.nam`` file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.io.atomic import atomic_path
from windmark.io.errors import FileError, reading
from windmark.io.fields import checked_fields, label
from windmark.io.plot3d import structured_blocks, write_blocks
from windmark.io.plot3d_choose import choose
from windmark.io.plot3d_detect import load, read_blocks
from windmark.io.plot3d_layout import Plot3dLayout
from windmark.scene import Mesh

DEFAULT_LAYOUT = Plot3dLayout()


def write_plot3d_function(
    path: str | os.PathLike[str],
    mesh: Mesh,
    fields: Mapping[str, ArrayLike],
    *,
    units: Mapping[str, str] | None = None,
    layout: Plot3dLayout = DEFAULT_LAYOUT,
    fill: float = float("nan"),
) -> None:
    """Write values per node as a PLOT3D function file, and their names to a ``.nam`` file beside it.

    Parameters
    ----------
    path : the function file; the names go to the same name with the extension ``.nam``, one per line
    mesh : a mesh with blocks
    fields : name -> (V,) values, NaN where there is none
    units : name -> unit, written behind the names (a unit of "length" is accepted: it has no place here)
    layout : how to store it: `detect_plot3d` of the grid gives its own layout. Default: little-endian Fortran
        records in single precision. Function files have no IBLANK and
        one record per block, whatever the grid has
    fill : written instead of NaN, for programs that cannot read NaN

    Raises
    ------
    ValueError
        For a mesh without blocks, wrong fields, or a ``fill`` that a value has already.
    FileError
        Where a file cannot be written; then neither is.
    """
    blocks = structured_blocks(mesh)
    arrays = {name: _filled(name, a, fill) for name, a in checked_fields(mesh, fields, units).items()}
    if not arrays:
        raise UsageError("fields: expected at least one")
    names = _names_path(path)
    if names == Path(path):
        raise UsageError(f"path: {path} must not end in .nam, which is for the names")
    table = np.array([[*block.shape_ijk, len(arrays)] for block in blocks])
    contents: list[tuple[NDArray[np.floating], None]] = [
        (np.stack([a[b.first : b.first + b.size] for a in arrays.values()]), None) for b in blocks
    ]
    with atomic_path(names) as temporary:
        temporary.write_text("".join(f"{label(name, units)}\n" for name in arrays), encoding="utf-8")
        write_blocks(path, table, contents, replace(layout, iblank=False, records="whole"))


def _filled(name: str, values: NDArray[Any], fill: float) -> NDArray[Any]:
    missing = np.isnan(values)
    if np.isnan(fill) or not missing.any():
        return values
    if (values == values.dtype.type(fill)).any():
        raise UsageError(f"fill: {fill} is a value of {name!r}; choose a number that no value has")
    return np.where(missing, values.dtype.type(fill), values)


def _names_path(path: str | os.PathLike[str]) -> Path:
    return Path(path).with_suffix(".nam")


def read_plot3d_function(
    path: str | os.PathLike[str], mesh: Mesh | None = None, *, layout: Plot3dLayout | None = None
) -> dict[str, NDArray[np.floating]]:
    """Read a PLOT3D function file: name (as in the ``.nam`` file, else f1, f2 ...) -> (V,) values.

    Parameters
    ----------
    path : the function file, in any layout
    mesh : the grid; its blocks must have the sizes of the file's
    layout : the layout, where sizes and numbers do not decide

    Raises
    ------
    FileError
        For a file that fits no layout, or that fits not the mesh, or whose names are not as many as its functions.
    """
    source = load(path)
    candidate = choose(source, "function", layout)
    header = candidate.header
    if mesh is not None:
        _check_blocks(path, header.dims, [block.shape_ijk for block in mesh.blocks])
    values = np.concatenate([reals for reals, _ in read_blocks(source, candidate)], axis=1)
    values = values.astype(values.dtype.newbyteorder("="))
    return dict(zip(_read_names(path, len(values)), values, strict=True))


def _check_blocks(
    path: str | os.PathLike[str], dims: tuple[tuple[int, int, int], ...], wanted: list[tuple[int, int, int]]
) -> None:
    if len(dims) != len(wanted):
        raise FileError(path, f"{len(dims)} blocks; expected the mesh's {len(wanted)}")
    for k, (have, want) in enumerate(zip(dims, wanted, strict=True)):
        if have != want:
            raise FileError(path, f"{have} nodes; expected the mesh's {want}", f"block {k + 1} of {len(dims)}")


def _read_names(path: str | os.PathLike[str], count: int) -> list[str]:
    beside = _names_path(path)
    if not beside.is_file():
        return [f"f{k}" for k in range(1, count + 1)]
    with reading(beside):
        lines = beside.read_text(encoding="utf-8", errors="replace").splitlines()
    names = [line.strip() for line in lines if line.strip()]
    if len(names) != count or len(set(names)) != count:
        raise FileError(
            beside, f"{len(names)} names; expected {count} different ones, as many as {Path(path).name} has"
        )
    return names
