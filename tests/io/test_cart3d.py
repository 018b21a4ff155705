"""Cart3D triangulations; the bytes of the files that are read are made with `struct`."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from windmark.io import FileError, read_mesh, write_mesh

TEXT = "4 2\n0 0 0\n1 0 0\n0 1 0\n1 1 .5\n1 2 4\n1 4 3\n"
VERTICES = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.5]]


def records(order, real, components):
    parts = [
        struct.pack(order + "2i", 4, 2),
        struct.pack(f"{order}12{real}", *np.ravel(VERTICES)),
        struct.pack(order + "6i", 1, 2, 4, 1, 4, 3),
    ]
    parts += [struct.pack(order + "2i", 3, 1)] if components else []
    return b"".join(struct.pack(order + "i", len(p)) + p + struct.pack(order + "i", len(p)) for p in parts)


@pytest.mark.parametrize("components", [True, False])
@pytest.mark.parametrize("form", ["text", "<f", ">f", "<d", ">d"])
def test_every_form_is_read(tmp_path, form, components):
    text = TEXT + "3\n1\n" * components
    (tmp_path / "a.tri").write_bytes(text.encode() if form == "text" else records(*form, components))
    mesh = read_mesh(tmp_path / "a.tri")
    np.testing.assert_array_equal(mesh.vertices, VERTICES)
    np.testing.assert_array_equal(mesh.triangles, [[0, 1, 3], [0, 3, 2]])
    np.testing.assert_array_equal(mesh.volume, ["comp03", "comp01"] if components else ["model", "model"])


def test_what_is_written_comes_back(tmp_path, shell):
    write_mesh(tmp_path / "a.tri", shell)
    got = read_mesh(tmp_path / "a.tri", volumes={"comp01": "fuselage", "comp02": "wing, left"})
    np.testing.assert_array_equal(got.vertices, shell.vertices)
    np.testing.assert_array_equal(got.triangles, shell.triangles)
    np.testing.assert_array_equal(got.volume, shell.volume)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (TEXT.encode()[:-3], r"4 vertices and 2 triangles take 20 numbers, or 22 with components; the file holds 19"),
        (b"4 2.5 1", r"begins with \[4.0, 2.5\]; expected the numbers of vertices and triangles"),
        (b"4", "begins with"),
        (
            TEXT.replace("1 4 3", "1 5 3").encode(),
            r"triangle 2: names the vertices \[1.0, 5.0, 3.0\]; expected .* 1 to 4",
        ),
        (b"900000000 2 5*1", "take 2700000008 numbers"),
        (records("<", "f", True)[:-1], r"take records of \[48, 24\] bytes .*; the file has \[48, 24\]"),
        (bytes(100), "neither text nor Fortran records"),
    ],
)
def test_damaged_files(tmp_path, content, message):
    (tmp_path / "a.tri").write_bytes(content)
    with pytest.raises(FileError, match=message):
        read_mesh(tmp_path / "a.tri")
