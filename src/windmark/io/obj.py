"""Wavefront OBJ files."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from windmark.io.atomic import atomic_path
from windmark.io.errors import FileError, reading
from windmark.io.fields import single_is_exact, written_by
from windmark.io.mesh_content import check_names
from windmark.io.numbers_text import format_rows, parse_numbers
from windmark.io.polygons import fan_triangles
from windmark.io.structured import Volumes, rename_volumes
from windmark.scene import Mesh

Indices = NDArray[np.int64]

_PIECE = 2**18
_TEXTURE = re.compile(rb"/[^ \t\r\n]*")  # the part of "vertex/texture/normal" that is not the vertex


def read_obj(path: str | os.PathLike[str], *, volumes: Volumes = None) -> Mesh:
    """Read the vertices and faces of a Wavefront OBJ file; polygons become fans of triangles.

    Parameters
    ----------
    path : the file
    volumes : one volume name for all, or {group: volume} for some; the volume is the name of the object (``o``)
        or group (``g``) above the face, "model" where there is none

    Raises
    ------
    FileError
        For a vertex or face that is none (names the line), or a file without faces.
    """
    with reading(path):
        raw = Path(path).read_bytes()
    if b"\\" in raw:
        raw = raw.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    surface = _Surface(path)
    for part, line in _pieces(raw):
        surface.add(part, line)
    if not surface.faces:
        raise FileError(path, f"has {surface.count} vertices but no faces; expected a surface")
    names = _volume_names(surface.groups, sorted(surface.used), volumes)
    return Mesh.make(surface.points(), surface.triangles(), names[np.concatenate(surface.group)])


def _pieces(raw: bytes) -> Iterator[tuple[bytes, int]]:
    """The text in pieces of whole lines and their first line's number: as lines it takes many times its memory."""
    end = b"\n" if b"\n" in raw else b"\r"
    start, line = 0, 1
    while start < len(raw):
        stop = raw.find(end, start + _PIECE) + 1 or len(raw)
        part = raw[start:stop]
        yield part, line
        line += len(part.splitlines())
        start = stop


