"""Read surfaces of the VTK family through VTK's own readers, in a process of their own (`apart`)."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from html import unescape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.io.apart import Content, read_apart
from windmark.io.errors import note_read
from windmark.io.fields import LENGTH, split_label
from windmark.io.mesh_content import content_mesh
from windmark.io.structured import Volumes
from windmark.io.vtk_parts import READERS
from windmark.scene import Mesh

VTK_SUFFIXES = tuple(READERS)
_CONTENT = "windmark.io.vtk_parts:vtk_content"
_FILE = re.compile(rb"""\bfile\s*=\s*["']([^"']+)["']""")


def read_vtk(path: str | os.PathLike[str], *, volumes: Volumes = None) -> Mesh:
    """Read a surface of the VTK family (.vtp, .vtu, .vts, .vtm, .vtk).

    Polygons are split into triangles; of solid cells the outside is taken; nodes keep the file's order.

    Parameters
    ----------
    path : the file; its extension says which reader
    volumes : one volume name for all, or {volume in the file: volume} for some. In the file it is the block's
        name (.vtm), what `write_nodes_vtk` has written, else "model"

    Raises
    ------
    FileError
        For a file that VTK cannot read or that ends it, whose numbers do not fit together, or that has no faces.
    """
    return content_mesh(_read(path, values=False), volumes)


def read_vtk_nodes(
    path: str | os.PathLike[str], *, volumes: Volumes = None
) -> tuple[Mesh, dict[str, NDArray[np.floating]], dict[str, str], tuple[str, ...]]:
    """As `read_vtk`, with the values at the nodes.

    Returns
    -------
    mesh
    fields : name -> (V,) values; a vector a becomes a_x, a_y, a_z. Of a file of several pieces those that all have
    units : name -> unit where the array's name carries one as ``name [unit]``, and "length" where the file says it
    left_out : arrays that are no such values (at cells, other sizes, text), in words
    """
    content = _read(path, values=True)
    fields, units = {}, {LENGTH: content["length_unit"]}
    for k, text in enumerate(content["columns"]):
        name, unit = split_label(text)
        fields[name], units[name] = content[f"column{k}"], unit
    left_out = tuple(content["left_out"])
    return content_mesh(content, volumes), fields, {name: unit for name, unit in units.items() if unit}, left_out


def _read(path: str | os.PathLike[str], *, values: bool) -> Content:
    """What is in a file; the files that it names are noted here, for they are read in a process apart."""
    _check_suffix(path)
    for part in parts_of(path):
        note_read(part)
    return read_apart(_CONTENT, path, values=values)


def parts_of(path: str | os.PathLike[str]) -> list[Path]:
    """The files that a ``.vtm`` file names, and those of a ``.vtm`` among them; none for any other, or where it cannot
    be read, which is told of when it is.
    """
    out: dict[Path, None] = {}
    left = [Path(path)]
    while left:
        one = left.pop()
        if one.suffix.lower() != ".vtm":
            continue
        with suppress(OSError):
            names = [unescape(name.decode("utf-8", "replace")) for name in _FILE.findall(one.read_bytes())]
            new = [p for name in names if (p := one.parent / name) not in out]
            out |= dict.fromkeys(new)
            left += new
    return list(out)


def _check_suffix(path: str | os.PathLike[str]) -> None:
    if Path(path).suffix.lower() not in READERS:
        raise UsageError(f"path: {path} must end in one of {VTK_SUFFIXES}")
