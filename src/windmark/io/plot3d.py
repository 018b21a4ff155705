"""PLOT3D grids: read in any layout, write in the one wanted.

Nodes keep the file's order (block after block, i fastest), so values per node can be written back as a
function file (`plot3d_function`) that fits the same grid.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.io.atomic import atomic_path
from windmark.io.errors import LARGEST, FileError
from windmark.io.fields import single_is_exact
from windmark.io.numbers_text import format_values
from windmark.io.plot3d_choose import checked_iblank, choose
from windmark.io.plot3d_detect import Source, load, read_blocks
from windmark.io.plot3d_layout import Plot3dLayout, block_words, record_sizes
from windmark.io.structured import Volumes, only_named, rename_volumes, structured_mesh, zone_names
from windmark.scene import Block, Mesh

Array = NDArray[np.float64]
Face = Literal["imin", "imax", "jmin", "jmax", "kmin", "kmax"]

_DIGITS = {4: 9, 8: 17}


def read_plot3d(
    path: str | os.PathLike[str],
    *,
    volumes: Volumes = None,
    volume_face: Face | None = None,
    layout: Plot3dLayout | None = None,
    only: bool = False,
) -> Mesh:
    """Read a PLOT3D grid; byte order, record marks, precision, IBLANK and block count are found from its sizes.

    Blocks are named zone01, zone02 ... and each is a volume of that name, unless ``volumes`` says otherwise.
    A block's triangles face d/d(fast index) x d/d(slow index); a file does not say which side is outside,
    and blocks of one file may differ.

    Parameters
    ----------
    path : the file, binary or text
    volumes : one volume name for all blocks, or {block: volume} for some
    volume_face : which face is the surface, for files with volume blocks (all three dimensions above 1), as
        flow solvers use them; its triangles face into the block, that is, into the flow
    layout : the layout, where sizes and numbers do not decide
    only : blocks that ``volumes`` does not name are not looked at: their nodes stay as they are, NaN too, and they have
        no triangles

    Raises
    ------
    FileError
        For a file that fits no layout or several (with sizes, byte and block), for coordinates that are not
        finite at nodes in use, and for volume blocks without ``volume_face``.
    """
    if volume_face is not None and volume_face not in get_args(Face):
        raise UsageError(f"volume_face must be one of {get_args(Face)}, got {volume_face!r}")
    source = load(path)
    candidate = choose(source, "grid", layout)
    parts, blocks, blanks, turned = [], [], [], []
    first = 0
    all_dims = candidate.header.dims
    if volume_face is not None and all(min(dims) == 1 for dims in all_dims):
        raise UsageError(f"volume_face: {path} has surfaces only; expected volume blocks")
    names = zone_names(len(all_dims))
    for k, (xyz, iblank) in enumerate(read_blocks(source, candidate)):
        dims = all_dims[k]
        checked_iblank(source, candidate, k, iblank)
        if min(dims) > 1:
            if volume_face is None:
                what = "is a volume, not a surface; say which face is the model, e.g. volume_face='kmin'"
                raise FileError(path, what, block_words(candidate.header, k))
            dims, xyz, iblank, turn = _face(dims, xyz, iblank, volume_face)
            turned += [k] if turn else []
        blocks.append(Block(names[k], dims, first))
        if not only or _named(names[k], volumes):
            _check_finite(source, blocks[-1], xyz, iblank)
        parts.append(xyz)
        blanks.append(iblank)
        first += blocks[-1].size
    vertices = np.empty((first, 3))
    with np.errstate(invalid="ignore"):  # blanked nodes may be any NaN
        for block, xyz in zip(blocks, parts, strict=True):
            vertices[block.first : block.first + block.size] = xyz.T
    blanked = np.concatenate([b == 0 for b in blanks if b is not None]) if candidate.layout.iblank else None
    mesh = structured_mesh(vertices, tuple(blocks), blanked, volumes=rename_volumes(names, volumes), reverse=turned)
    return only_named(mesh, volumes) if only else mesh


def detect_plot3d(path: str | os.PathLike[str], kind: Literal["grid", "function"] = "grid") -> Plot3dLayout:
    """Find how a PLOT3D file is stored; `Plot3dLayout.words` says it, `note` why, where several layouts fit.

    Give it to `write_plot3d` or `write_plot3d_function` to write in the same way.

    Raises
    ------
    FileError
        As `read_plot3d`.
    """
    if kind not in ("grid", "function"):
        raise ValueError(f"kind must be 'grid' or 'function', got {kind!r}")
    return choose(load(path), kind).layout


def _named(name: str, volumes: Volumes) -> bool:
    return not isinstance(volumes, Mapping) or name in volumes


def _check_finite(source: Source, block: Block, xyz: NDArray[np.floating], iblank: NDArray[np.integer] | None) -> None:
    bad = ~(np.abs(xyz) <= LARGEST).all(axis=0)
    if iblank is not None:
        bad &= iblank != 0
    if bad.any():
        node = int(np.argmax(bad))
        ni, nj, _ = block.shape_ijk
        ijk = f"i={node % ni}, j={node // ni % nj}, k={node // (ni * nj)} (from 0)"
        value = ", ".join(f"{v:g}" for v in xyz[:, node])
        what = f"node {ijk} is at ({value}); expected finite coordinates of at most {LARGEST:g}"
        raise FileError(source.path, what, block.name)


def _face(
    dims: tuple[int, int, int], xyz: NDArray[np.floating], iblank: NDArray[np.integer] | None, face: Face
) -> tuple[tuple[int, int, int], NDArray[np.floating], NDArray[np.integer] | None, bool]:
    """One face of a volume block: its size, nodes, IBLANK, and whether its triangles must be turned to face inwards."""
    axis = "ijk".index(face[0])
    at, beside = (0, 1) if face.endswith("min") else (-1, -2)
    whole = xyz.reshape(3, *dims[::-1])
    here, inner = (np.take(whole, k, axis=3 - axis) for k in (at, beside))  # (3, slow, fast)
    fast, slow = np.diff(here, axis=2)[:, :-1], np.diff(here, axis=1)[:, :, :-1]
    with np.errstate(all="ignore"):  # blanked nodes may hold anything
        normal = np.cross(fast, slow, axis=0)
        inward = np.nansum(normal * (inner - here)[:, :-1, :-1])
    flat = None if iblank is None else np.take(iblank.reshape(dims[::-1]), at, axis=2 - axis).ravel()
    shape = tuple(1 if k == axis else n for k, n in enumerate(dims))
    return shape, here.reshape(3, -1), flat, bool(inward < 0)  # type: ignore[return-value]


def write_plot3d(path: str | os.PathLike[str], mesh: Mesh, *, layout: Plot3dLayout | None = None) -> None:
    """Write a structured mesh as a PLOT3D grid.

    Parameters
    ----------
    path : the file
    mesh : a mesh with blocks
    layout : how to store it. None: little-endian Fortran records, multi-block, with IBLANK if the mesh has
        blanked nodes, in single precision if that keeps the coordinates exactly, else in double

    Raises
    ------
    ValueError
        For a mesh without blocks, or one that the layout cannot hold.
    FileError
        Where the file cannot be written.
    """
    if layout is None:
        real_bytes: Literal[4, 8] = 4 if single_is_exact(mesh.vertices) else 8
        layout = Plot3dLayout(iblank=mesh.blanked is not None, real_bytes=real_bytes)
    if mesh.blanked is not None and mesh.blanked.any() and not layout.iblank:
        raise UsageError("layout: the mesh has blanked nodes, which a layout without IBLANK cannot hold")
    blanked = np.zeros(len(mesh.vertices), dtype=bool) if mesh.blanked is None else mesh.blanked
    contents = []
    for block in structured_blocks(mesh):
        nodes = slice(block.first, block.first + block.size)
        contents.append((mesh.vertices[nodes].T, (~blanked[nodes]).astype(int) if layout.iblank else None))
    dims = [block.shape_ijk for block in mesh.blocks]
    write_blocks(path, np.array(dims), contents, layout)


def structured_blocks(mesh: Mesh) -> tuple[Block, ...]:
    """The blocks of a mesh, checked to hold its nodes in order."""
    ends = np.cumsum([0, *(block.size for block in mesh.blocks)])
    if not mesh.blocks or ends[-1] != len(mesh.vertices) or [b.first for b in mesh.blocks] != ends[:-1].tolist():
        raise UsageError(f"mesh: PLOT3D needs structured blocks that hold all nodes in order, got {mesh.blocks}")
    return mesh.blocks


def write_blocks(
    path: str | os.PathLike[str],
    table: NDArray[np.integer],
    contents: Sequence[tuple[NDArray[np.floating], NDArray[np.integer] | None]],
    layout: Plot3dLayout,
) -> None:
    """Write header and blocks of a grid or function file.

    Parameters
    ----------
    path : the file
    table : (B, 3) sizes for a grid, (B, 4) sizes and number of functions
    contents : reals (n, N) and IBLANK (N,) or None of each block
    layout : how to store them
    """
    if len(table) > 1 and not layout.multi_block:
        raise UsageError(f"layout: {len(table)} blocks need multi_block=True")
    counts = [np.array([len(table)])] if layout.multi_block else []
    with atomic_path(path) as temporary, open(temporary, "wb") as stream:
        if layout.text:
            for ints in [*counts, *table]:
                stream.write((" ".join(map(str, ints.tolist())) + "\n").encode())
            for reals, iblank in contents:
                stream.write(format_values(reals.ravel(), _DIGITS[layout.real_bytes]))
                stream.write(b"" if iblank is None else format_values(iblank, 9, per_line=30))
            return
        for ints in [*counts, table]:
            stream.writelines(_record(ints.astype(f"{layout.byte_order}i4").tobytes(), layout))
        for row, (reals, iblank) in zip(table.tolist(), contents, strict=True):
            for payload in _payloads(row, reals, iblank, layout):
                stream.writelines(_record(payload, layout))


def _payloads(
    row: list[int], reals: NDArray[np.floating], iblank: NDArray[np.integer] | None, layout: Plot3dLayout
) -> list[bytes]:
    """The records of one block, without marks."""
    planes = row[2] if layout.records == "plane" else 1
    out = []
    for plane in range(planes):
        part = slice(plane * reals.shape[1] // planes, (plane + 1) * reals.shape[1] // planes)
        payload = reals[:, part].astype(f"{layout.byte_order}f{layout.real_bytes}").tobytes()
        ints = b"" if iblank is None else iblank[part].astype(f"{layout.byte_order}i4").tobytes()
        out.append(payload + ints)
    if layout.records != "component":
        return out
    sizes = np.cumsum(record_sizes((row[0], row[1], row[2]), len(reals), layout))
    return [out[0][end - size : end] for end, size in zip(sizes, np.diff(sizes, prepend=0), strict=True)]


def _record(payload: bytes, layout: Plot3dLayout) -> list[bytes]:
    if not layout.record_mark:
        return [payload]
    if len(payload) >= 2 ** (8 * layout.record_mark - 1):
        raise UsageError(f"layout: a record of {len(payload)} bytes needs record_mark=8")
    mark = np.array(len(payload), dtype=f"{layout.byte_order}i{layout.record_mark}").tobytes()
    return [mark, payload, mark]