class _Surface:
    """Vertices and faces gathered from one piece after the other."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = path
        self.groups = ["model"]
        self.used: set[int] = set()
        """Groups with faces."""
        self.vertices: list[NDArray[np.float64]] = []
        self.count = 0
        self.faces: list[NDArray[np.int32]] = []
        """(T, 3) of each piece, with the group (T,) and the line (T,) of each triangle."""
        self.group: list[NDArray[np.int32]] = []
        self.line: list[NDArray[np.int32]] = []

    def add(self, part: bytes, first: int) -> None:
        """A piece whose first line has the number ``first``."""
        lines = part.splitlines()
        points = [b""] * len(lines)  # texts stay on their lines, for errors to name them
        faces = [b""] * len(lines)
        seen: list[int] = []  # vertices above each face, from which negative indices count
        group: list[int] = []
        count = self.count
        for k, line in enumerate(lines):
            word, _, rest = line.strip().replace(b"\t", b" ").partition(b" ")
            if word in (b"v", b"f") and not rest.split():
                what = "a vertex" if word == b"v" else "a face"
                raise FileError(self.path, f"{what} without numbers; expected at least 3", first + k)
            if word == b"v":
                points[k] = rest
                count += 1
            elif word == b"f":
                faces[k] = rest
                seen.append(count)
                group.append(len(self.groups) - 1)
            elif word in (b"o", b"g"):
                self.groups.append(rest.decode("utf-8", "replace").strip() or "model")
                check_names(self.path, self.groups[-1:], first + k)
        if count > self.count:
            self._add_points(points, first)
        if seen:
            self._add_faces(faces, first, np.array(seen), np.array(group, dtype=np.int32))

    def _numbers(self, texts: list[bytes], first: int) -> tuple[NDArray[np.float64], Indices, Indices]:
        """The numbers of some lines, how many (L,) each line with any has, and the numbers of those lines."""
        per_line = np.array([len(text.split()) for text in texts])
        numbers = parse_numbers(b"\n".join(texts), self.path, first, repeats=False).all()
        if len(numbers) != per_line.sum():
            line = next(k for k, text in enumerate(texts) if b"," in text)
            raise FileError(self.path, "numbers with a comma; expected blanks between them", first + line)
        where = np.flatnonzero(per_line)
        return numbers, per_line[where], first + where

    def _add_points(self, points: list[bytes], first: int) -> None:
        """Vertices; a fourth number (a weight) and colours behind are left out."""
        numbers, sizes, lines = self._numbers(points, first)
        if sizes.min() < 3:
            k = int(np.argmin(sizes))
            raise FileError(self.path, f"a vertex of {sizes[k]} numbers; expected at least 3", int(lines[k]))
        self.vertices.append(numbers[(np.cumsum(sizes) - sizes)[:, None] + np.arange(3)])
        self.count += len(sizes)

    def _add_faces(self, faces: list[bytes], first: int, seen: Indices, group: NDArray[np.int32]) -> None:
        bare = [_TEXTURE.sub(b"", face) if b"/" in face else face for face in faces]
        given, sizes, lines = self._numbers(bare, first)
        if sizes.min() < 3:
            raise FileError(self.path, "a face of fewer than three corners", int(lines[np.argmin(sizes)]))
        of_corner = np.repeat(np.arange(len(sizes)), sizes)
        index = np.where(given < 0, seen[of_corner] + given, given - 1)
        bad = ~((index >= 0) & (index < 2**31 - 1) & (given != 0) & (index == np.floor(index)))
        if bad.any():
            k = int(np.argmax(bad))
            self._refuse(given[k], seen[of_corner[k]], int(lines[of_corner[k]]))
        corners, face = fan_triangles(sizes)
        self.faces.append(index[corners].astype(np.int32))
        self.group.append(group[face])
        self.line.append(lines[face].astype(np.int32))
        self.used.update(group.tolist())

    def _refuse(self, given: float, above: int, line: int) -> NoReturn:
        raise FileError(self.path, f"a face names vertex {given:g}; there are {above} above it", line)

    def points(self) -> NDArray[np.float64]:
        """(V, 3) all vertices."""
        return np.concatenate(self.vertices) if self.vertices else np.zeros((0, 3))

    def triangles(self) -> NDArray[np.int32]:
        """(T, 3) all triangles; `FileError` for a vertex that the file does not have."""
        triangles, lines = np.concatenate(self.faces), np.concatenate(self.line)
        if triangles.max() >= self.count:
            k = int(np.argmax((triangles >= self.count).any(axis=1)))
            what = f"a face names vertex {triangles[k].max() + 1}; the file has {self.count}"
            raise FileError(self.path, what, int(lines[k]))
        return triangles


def _volume_names(groups: list[str], used: list[int], volumes: Volumes) -> NDArray[np.str_]:
    """The volume of each group; groups without faces are none."""
    names = np.array(groups, dtype=object)
    names[used] = rename_volumes([groups[k] for k in used], volumes)
    return names.astype(np.str_)


def write_obj(path: str | os.PathLike[str], mesh: Mesh, *, length_unit: str = "") -> None:
    """Write a mesh as Wavefront OBJ, a group per volume.

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
    xyz, triangles = mesh.vertices, mesh.triangles + 1
    digits = "%.9g" if single_is_exact(xyz) else "%.17g"
    changes = np.flatnonzero(np.r_[True, mesh.volume[1:] != mesh.volume[:-1]]) if len(triangles) else np.zeros(0, int)
    unit = f"# length unit: {length_unit}\n" if length_unit else ""
    with atomic_path(path) as temporary, open(temporary, "wb") as stream:
        stream.write(f"# {written_by()}\n{unit}".encode())
        stream.write(format_rows([xyz[:, k] for k in range(3)], [f"v {digits}", digits, digits]))
        for start, end in zip(changes, [*changes[1:], len(triangles)], strict=True):
            stream.write(f"g {' '.join(str(mesh.volume[start]).split())}\n".encode())
            stream.write(format_rows([triangles[start:end, k] for k in range(3)], ["f %d", "%d", "%d"]))
