"""PLY files, text and binary. Own code, for VTK's reader ends the process on a file that is cut short."""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark.io.atomic import atomic_path
from windmark.io.errors import FileError, reading
from windmark.io.fields import single_is_exact, written_by
from windmark.io.numbers_text import parse_numbers
from windmark.io.polygons import fan_triangles
from windmark.io.structured import Volumes, rename_volumes
from windmark.scene import Mesh

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_STRUCT = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_FACES = ("vertex_indices", "vertex_index")


@dataclass(frozen=True)
class _Property:
    """A scalar, or a list if it has a type of its count."""

    name: str
    kind: str
    count_kind: str = ""


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]


@dataclass(frozen=True)
class _Lists:
    """Lists of any length, one after the other."""

    sizes: NDArray[np.int64]
    values: NDArray[np.float64]


Columns = dict[str, NDArray[np.float64] | _Lists]


def read_ply(path: str | os.PathLike[str], *, volumes: Volumes = None) -> Mesh:
    """Read the vertices and faces of a PLY file; polygons become fans of triangles, all in the volume "model".

    Parameters
    ----------
    path : the file, text or binary in either byte order
    volumes : the volume's name, or {"model": name}

    Raises
    ------
    FileError
        For a header that is none (names the line), a file that ends too early (names element and byte), faces
        of no vertices, or no faces.
    """
    with reading(path):
        raw = Path(path).read_bytes()
    elements, form, body_at = _header(path, raw)
    _check_names(path, elements)
    if form == "ascii":
        # Numbers in text are laid out as doubles, and then read as the binary forms are.
        first_line = raw.count(b"\n", 0, body_at) + 1
        body = parse_numbers(raw[body_at:], path, first_line, repeats=False).all().tobytes()
        elements = [_as_doubles(e) for e in elements]
    else:
        body = raw[body_at:]
    columns: dict[str, Columns] = {}
    at = 0
    for element in elements:
        columns[element.name], at = _read_element(path, element, body, at, _ORDERS[form])
    vertices, faces = _vertices_and_faces(path, columns)
    corners, _ = fan_triangles(faces.sizes)
    bad = (faces.values < 0) | (faces.values >= len(vertices)) | (faces.values != np.floor(faces.values))
    if bad.any():
        what = f"a face names vertex {faces.values[np.argmax(bad)]:g}; expected 0 to {len(vertices) - 1}"
        raise FileError(path, what, "element face")
    if not len(corners):
        raise FileError(path, f"has {len(vertices)} points but no faces; expected a surface")
    return Mesh.make(vertices, faces.values[corners].astype(np.int32), rename_volumes(["model"], volumes)[0])


