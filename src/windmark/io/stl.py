"""STL files, binary and ASCII: triangles whose equal corners become one vertex."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark.io.atomic import atomic_path
from windmark.io.errors import FileError, reading
from windmark.io.fields import written_by
from windmark.io.mesh_content import check_names
from windmark.io.numbers_text import parse_numbers
from windmark.io.structured import Volumes, rename_volumes
from windmark.scene import Mesh

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84
_SOLID = re.compile(rb"^[ \t]*solid\b[ \t]*([^\r\n]*)", re.MULTILINE)
_VERTEX = re.compile(rb"\bvertex\b([^\r\n]*)")


def read_stl(path: str | os.PathLike[str], *, volumes: Volumes = None) -> Mesh:
    """Read an STL file; corners with equal coordinates become one vertex, in the order of first use.

    Parameters
    ----------
    path : the file
    volumes : one volume name for all triangles, or {solid: volume} for some; the volume is the solid's name
        in ASCII files, "model" where there is none and in binary files

    Raises
    ------
    FileError
        For a file whose size is not that of its triangles, or a corner that is not three numbers.
    """
    with reading(path):
        raw = Path(path).read_bytes()
    count = int.from_bytes(raw[80:_HEADER], "little")
    if len(raw) >= _HEADER and len(raw) == _HEADER + count * _FACET.itemsize:
        with np.errstate(invalid="ignore"):  # a float may be any NaN; `read_mesh` refuses it
            corners = np.frombuffer(raw, dtype=_FACET, offset=_HEADER)["corners"].astype(np.float64)
        solids, of_triangle = ["model"], np.zeros(len(corners), dtype=np.int64)
    elif raw.lstrip()[:5].lower() == b"solid" and b"facet" in raw[:4096]:
        corners, solids, of_triangle = _ascii(raw, path)
    else:
        expected = (
            f"{count} triangles take {_HEADER + count * _FACET.itemsize}" if len(raw) >= _HEADER else "at least 84"
        )
        raise FileError(path, f"the file has {len(raw)} bytes; expected an STL file: {expected} bytes")
    if not len(corners):
        raise FileError(path, "no triangles; expected a surface")
    vertices, index = merge_equal(corners.reshape(-1, 3))
    names = np.array(rename_volumes(solids, volumes), dtype=np.str_)
    return Mesh.make(vertices, index.reshape(-1, 3).astype(np.int32), names[of_triangle])


def _ascii(raw: bytes, path: str | os.PathLike[str]) -> tuple[NDArray[np.float64], list[str], NDArray[np.int64]]:
    """Corners (T, 3, 3), names of the solids, and the solid of each triangle."""
    matches = list(_SOLID.finditer(raw))
    if not matches:
        raise FileError(path, "begins with 'solid', but has no line of that word; expected an STL file")
    corners, names, of_triangle = [], [], []
    line, at = 1, 0
    for match, after in zip(matches, [*matches[1:], None], strict=True):
        body = raw[match.end() : after.start() if after else len(raw)]
        line, at = line + raw.count(b"\n", at, match.end()), match.end()
        words = _VERTEX.findall(body)
        numbers = _corner_numbers(path, words, body, line)
        if (
            len(words) % 3
            or len(numbers) != 3 * len(words)
            or len(words) != 3 * len(re.findall(rb"\bendfacet\b", body))
        ):
            what = f"{len(words)} corners of {len(numbers)} numbers; expected three corners of three per facet"
            raise FileError(path, what, f"solid at line {line}")
        corners.append(numbers.reshape(-1, 3, 3))
        names.append(match[1].decode("utf-8", "replace").strip() or "model")
        check_names(path, names[-1:], line)
        of_triangle.append(np.full(len(corners[-1]), len(names) - 1))
    return np.concatenate(corners), names, np.concatenate(of_triangle)


def _corner_numbers(path: str | os.PathLike[str], words: list[bytes], body: bytes, line: int) -> NDArray[np.float64]:
    try:
        return parse_numbers(b"\n".join(words), path, repeats=False).all()
    except FileError:
        # Once more with every line in its place, for the error to name the right one.
        found = (_VERTEX.search(text) for text in body.split(b"\n"))
        parse_numbers(b"\n".join(match[1] if match else b"" for match in found), path, line, repeats=False)
        raise


def merge_equal(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Distinct points in the order of first use, and the index of each given point among them."""
    rows = np.ascontiguousarray(points + 0.0)  # -0.0 becomes 0.0, which is the same point
    order = np.lexsort(rows.T)
    new = np.ones(len(rows), dtype=bool)
    new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    group = np.empty(len(rows), dtype=np.int64)
    group[order] = np.cumsum(new) - 1
    first = order[new]  # lexsort is stable: the first of equal points leads its group
    by_use = np.argsort(first)
    rank = np.empty_like(by_use)
    rank[by_use] = np.arange(len(by_use))
    return rows[first[by_use]], rank[group]


def write_stl(path: str | os.PathLike[str], mesh: Mesh) -> None:
    """Write the triangles as binary STL: single precision, no volumes, nodes in no triangle are lost.

    Raises
    ------
    FileError
        Where the file cannot be written.
    """
    facets = np.zeros(len(mesh.triangles), dtype=_FACET)
    normals = mesh.triangle_normals()
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    facets["normal"] = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    facets["corners"] = mesh.vertices[mesh.triangles]
    header = f"binary STL by {written_by()}".encode().ljust(80)
    with atomic_path(path) as temporary, open(temporary, "wb") as stream:
        stream.write(header + len(facets).to_bytes(4, "little"))
        stream.write(facets.tobytes())
