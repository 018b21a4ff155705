"""Wavefront OBJ files."""

from __future__ import annotations

import os
import re
from pathlib import Path

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
        lines = Path(path).read_bytes().replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()
    points = [b""] * len(lines)  # texts stay on their lines, for errors to name them
    faces = [b""] * len(lines)
    seen: list[int] = []  # vertices above each face, from which negative indices count
    group_of_face: list[int] = []
    groups = ["model"]
    count = 0
    for k, line in enumerate(lines):
        word, _, rest = line.strip().replace(b"\t", b" ").partition(b" ")
        if word == b"v":
            points[k] = rest
            count += 1
        elif word == b"f":
            faces[k] = rest
            seen.append(count)
            group_of_face.append(len(groups) - 1)
        elif word in (b"o", b"g"):
            groups.append(rest.decode("utf-8", "replace").strip() or "model")
            check_names(path, groups[-1:], k + 1)
    if not seen:
        raise FileError(path, f"has {count} vertices but no faces; expected a surface")
    triangles, face = _fans(path, faces, np.array(seen), count)
    names = _volume_names(groups, sorted(set(group_of_face)), volumes)
    return Mesh.make(_points(path, points, count), triangles, names[np.array(group_of_face)[face]])


def _volume_names(groups: list[str], used: list[int], volumes: Volumes) -> NDArray[np.str_]:
    """The volume of each group; groups without faces are none."""
    names = np.array(groups, dtype=object)
    names[used] = rename_volumes([groups[k] for k in used], volumes)
    return names.astype(np.str_)


def _points(path: str | os.PathLike[str], points: list[bytes], count: int) -> NDArray[np.float64]:
    """(V, 3) vertices; a fourth number (a weight) and colours behind are left out."""
    numbers = parse_numbers(b"\n".join(points), path, repeats=False).all()
    per = len(numbers) // max(1, count)
    if per < 3 or len(numbers) != per * count:
        raise FileError(path, f"{count} vertices hold {len(numbers)} numbers; expected as many, at least 3, in each")
    return numbers.reshape(-1, per)[:, :3].copy()


def _fans(
    path: str | os.PathLike[str], faces: list[bytes], seen: NDArray[np.int64], count: int
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """(T, 3) triangles and (T,) the face each belongs to."""
    words = _TEXTURE.sub(b"", b"\n".join(faces)).split(b"\n")
    per_line = np.array([len(word.split()) for word in words])
    lines = np.flatnonzero(per_line)
    sizes = per_line[lines]
    if sizes.min() < 3 or len(sizes) != len(seen):
        raise FileError(path, "a face of fewer than three corners", int(lines[np.argmin(sizes)]) + 1)
    given = parse_numbers(b"\n".join(words), path, repeats=False).all()
    of_corner = np.repeat(np.arange(len(sizes)), sizes)
    index = np.where(given < 0, seen[of_corner] + given, given - 1)
    bad = ~((index >= 0) & (index < count) & (given != 0) & (index == np.floor(index)))
    if bad.any():
        k = int(np.argmax(bad))
        raise FileError(path, f"a face names vertex {given[k]:g}; the file has {count}", int(lines[of_corner[k]]) + 1)
    corners, face = fan_triangles(sizes)
    return index[corners].astype(np.int32), face


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
