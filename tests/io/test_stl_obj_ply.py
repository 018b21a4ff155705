"""STL, OBJ and PLY surfaces."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import pyvista as pv
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from windmark.io import FileError, obj, read_mesh, write_mesh
from windmark.io.stl import merge_equal


def corner_sets(mesh):
    """Each triangle's corners, with the first one made the smallest: order of turning kept."""
    corners = mesh.vertices[mesh.triangles].astype(np.float32)
    return sorted(min(tuple(map(tuple, np.roll(c, -k, axis=0).tolist())) for k in range(3)) for c in corners)


def test_stl_is_read_by_vtk_and_comes_back(tmp_path, blocks):
    write_mesh(tmp_path / "a.stl", blocks)
    seen = pv.read(tmp_path / "a.stl")
    assert seen.n_cells == len(blocks.triangles)
    got = read_mesh(tmp_path / "a.stl")
    assert corner_sets(got) == corner_sets(blocks)
    assert len(got.vertices) == len(np.unique(blocks.vertices[np.unique(blocks.triangles)], axis=0))
    assert set(got.volume) == {"model"}
    raw = np.frombuffer(
        (tmp_path / "a.stl").read_bytes()[84:], dtype="<f4,(9,)<f4,<u2".replace("<f4,(", "(3,)<f4,(", 1)
    )
    np.testing.assert_allclose(np.linalg.norm(raw["f0"], axis=1), 1, atol=1e-6)


@pytest.mark.parametrize("binary", [True, False])
def test_stl_of_vtk(tmp_path, binary):
    sphere = pv.Sphere(theta_resolution=9, phi_resolution=8)
    sphere.save(tmp_path / "a.stl", binary=binary)
    got = read_mesh(tmp_path / "a.stl")
    assert (len(got.vertices), len(got.triangles)) == (sphere.n_points, sphere.n_cells)
    area = pv.PolyData.from_regular_faces(got.vertices, got.triangles).area
    assert area == pytest.approx(sphere.area, rel=1e-5)


def test_ascii_stl_of_several_solids(tmp_path):
    facet = "  facet normal 0 0 1\n outer loop\n vertex 0 0 {z}\n vertex 1 0 {z}\n vertex 0 1 {z}\n endloop\nendfacet\n"
    solids = [("wing left", 0), ("", 1), ("wing left", 2)]
    text = "".join(f"solid {name}\n{facet.format(z=z)}endsolid {name}\n" for name, z in solids)
    (tmp_path / "a.stl").write_text(text)
    mesh = read_mesh(tmp_path / "a.stl", volumes={"wing left": "wing"})
    np.testing.assert_array_equal(mesh.volume, ["wing", "model", "wing"])
    np.testing.assert_array_equal(mesh.vertices[mesh.triangles[:, 0], 2], [0, 1, 2])
    (tmp_path / "a.stl").write_text(text.replace("1 0 1", "1 o 1"))
    with pytest.raises(FileError, match="line 14: expected a number, got 'o'"):
        read_mesh(tmp_path / "a.stl")
    (tmp_path / "a.stl").write_text(text.replace(" vertex 1 0 1\n", ""))
    with pytest.raises(FileError, match="solid at line 10: 2 corners of 6 numbers"):
        read_mesh(tmp_path / "a.stl")


def test_a_binary_stl_may_begin_with_the_word_solid(tmp_path, blocks):
    write_mesh(tmp_path / "a.stl", blocks)
    raw = (tmp_path / "a.stl").read_bytes()
    (tmp_path / "a.stl").write_bytes(b"solid facet".ljust(80) + raw[80:])
    assert corner_sets(read_mesh(tmp_path / "a.stl")) == corner_sets(blocks)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "0 bytes; expected an STL file: at least 84"),
        (b"\0" * 80 + b"\2\0\0\0" + b"\0" * 99, "183 bytes; expected an STL file: 2 triangles take 184"),
        (b"\0" * 80 + b"\xff\xff\xff\xff" + b"\0" * 99, "4294967295 triangles take 214748364834"),
        (b"\0" * 84, "no triangles"),
        (b"solid\nendsolid\n", "15 bytes; expected an STL"),
    ],
)
def test_damaged_stl(tmp_path, content, message):
    (tmp_path / "a.stl").write_bytes(content)
    with pytest.raises(FileError, match=message):
        read_mesh(tmp_path / "a.stl")