def _header(path: str | os.PathLike[str], raw: bytes) -> tuple[list[_Element], str, int]:
    """Elements, form, and the byte at which the body begins."""
    elements: list[_Element] = []
    form, at = "", 0
    for number in range(1, raw.count(b"\n") + 1):
        end = raw.index(b"\n", at) + 1
        words = raw[at:end].decode("ascii", "replace").split()
        at = end
        try:
            if number == 1 and words != ["ply"]:
                break
            if words[:1] == ["format"]:
                form = words[1] if words[1] in _ORDERS else ""
            elif words[:1] == ["element"]:
                elements.append(_Element(words[1], int(words[2]), []))
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append(_Property(words[4], _TYPES[words[3]], _TYPES[words[2]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append(_Property(words[2], _TYPES[words[1]]))
            elif words[:1] == ["end_header"]:
                if not form or any(e.count < 0 for e in elements):
                    break
                return elements, form, at
        except (IndexError, KeyError, ValueError):
            raise FileError(path, f"expected a line of a PLY header, got {' '.join(words)[:40]!r}", number) from None
    raise FileError(path, "expected a PLY header: ply, format, element, property and end_header lines")


def _check_names(path: str | os.PathLike[str], elements: list[_Element]) -> None:
    """No element twice, and no property twice in one."""
    for where, names in (("header", [e.name for e in elements]), *(
        (f"element {e.name}", [p.name for p in e.properties]) for e in elements
    )):  # fmt: skip
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise FileError(path, f"{twice!r} is there more than once", where)


def _as_doubles(element: _Element) -> _Element:
    same = [_Property(p.name, "f8", "f8" if p.count_kind else "") for p in element.properties]
    return _Element(element.name, element.count, same)


def _read_element(
    path: str | os.PathLike[str], element: _Element, body: bytes, at: int, order: str
) -> tuple[Columns, int]:
    """The columns of an element that begins at byte ``at`` of the body, and the byte behind it."""
    lists = [p for p in element.properties if p.count_kind]
    sizes: dict[str, int] = {}
    if element.count and lists:  # nearly always all faces have as many corners as the first
        _, _, sizes = _read_row(path, element, body, at, order)
    fields: list[tuple[str, str, tuple[int, ...]]] = []
    for p in element.properties:
        fields += [(f"{p.name} count", f"{order}{p.count_kind}", ())] if p.count_kind else []
        fields.append((p.name, f"{order}{p.kind}", (sizes.get(p.name, 0),) if p.count_kind else ()))
    dtype = np.dtype(fields)
    end = at + element.count * dtype.itemsize
    if end <= len(body):
        rows = np.frombuffer(body[at:end], dtype=dtype) if dtype.itemsize else np.zeros(0, dtype=dtype)
        if all((rows[f"{p.name} count"] == sizes[p.name]).all() for p in lists if element.count):
            with np.errstate(invalid="ignore"):  # a float may be any NaN
                return _columns_of_rows(rows, element), end
    elif not lists:
        raise _too_short(path, element, at, end - at, len(body))
    return _read_rows(path, element, body, at, order)


def _columns_of_rows(rows: NDArray[np.void], element: _Element) -> Columns:
    out: Columns = {}
    for p in element.properties:
        values = rows[p.name].astype(np.float64)
        if p.count_kind:
            sizes = rows[f"{p.name} count"].astype(np.int64)
            out[p.name] = _Lists(sizes, values.ravel())
        else:
            out[p.name] = values
    return out


def _too_short(path: str | os.PathLike[str], element: _Element, at: int, need: int, size: int) -> FileError:
    what = f"{element.count} of them need {need} bytes from byte {at} behind the header, the file has {size} there"
    return FileError(path, what, f"element {element.name}")


def _read_row(
    path: str | os.PathLike[str], element: _Element, body: bytes, at: int, order: str
) -> tuple[dict[str, tuple[float, ...]], int, dict[str, int]]:
    """One row: values of each property, the byte behind, the lengths of its lists."""
    values, sizes = {}, {}
    start = at
    try:
        for p in element.properties:
            count = 1
            if p.count_kind:
                (given,) = struct.unpack_from(order + _STRUCT[p.count_kind], body, at)
                at += int(p.count_kind[1])
                count = sizes[p.name] = int(given)
                if count != given or not 0 <= count <= len(body):
                    raise FileError(
                        path, f"a list of {given:g} values; expected a whole number", f"element {element.name}"
                    )
            values[p.name] = struct.unpack_from(f"{order}{count}{_STRUCT[p.kind]}", body, at)
            at += count * int(p.kind[1])
    except (struct.error, ValueError, OverflowError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(
            path,
            f"a row begins at byte {start} behind the header, the file has {len(body)} there",
            f"element {element.name}",
        ) from None
    return values, at, sizes


def _read_rows(
    path: str | os.PathLike[str], element: _Element, body: bytes, at: int, order: str
) -> tuple[Columns, int]:
    """Row by row, for lists of different lengths."""
    scalars: dict[str, list[float]] = {p.name: [] for p in element.properties}
    sizes: dict[str, list[int]] = {p.name: [] for p in element.properties if p.count_kind}
    for _ in range(element.count):
        values, at, lengths = _read_row(path, element, body, at, order)
        for name, found in values.items():
            scalars[name].extend(found)
        for name, length in lengths.items():
            sizes[name].append(length)
    columns: Columns = {name: np.array(found, dtype=float) for name, found in scalars.items()}
    for name, counts in sizes.items():
        columns[name] = _Lists(np.array(counts, dtype=np.int64), np.array(scalars[name], dtype=float))
    return columns, at


def _vertices_and_faces(
    path: str | os.PathLike[str], columns: dict[str, Columns]
) -> tuple[NDArray[np.float64], _Lists]:
    vertex, face = columns.get("vertex", {}), columns.get("face", {})
    xyz = [vertex.get(axis) for axis in "xyz"]
    if not all(isinstance(c, np.ndarray) for c in xyz):
        raise FileError(path, f"no x, y, z; it has {list(vertex)}", "element vertex")
    lists = next((face[name] for name in _FACES if name in face), None)
    if not isinstance(lists, _Lists):
        lists = _Lists(np.zeros(0, dtype=np.int64), np.zeros(0))
    return np.stack([c for c in xyz if isinstance(c, np.ndarray)], axis=1), lists


def write_ply(path: str | os.PathLike[str], mesh: Mesh, *, length_unit: str = "") -> None:
    """Write a mesh as binary PLY without its volumes, in double precision where single would lose something.

    Parameters
    ----------
    path : the file
    mesh : the mesh
    length_unit : unit of the coordinates, written as a comment

    Raises
    ------
    FileError
        Where the file cannot be written.
    """
    real, kind = ("<f4", "float") if single_is_exact(mesh.vertices) else ("<f8", "double")
    faces = np.empty(len(mesh.triangles), dtype=[("n", "u1"), ("corners", "<i4", 3)])
    faces["n"], faces["corners"] = 3, mesh.triangles
    lines = ["ply", "format binary_little_endian 1.0", f"comment {written_by()}"]
    lines += [f"comment length unit: {length_unit}"] if length_unit else []
    lines += [f"element vertex {len(mesh.vertices)}", *(f"property {kind} {axis}" for axis in "xyz")]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    with atomic_path(path) as temporary, open(temporary, "wb") as stream:
        stream.write("\n".join(lines).encode())
        stream.write(mesh.vertices.astype(real).tobytes())
        stream.write(faces.tobytes())
