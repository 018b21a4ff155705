"""Cart3D triangulations (``.tri``), text or Fortran records: vertices, triangles, a component number per triangle."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from windmark.io.atomic import atomic_path
from windmark.io.errors import FileError
from windmark.io.fields import single_is_exact
from windmark.io.numbers_text import NumberText, format_rows
from windmark.io.plot3d_detect import load, walk_records
from windmark.io.plot3d_layout import Plot3dLayout
from windmark.io.structured import Volumes, rename_volumes
from windmark.scene import Mesh


def read_cart3d(path: str | os.PathLike[str], *, volumes: Volumes = None) -> Mesh:
    """Read a Cart3D triangulation; component 1 becomes the volume comp01, and so on ("model" without components).

    Parameters
    ----------
    path : the file: text, or Fortran records in either byte order with single or double precision
    volumes : one volume name for all, or {component's name: volume} for some

    Raises
    ------
    FileError
        For a file whose length is not that of the vertices and triangles it declares, or a triangle of no vertices.
    """
    source = load(path)
    if source.numbers is not None:
        vertices, corners, component = _from_text(path, source.numbers)
    else:
        vertices, corners, component = _from_records(path, source.data)
    if not (corners.min() >= 1 and corners.max() <= len(vertices) and (corners == np.floor(corners)).all()):
        bad = (corners < 1) | (corners > len(vertices)) | (corners != np.floor(corners))
        k = int(np.argmax(bad.any(axis=1)))
        what = f"names the vertices {corners[k].tolist()}; expected whole numbers 1 to {len(vertices)}"
        raise FileError(path, what, f"triangle {k + 1}")
    odd = ~(np.abs(component) < 2**31) | (component != np.floor(component))
    if odd.any():
        k = int(np.argmax(odd))
        raise FileError(path, f"its component is {component[k]:g}; expected a whole number", f"triangle {k + 1}")
    numbers, which = np.unique(component, return_inverse=True)
    found = [f"comp{int(n):02d}" for n in numbers] if component.any() else ["model"]
    names = np.array(rename_volumes(found, volumes), dtype=np.str_)
    return Mesh.make(vertices, corners.astype(np.int32) - 1, names[which])


Parts = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def _from_text(path: str | os.PathLike[str], numbers: NumberText) -> Parts:
    head = numbers.head(2)
    if len(head) < 2 or not all(n >= 1 and n.is_integer() for n in head.tolist()):
        raise FileError(path, f"begins with {head.tolist()}; expected the numbers of vertices and triangles", 1)
    n_vertices, n_triangles = (int(n) for n in head)
    short = 2 + 3 * n_vertices + 3 * n_triangles
    if numbers.total not in (short, short + n_triangles):
        what = f"{n_vertices} vertices and {n_triangles} triangles take {short} numbers, or {short + n_triangles}"
        raise FileError(path, f"{what} with components; the file holds {numbers.total}")
    values = numbers.all()
    corners_at = 2 + 3 * n_vertices
    component = values[short:] if len(values) > short else np.zeros(n_triangles)
    return values[2:corners_at].reshape(-1, 3), values[corners_at:short].reshape(-1, 3), component


def _from_records(path: str | os.PathLike[str], data: NDArray[np.uint8]) -> Parts:
    for order in ("<", ">"):
        layout = Plot3dLayout(byte_order=order, record_mark=4)
        walk = walk_records(data, 0, layout)
        if walk.sizes[:1] != [8]:
            continue
        n_vertices, n_triangles = (int(n) for n in data[4:12].view(f"{order}i4"))
        single = [8, 12 * n_vertices, 12 * n_triangles]
        double = [8, 24 * n_vertices, 12 * n_triangles]
        for sizes, real in ((single, "f4"), (double, "f8")):
            if n_triangles > 0 and walk.sizes in (sizes, [*sizes, 4 * n_triangles]) and walk.end == len(data):
                starts = np.cumsum([4, *(s + 8 for s in walk.sizes)])
                xyz, corners, *rest = (
                    data[a : a + s].view(f"{order}{kind}").astype(float)
                    for a, s, kind in zip(starts[1:], walk.sizes[1:], (real, "i4", "i4"), strict=False)
                )
                component = rest[0] if rest else np.zeros(n_triangles)
                return xyz.reshape(-1, 3), corners.reshape(-1, 3), component
        what = f"{n_vertices} vertices and {n_triangles} triangles take records of {single[1:]} bytes"
        raise FileError(path, f"{what} (and {4 * n_triangles} of components); the file has {walk.sizes[1:]}")
    raise FileError(path, "neither text nor Fortran records that begin with two counts; expected a Cart3D file")


def write_cart3d(path: str | os.PathLike[str], mesh: Mesh) -> None:
    """Write a mesh as Cart3D text; volumes become components, numbered from 1 in the order of their names.

    Raises
    ------
    FileError
        Where the file cannot be written.
    """
    xyz = mesh.vertices
    digits = "%.9g" if single_is_exact(xyz) else "%.17g"
    _, component = np.unique(mesh.volume, return_inverse=True)
    with atomic_path(path) as temporary, open(temporary, "wb") as stream:
        stream.write(f"{len(xyz)} {len(mesh.triangles)}\n".encode())
        stream.write(format_rows([xyz[:, k] for k in range(3)], [digits] * 3))
        stream.write(format_rows([mesh.triangles[:, k] + 1 for k in range(3)], ["%d"] * 3))
        stream.write(format_rows([component + 1], ["%d"]))