@given(arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.sampled_from([-1.0, -0.0, 0.0, 2.5])))
def test_equal_points_merge_in_order_of_use(points):
    merged, index = merge_equal(points)
    np.testing.assert_array_equal(merged[index], points)
    assert len(np.unique(merged, axis=0)) == len(merged)
    first_use = [list(index).index(k) for k in range(len(merged))]
    assert first_use == sorted(first_use)


# --- OBJ


def test_obj_comes_back_with_its_volumes(tmp_path, shell):
    write_mesh(tmp_path / "a.obj", shell, length_unit="mm")
    got = read_mesh(tmp_path / "a.obj")
    np.testing.assert_array_equal(got.vertices, shell.vertices)
    np.testing.assert_array_equal(got.triangles, shell.triangles)
    np.testing.assert_array_equal(got.volume, shell.volume)
    assert "# length unit: mm" in (tmp_path / "a.obj").read_text()
    assert pv.read(tmp_path / "a.obj").n_cells == len(shell.triangles)


def test_obj_as_other_programs_write_it(tmp_path):
    (tmp_path / "a.obj").write_bytes(
        b"# comment\r\nmtllib x.mtl\r\no body\r\nv 0 0 0\r\nv 1 0 0 1.0\r\n".replace(b" 1.0\r", b"\r")
        + b"v\t1 1 0\nv 0 1 \\\n 0\nvt 0 0\nvn 0 0 1\nusemtl red\ns off\nf 1/1/1 2/1/1 3//1 4\n"
        b"g wing left\nf -4 -3 -2\nv 5 5 5\nf 1 3 5\n"
    )
    mesh = read_mesh(tmp_path / "a.obj", volumes={"wing left": "wing"})
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [5, 5, 5]])
    np.testing.assert_array_equal(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 4]])
    np.testing.assert_array_equal(mesh.volume, ["body", "body", "wing", "wing"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "has 3 vertices but no faces"),
        ("", "has 0 vertices but no faces"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n\nf 1 2 4\n", "line 5: a face names vertex 4; the file has 3"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -4\n", "line 4: a face names vertex -4"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n", "line 4: a face names vertex 0"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2\n", "line 5: a face of fewer than three corners"),
        ("v 0 0 0\nv 1 zero 0\nv 0 1 0\nf 1 2 3\n", "line 2: expected a number, got 'zero'"),
        ("v 0 0 0\nv 1 9*0 0\nv 0 1 0\nf 1 2 3\n", r"line 2: expected a number, got '9\*0'"),
        ("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "line 1: a vertex of 2 numbers; expected at least 3"),
        ("v 0 0 0\nv 1 0\nv 0 1 0 1\nf 1 2 3\n", "line 2: a vertex of 2 numbers"),  # nine numbers in all
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf\n", "line 5: a face without numbers"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1,2,3\n", "line 4: numbers with a comma|a face of fewer than three"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 3,1\n", "line 4: numbers with a comma; expected blanks"),
        ("v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n", r"node 1 \(from 0\) is at \(1, nan, 0\)"),
    ],
)
def test_damaged_obj(tmp_path, text, message):
    (tmp_path / "a.obj").write_text(text)
    with pytest.raises(FileError, match=message):
        read_mesh(tmp_path / "a.obj")


def test_an_obj_is_read_in_pieces_as_it_is_in_one(tmp_path, shell, monkeypatch):
    write_mesh(tmp_path / "a.obj", shell)
    text = (tmp_path / "a.obj").read_bytes()
    for ends in (b"\n", b"\r\n", b"\r"):
        (tmp_path / "b.obj").write_bytes(text.replace(b"\n", ends))
        whole = read_mesh(tmp_path / "b.obj")
        with monkeypatch.context() as patch:
            patch.setattr(obj, "_PIECE", 50)
            parts = read_mesh(tmp_path / "b.obj")
            (tmp_path / "c.obj").write_bytes((text + b"f 1 2 999999\nf 1 2 3\n").replace(b"\n", ends))
            with pytest.raises(FileError, match=rf"line {text.count(10) + 1}: a face names vertex 999999"):
                read_mesh(tmp_path / "c.obj")
        for got in (whole, parts):
            np.testing.assert_array_equal(got.vertices, shell.vertices)
            np.testing.assert_array_equal(got.triangles, shell.triangles)
            np.testing.assert_array_equal(got.volume, shell.volume)


# --- PLY


