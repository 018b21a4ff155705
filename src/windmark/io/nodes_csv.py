"""Values per node as a CSV table."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.io.atomic import atomic_path
from windmark.io.fields import axis_labels, checked_fields, label, single_is_exact
from windmark.io.numbers_text import format_rows
from windmark.scene import Mesh

RESERVED = ("node", "block", "i", "j", "k", "x", "y", "z", "blanked")


def write_nodes_csv(
    path: str | os.PathLike[str],
    mesh: Mesh,
    fields: Mapping[str, ArrayLike] | None = None,
    *,
    units: Mapping[str, str] | None = None,
) -> None:
    """Write one line per node: ``node,block,i,j,k,x,y,z``, then the fields; ``nan`` where there is no value.

    ``node`` is the index in the mesh and ``i, j, k`` that in the block, all from 0. Without blocks these four
    columns (block, i, j, k) are left out. ``blanked`` (0 or 1) follows z where the mesh has blanked nodes.

    Parameters
    ----------
    path : the file
    mesh : the mesh
    fields : name -> (V,) values
    units : name -> unit, and "length" -> that of x, y, z, written into the header as ``name [unit]``

    Raises
    ------
    ValueError
        For wrong fields.
    FileError
        Where the file cannot be written; then nothing is.
    """
    arrays = checked_fields(mesh, fields or {}, units, RESERVED)
    xyz = mesh.vertices
    digits = "%.9g" if single_is_exact(xyz) else "%.17g"
    table: list[tuple[str, NDArray[Any], str]] = [("node", np.arange(len(xyz)), "%d")]
    table += _block_columns(mesh) if mesh.blocks else []
    table += [(name, xyz[:, k], digits) for k, name in enumerate(axis_labels(units))]
    if mesh.blanked is not None:
        table.append(("blanked", mesh.blanked.astype(int), "%d"))
    for name, values in arrays.items():
        table.append((label(name, units), values, "%.9g" if values.dtype == np.float32 else "%.17g"))
    with atomic_path(path) as temporary, open(temporary, "wb") as stream:
        stream.write(_line([name for name, _, _ in table]).encode())
        stream.write(format_rows([a for _, a, _ in table], [spec for _, _, spec in table], separator=","))


def _block_columns(mesh: Mesh) -> list[tuple[str, NDArray[Any], str]]:
    sizes = [block.size for block in mesh.blocks]
    names = np.repeat(np.array([_line([b.name]).rstrip("\n") for b in mesh.blocks], dtype=object), sizes)
    index = [np.indices(block.shape_ijk[::-1]).reshape(3, -1)[::-1] for block in mesh.blocks]
    columns = np.concatenate(index, axis=1)
    return [("block", names, "%s"), *((axis, columns[k], "%d") for k, axis in enumerate("ijk"))]


def _line(cells: list[str]) -> str:
    """A CSV line; cells with commas are quoted."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerow(cells)
    return out.getvalue()