@pytest.mark.parametrize("single", [True, False])
def test_ply_comes_back(tmp_path, make_mesh, single):
    mesh = make_mesh([(5, 4, 1), (1, 3, 3)], single=single)
    write_mesh(tmp_path / "a.ply", mesh, length_unit="in")
    got = read_mesh(tmp_path / "a.ply", volumes="wing")
    np.testing.assert_array_equal(got.vertices, mesh.vertices)
    np.testing.assert_array_equal(got.triangles, mesh.triangles)
    assert set(got.volume) == {"wing"}
    assert b"comment length unit: in" in (tmp_path / "a.ply").read_bytes()[:200]
    seen = pv.read(tmp_path / "a.ply")
    np.testing.assert_array_equal(seen.regular_faces, mesh.triangles)


VERTICES = [(0, 0, 0), (1, 0, 0), (1, 1, 0.5), (0, 1, 0)]
FACES = {"alike": [(0, 1, 2), (0, 2, 3)], "mixed": [(0, 1, 2, 3), (0, 1, 2)]}
HEADER = """ply
format {form} 1.0
comment colours and an element that nobody needs
element vertex 4
property float x
property double y
property float32 z
property uchar red
element camera 1
property int16 number
element face 2
property uchar flag
property list {count} int vertex_indices
end_header
"""


def ply_bytes(form, count, faces):
    head = HEADER.format(form=form, count=count).encode()
    if form == "ascii":
        lines = [f"{x} {y} {z} 200" for x, y, z in VERTICES] + ["-7"]
        return head + "\n".join([*lines, *(" ".join(map(str, [1, len(f), *f])) for f in faces)]).encode() + b"\n"
    order = "<" if "little" in form else ">"
    body = b"".join(struct.pack(order + "fdfB", *v, 200) for v in VERTICES) + struct.pack(order + "h", -7)
    for f in faces:
        body += struct.pack(f"{order}B{'B' if count == 'uchar' else 'i'}{len(f)}i", 1, len(f), *f)
    return head + body


@pytest.mark.parametrize("faces", list(FACES))
@pytest.mark.parametrize("count", ["uchar", "int"])
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_in_every_form(tmp_path, form, count, faces):
    (tmp_path / "a.ply").write_bytes(ply_bytes(form, count, FACES[faces]))
    mesh = read_mesh(tmp_path / "a.ply")
    np.testing.assert_array_equal(mesh.vertices, VERTICES)
    wanted = [[0, 1, 2], [0, 2, 3]] if faces == "alike" else [[0, 1, 2], [0, 2, 3], [0, 1, 2]]
    np.testing.assert_array_equal(mesh.triangles, wanted)


@pytest.mark.parametrize("faces", list(FACES))
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_a_ply_cut_short_is_refused_wherever_it_is_cut(tmp_path, form, faces):
    whole = ply_bytes(form, "uchar", FACES[faces])
    for end in range(len(whole) - (2 if form == "ascii" else 0)):
        (tmp_path / "a.ply").write_bytes(whole[:end])
        with pytest.raises(FileError):
            read_mesh(tmp_path / "a.ply")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"element vertex 4", b"element vertex 400", r"element vertex: 400 of them need 6800 bytes from byte 0"),
        (b"element face 2", b"element face 2000000000", r"element face: a row begins at byte \d+ behind the header"),
        (b"element face 2", b"element face 0", "has 4 points but no faces"),
        (b"property float x", b"property real x", "line 5: expected a line of a PLY header, got 'property real x'"),
        (b"property float x", b"property float u", r"element vertex: no x, y, z; it has \['u'"),
        (b"vertex_indices", b"corners", "no faces"),
        (b"format binary_little_endian", b"format binary", "expected a PLY header"),
        (b"ply\n", b"plx\n", "expected a PLY header"),
        (struct.pack("<3i", 0, 2, 3), struct.pack("<3i", 0, 2, 4), "a face names vertex 4; expected 0 to 3"),
        (struct.pack("<f", 0.5), struct.pack("<f", np.nan), r"node 2 \(from 0\) is at \(1, 1, nan\)"),
    ],
)
def test_damaged_ply(tmp_path, old, new, message):
    raw = ply_bytes("binary_little_endian", "uchar", FACES["alike"])
    assert old in raw
    (tmp_path / "a.ply").write_bytes(raw.replace(old, new, 1))
    with pytest.raises(FileError, match=message):
        read_mesh(tmp_path / "a.ply")


@pytest.mark.parametrize("name", ["a.stl", "a.obj", "a.ply"])
def test_nothing_appears_on_a_full_disk(tmp_path, make_mesh, full_disk, name):
    with full_disk(5000), pytest.raises(FileError, match="cannot be written"):
        write_mesh(tmp_path / name, make_mesh([(40, 30, 1)]))
    assert not list(tmp_path.iterdir())
