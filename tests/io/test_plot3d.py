"""PLOT3D grids. The bytes of the files that are read are made here with `struct`, not by the writer under test."""

from __future__ import annotations

import itertools
import re
import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from windmark.io import FileError, Plot3dLayout, detect_plot3d, read_mesh, read_plot3d, write_plot3d
from windmark.scene import Mesh

SHAPES = {
    "one": [(5, 4, 1)],
    "three": [(5, 4, 1), (1, 6, 3), (4, 1, 7)],
    "equal": [(3, 3, 1), (3, 3, 1)],
    "line and patch": [(5, 1, 1), (4, 4, 1)],
    "one node": [(1, 1, 1)],
}
LAYOUTS = [
    Plot3dLayout(False, order, mark, records, real, iblank, multi)
    for order, mark, records, real, iblank, multi in itertools.product(
        "<>", (0, 4, 8), ("whole", "component", "plane"), (4, 8), (False, True), (False, True)
    )
    if mark or records == "whole"
]
LAYOUTS += [Plot3dLayout(text=True, iblank=ib, multi_block=mb) for ib in (False, True) for mb in (False, True)]


def grid_bytes(mesh: Mesh, layout: Plot3dLayout) -> bytes:
    """The file, number by number."""
    dims = [b.shape_ijk for b in mesh.blocks]
    if layout.text:
        lines = [str(len(dims))] * layout.multi_block + [" ".join(map(str, d)) for d in dims]
        for b in mesh.blocks:
            nodes = range(b.first, b.first + b.size)
            lines += [repr(float(mesh.vertices[n, axis])) for axis in range(3) for n in nodes]
            lines += [str(0 if mesh.blanked[n] else 1) for n in nodes] if layout.iblank else []
        return "\n".join(lines).encode()
    order, real = layout.byte_order, "f" if layout.real_bytes == 4 else "d"

    def record(payload: bytes) -> bytes:
        mark = struct.pack(order + {0: "", 4: "i", 8: "q"}[layout.record_mark], *[len(payload)][: layout.record_mark])
        return mark + payload + mark

    out = record(struct.pack(order + "i", len(dims))) if layout.multi_block else b""
    out += record(b"".join(struct.pack(order + "3i", *d) for d in dims))
    for b in mesh.blocks:
        nodes = np.arange(b.first, b.first + b.size)
        planes = np.split(nodes, b.shape_ijk[2]) if layout.records == "plane" else [nodes]
        for plane in planes:
            pieces = [struct.pack(f"{order}{len(plane)}{real}", *mesh.vertices[plane, axis]) for axis in range(3)]
            if layout.iblank:
                pieces.append(struct.pack(f"{order}{len(plane)}i", *(0 if mesh.blanked[n] else 1 for n in plane)))
            out += b"".join(map(record, pieces)) if layout.records == "component" else record(b"".join(pieces))
    return out


def name(layout: Plot3dLayout) -> str:
    return layout.words.replace(" ", "-")


@pytest.mark.parametrize("layout", LAYOUTS, ids=name)
def test_every_layout_is_found_and_read(tmp_path, make_mesh, layout):
    path = tmp_path / "grid.g"
    for key, shapes in SHAPES.items():
        if len(shapes) > 1 and not layout.multi_block:
            continue
        mesh = make_mesh(shapes, blanked=layout.iblank, single=layout.real_bytes == 4)
        if layout.iblank and mesh.blanked.all():
            continue
        path.write_bytes(grid_bytes(mesh, layout))
        got, found = read_plot3d(path), detect_plot3d(path)
        np.testing.assert_array_equal(got.vertices, mesh.vertices, err_msg=key)
        np.testing.assert_array_equal(got.triangles, mesh.triangles, err_msg=key)
        assert got.blocks == mesh.blocks
        assert (got.blanked is None) == (not layout.iblank)
        if layout.iblank:
            np.testing.assert_array_equal(got.blanked, mesh.blanked)
        if layout.text:
            assert (found.text, found.iblank, found.multi_block) == (True, layout.iblank, layout.multi_block)
        elif layout.records != "plane" or any(s[2] > 1 for s in shapes):  # one plane per block is the whole block
            assert found == layout


@pytest.mark.parametrize("layout", LAYOUTS, ids=name)
def test_what_is_written_is_the_format(tmp_path, make_mesh, layout):
    shapes = SHAPES["three"] if layout.multi_block else [(1, 5, 4)]
    mesh = make_mesh(shapes, blanked=layout.iblank, single=layout.real_bytes == 4)
    write_plot3d(tmp_path / "grid.g", mesh, layout=layout)
    if layout.text:
        np.testing.assert_allclose(read_plot3d(tmp_path / "grid.g").vertices, mesh.vertices, rtol=1e-8)
    else:
        assert (tmp_path / "grid.g").read_bytes() == grid_bytes(mesh, layout)


def surface_shapes(most=7):
    sizes = st.tuples(st.integers(1, most), st.integers(1, most))
    flat = st.integers(0, 2)
    return st.builds(lambda ab, axis: (*ab[:axis], 1, *ab[axis:]), sizes, flat)


@settings(max_examples=60, deadline=None)
@given(
    shapes=st.lists(surface_shapes(), min_size=1, max_size=4),
    layout=st.sampled_from([x for x in LAYOUTS if x.multi_block and not x.text]),
)
def test_any_surface_in_any_layout_comes_back(one_folder, make_mesh, shapes, layout):
    assume(shapes != [(1, 1, 1)])  # a file of one node says too little to tell its layout
    path = one_folder / "grid.x"
    mesh = make_mesh(shapes, blanked=layout.iblank, single=layout.real_bytes == 4)
    write_plot3d(path, mesh, layout=layout)
    got = read_plot3d(path)
    np.testing.assert_array_equal(got.vertices, mesh.vertices)
    np.testing.assert_array_equal(got.triangles, mesh.triangles)
    assert got.blocks == mesh.blocks


def test_default_layout_keeps_coordinates_exactly(tmp_path, make_mesh):
    for single, blanked in itertools.product((True, False), (True, False)):
        mesh = make_mesh(SHAPES["three"], single=single, blanked=blanked)
        write_plot3d(tmp_path / "a.grid", mesh)
        found = detect_plot3d(tmp_path / "a.grid")
        assert found == Plot3dLayout(real_bytes=4 if single else 8, iblank=blanked)
        np.testing.assert_array_equal(read_mesh(tmp_path / "a.grid").vertices, mesh.vertices)


def test_double_text_keeps_seventeen_digits(tmp_path, make_mesh):
    mesh = make_mesh(SHAPES["three"], single=False)
    write_plot3d(tmp_path / "a.grid", mesh, layout=Plot3dLayout(text=True, real_bytes=8))
    assert detect_plot3d(tmp_path / "a.grid").real_bytes == 8
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.grid").vertices, mesh.vertices)


# --- text as Fortran writes it


def test_text_with_repeats_exponents_commas_and_blank_lines(tmp_path):
    (tmp_path / "a.fmt").write_bytes(
        b"  1\r\n\r\n  2, 2\t1\r\n 2*0.0, 1.5D+00 1.5d0\r\n 0. .25E1, 0.0\r\n\r\n 2.5q0\r\n 0.1-101 3*-7.0\r\n\r\n"
    )
    mesh = read_mesh(tmp_path / "a.fmt")
    np.testing.assert_array_equal(mesh.vertices[:, 0], [0, 0, 1.5, 1.5])
    np.testing.assert_array_equal(mesh.vertices[:, 1], [0, 2.5, 0, 2.5])
    np.testing.assert_array_equal(mesh.vertices[:, 2], [0.1e-101, -7, -7, -7])


def test_a_repeat_count_takes_no_memory_before_it_is_checked(tmp_path):
    (tmp_path / "a.g").write_text("1\n2 2 1\n900000000000*0.5\n")
    with pytest.raises(FileError, match="900000000004 numbers"):
        read_mesh(tmp_path / "a.g")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("this is no grid\n", "line 1: expected a number, got 'this'"),
        ("1\n2 2 1\n0. 1. 0. 1. 0. O. 1. 1. 4*0.", "line 3: expected a number, got 'O.'"),
        ("1\n2 2 1\n0. 1. 0. 1. 0. 0. 1. 1. -2*0.", r"line 3: expected a number, got '-2\*0.'"),
        ("1\n3 2 1\n6*0.5 6*1.5 3*0.", "3 x 2 x 1.*needs 18 numbers from number 4, the file ends at 19"),
        ("1\n2 2 1\n0. 1. 0. 1. 0. 0. 1. 1. 5*0.", "is 16 numbers, but the file goes on to 17"),
        ("0 0 0\n1 0 0\n1 1 0\n", "not a PLOT3D grid file: no reading .* its 9 numbers"),
        ("1\n2 2 1\n0. 1. 0. 1. 0. 0. 1. 1. 4*0. 1 1 1 .5", "IBLANK of node 3"),
        # One number is missing at the end; the sizes fit one block of (1, 2, 2) nodes, which begins with the count 1.
        ("1\n2 2 1\n0. 1. 0. 1. 0. 0. 1. 1. 3*0.", "1 block declared.* needs 12 numbers from number 4, .* ends at 15"),
    ],
)
def test_text_that_is_no_grid(tmp_path, text, message):
    (tmp_path / "a.xyz").write_text(text)
    with pytest.raises(FileError, match=message):
        read_mesh(tmp_path / "a.xyz")


def test_one_block_without_count_may_begin_at_one(tmp_path):
    """The real block (1, 2, 2) at x = 1, which the rule against a missing number must not refuse."""
    (tmp_path / "a.xyz").write_text("1 2 2\n1 1 1 1\n0 1 0 1\n0 0 1 1\n")
    mesh = read_mesh(tmp_path / "a.xyz")
    assert mesh.blocks[0].shape_ijk == (1, 2, 2)
    np.testing.assert_array_equal(mesh.vertices[:, 0], 1)


# --- damaged binary files


@pytest.fixture
def fortran(make_mesh):
    """A Fortran file of three blocks: counts at 0, sizes at 12, records of 240, 216 and 336 bytes from 56 on."""
    mesh = make_mesh(SHAPES["three"])
    return grid_bytes(mesh, Plot3dLayout())


def changed(raw: bytes, at: int, value: int) -> bytes:
    return raw[:at] + struct.pack("<i", value) + raw[at + 4 :]


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda b: b"", "the file is empty"),
        (lambda b: b[:30], "3 blocks declared; expected a record of 36 bytes .* from byte 12, the file ends at 30"),
        (lambda b: b[:58], "block 1 of 3 .*240 bytes .single precision.* or 480 .* from byte 56, the file ends at 58"),
        (
            lambda b: b[:400],
            "block 2 of 3 .1 x 6 x 3.: expected a record of 216 bytes .* byte 304, the file ends at 400",
        ),
        (
            lambda b: b[:-1],
            "block 3 of 3 .4 x 1 x 7.: expected a record of 336 bytes .* byte 528, the file ends at 871",
        ),
        (lambda b: b + b"12345", "the last block ends at byte 872, but the file goes on to 877"),
        (lambda b: changed(b, 4, 4), "4 blocks declared; expected a record of 48 bytes .* got 36"),
        (lambda b: changed(b, 16, 6), "block 1 of 3 .6 x 4 x 1.: the record at byte 56 says 240 bytes; expected 288"),
        (lambda b: changed(b, 16, 2**31 - 1), "the record at byte 56 says 240 bytes; expected 103079215056"),
        (lambda b: changed(b, 304, 7), "block 2 of 3 .*: the record at byte 304 says 7 bytes; expected 216"),
        (lambda b: changed(b, 300, 7), "block 1 of 3 .*: the record at byte 56 is damaged"),
        (lambda b: bytes(1000), "not a PLOT3D grid file"),
        (lambda b: np.random.default_rng(5).bytes(5000), "not a PLOT3D grid file"),
    ],
)
def test_damaged_fortran_files_say_where(tmp_path, fortran, damage, message):
    (tmp_path / "a.grid").write_bytes(damage(fortran))
    with pytest.raises(FileError, match=message):
        read_mesh(tmp_path / "a.grid")


@pytest.mark.parametrize("real", [4, 8])
def test_every_truncation_is_refused(tmp_path, make_mesh, real):
    """No shorter file is taken for another grid, wherever it is cut."""
    for mark, multi in itertools.product((0, 4, 8), (False, True)):
        layout = Plot3dLayout(record_mark=mark, real_bytes=real, multi_block=multi)
        whole = grid_bytes(make_mesh([(3, 2, 1)]), layout)
        for end in range(len(whole)):
            (tmp_path / "a.grid").write_bytes(whole[:end])
            with pytest.raises(FileError):
                read_mesh(tmp_path / "a.grid")


def test_half_a_double_stream_is_no_single_one(tmp_path, make_mesh):
    raw = grid_bytes(make_mesh([(30, 20, 1)], single=False), Plot3dLayout(record_mark=0, real_bytes=8))
    (tmp_path / "a.grid").write_bytes(raw[: 16 + 30 * 20 * 12])
    with pytest.raises(FileError, match=r"fits C stream.*single precision.*, but \d+% of the numbers"):
        read_mesh(tmp_path / "a.grid")


def test_a_truncated_stream_says_where(tmp_path, make_mesh):
    raw = grid_bytes(make_mesh(SHAPES["three"]), Plot3dLayout(record_mark=0))
    (tmp_path / "a.grid").write_bytes(raw[:-7])
    with pytest.raises(FileError, match=r"block 3 of 3.*is 832 bytes; this one needs 336 bytes from byte 496.*at 825"):
        read_mesh(tmp_path / "a.grid")


def test_declared_sizes_allocate_nothing(tmp_path, make_mesh):
    raw = grid_bytes(make_mesh([(4, 3, 1)]), Plot3dLayout(record_mark=0))
    for value, at in itertools.product((2**31 - 1, 10**8, -5), (0, 4, 8, 12)):
        (tmp_path / "a.grid").write_bytes(changed(raw, at, value))
        with pytest.raises(FileError):
            read_mesh(tmp_path / "a.grid")


def test_a_two_dimensional_grid_is_named(tmp_path):
    def record(payload):
        return struct.pack("<i", len(payload)) + payload + struct.pack("<i", len(payload))

    raw = record(struct.pack("<i", 1)) + record(struct.pack("<2i", 3, 2)) + record(bytes(48))
    (tmp_path / "a.grid").write_bytes(raw)
    with pytest.raises(FileError, match="two-dimensional"):
        read_mesh(tmp_path / "a.grid")


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(FileError, match="no such file"):
        read_mesh(tmp_path / "none.grid")
    with pytest.raises(FileError, match="folder"):
        read_mesh(tmp_path)


# --- several layouts fit


def test_numbers_decide_between_layouts_of_one_size(tmp_path, make_mesh):
    """Two blocks (a*b = 8, c*d = 12) are as long as one of 2 x a x b nodes with IBLANK, as a stream."""
    mesh = make_mesh([(4, 2, 1), (4, 3, 1)])
    layout = Plot3dLayout(record_mark=0)
    raw = grid_bytes(mesh, layout)
    assert len(raw) == 28 + 12 * 20 == 12 + 16 * 16
    (tmp_path / "a.grid").write_bytes(raw)
    found = detect_plot3d(tmp_path / "a.grid")
    assert found == layout
    assert "one block without a count" in found.note
    assert "absurd" in found.note
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.grid").vertices, mesh.vertices)


def volume_grid(shape):
    i, j, k = np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")
    return np.stack([c.ravel(order="F") for c in (i + 0.1 * j, 0.5 * j, 0.3 * k + 0.02 * i)]).astype("<f4")


@pytest.mark.parametrize("planes", [False, True])
def test_smoothness_decides_between_planes_and_coordinates(tmp_path, planes):
    """A volume of three planes: as many records of the same size for planes as for coordinates."""
    xyz = volume_grid((9, 8, 3))
    parts = [xyz[:, s].tobytes() for s in np.split(np.arange(216), 3)] if planes else [c.tobytes() for c in xyz]
    records = [struct.pack("<i", 1), struct.pack("<3i", 9, 8, 3), *parts]
    raw = b"".join(struct.pack("<i", len(r)) + r + struct.pack("<i", len(r)) for r in records)
    (tmp_path / "a.grid").write_bytes(raw)
    found = detect_plot3d(tmp_path / "a.grid")
    assert found.records == ("plane" if planes else "component")
    assert "times farther apart" in found.note
    mesh = read_plot3d(tmp_path / "a.grid", volume_face="kmax")
    np.testing.assert_array_equal(mesh.vertices.T, xyz[:, -72:])


def test_undecidable_files_name_their_layouts_and_take_the_users(tmp_path):
    """All coordinates equal: nothing tells planes from coordinates."""
    records = [struct.pack("<i", 1), struct.pack("<3i", 2, 2, 3), *[np.full(12, 2.5, "<f4").tobytes()] * 3]
    raw = b"".join(struct.pack("<i", len(r)) + r + struct.pack("<i", len(r)) for r in records)
    (tmp_path / "a.grid").write_bytes(raw)
    with pytest.raises(FileError, match=r"more than one layout: .*one record per (plane|coordinate).*layout="):
        detect_plot3d(tmp_path / "a.grid")
    mesh = read_plot3d(tmp_path / "a.grid", volume_face="kmin", layout=Plot3dLayout(records="plane"))
    assert len(mesh.vertices) == 4


def test_a_layout_that_does_not_fit_is_refused(tmp_path, fortran):
    (tmp_path / "a.grid").write_bytes(fortran)
    with pytest.raises(FileError, match=r"big-endian.* it fits: Fortran .*little-endian"):
        read_plot3d(tmp_path / "a.grid", layout=Plot3dLayout(byte_order=">"))


# --- nodes and triangles


def test_blanked_nodes_are_in_no_triangle_and_may_hold_anything(tmp_path, make_mesh):
    mesh = make_mesh(SHAPES["three"])
    blanked = np.zeros(len(mesh.vertices), dtype=bool)
    blanked[[6, 30]] = True
    xyz = mesh.vertices.copy()
    xyz[6], xyz[30] = np.nan, 1e30
    write_plot3d(tmp_path / "a.grid", replace(mesh, vertices=xyz, blanked=blanked))
    got = read_mesh(tmp_path / "a.grid")
    np.testing.assert_array_equal(got.blanked, blanked)
    gone = np.isin(mesh.triangles, [6, 30]).any(axis=1)
    np.testing.assert_array_equal(got.triangles, mesh.triangles[~gone])
    assert gone.sum() == 12
    assert np.isfinite(got.diagonal)


def test_nodes_in_use_must_be_finite(tmp_path, make_mesh):
    mesh = make_mesh(SHAPES["three"])
    for value in (np.nan, np.inf, 1e30):
        mesh.vertices[20 + 7, 1] = value
        write_plot3d(tmp_path / "a.grid", mesh)
        there = re.escape(f"{value:g}")
        with pytest.raises(FileError, match=rf"zone02: node i=0, j=1, k=1 \(from 0\) is at \(.*{there}, "):
            read_mesh(tmp_path / "a.grid")


def test_collapsed_cells_give_no_triangles(tmp_path, make_mesh):
    """A cap whose first row is one point (a pole), and a cell collapsed to a line."""
    mesh = make_mesh([(6, 5, 1)])
    grid = mesh.vertices.reshape(5, 6, 3)
    grid[0] = grid[0, 0]
    grid[4, 5] = grid[4, 4]
    write_plot3d(tmp_path / "a.grid", mesh)
    got = read_mesh(tmp_path / "a.grid")
    assert len(got.vertices) == 30
    assert len(got.triangles) == 2 * 5 * 4 - 5 - 1
    assert (np.linalg.norm(got.triangle_normals(), axis=1) > 0).all()
    np.testing.assert_array_equal(np.setdiff1d(got.triangles, np.arange(30)), [])


def test_a_small_model_is_not_taken_for_lines(tmp_path, make_mesh):
    """A cell's area is compared with its own size: micrometres in metres are a surface."""
    mesh = make_mesh([(6, 5, 1)], single=False)
    mesh.vertices[:] = mesh.vertices * 1e-9 + 5.0
    write_plot3d(tmp_path / "a.grid", mesh)
    assert len(read_mesh(tmp_path / "a.grid").triangles) == len(mesh.triangles)


def test_normals_are_fast_cross_slow(tmp_path, make_mesh):
    for shape in ((4, 3, 1), (1, 4, 3), (4, 1, 3)):
        mesh = make_mesh([shape])
        np.testing.assert_array_less(0, mesh.triangle_normals()[:, 2])  # x grows with the fast index, y with the slow


@pytest.mark.parametrize("left_handed", [False, True])
@pytest.mark.parametrize("face", ["imin", "imax", "jmin", "jmax", "kmin", "kmax"])
def test_a_face_of_a_volume_looks_into_the_block(tmp_path, face, left_handed):
    shape = (5, 4, 3)
    xyz = volume_grid(shape)
    if left_handed:
        xyz[0] *= -1
    path = tmp_path / "a.grid"
    path.write_bytes(struct.pack("<4i", 1, *shape) + xyz.tobytes())
    with pytest.raises(FileError, match=r"block 1 of 1 .5 x 4 x 3.: is a volume.*volume_face='kmin'"):
        read_mesh(path)
    mesh = read_mesh(path, volume_face=face)
    axis, at = "ijk".index(face[0]), 0 if face.endswith("min") else -1
    wanted = np.take(xyz.reshape(3, 3, 4, 5), at, axis=3 - axis).reshape(3, -1).T
    np.testing.assert_array_equal(mesh.vertices, wanted)
    assert mesh.blocks[0].shape_ijk == tuple(1 if k == axis else n for k, n in enumerate(shape))
    to_middle = xyz.mean(axis=1) - mesh.vertices[mesh.triangles[:, 0]]
    assert (np.sum(mesh.triangle_normals() * to_middle, axis=1) > 0).all()


def test_volumes_are_the_zones_or_what_is_asked(tmp_path, fortran):
    path = tmp_path / "a.grid"
    path.write_bytes(fortran)
    assert set(read_mesh(path).volume) == {"zone01", "zone02", "zone03"}
    assert set(read_mesh(path, volumes="model").volume) == {"model"}
    mesh = read_mesh(path, volumes={"zone01": "wing", "zone03": "wing"})
    assert set(mesh.volume) == {"wing", "zone02"}
    assert [b.name for b in mesh.blocks] == ["zone01", "zone02", "zone03"]
    with pytest.raises(ValueError, match=r"volumes: the file has no zone zone09"):
        read_mesh(path, volumes={"zone09": "wing"})
    with pytest.raises(ValueError, match=r"volume_face: .* has surfaces only"):
        read_mesh(path, volume_face="kmin")
    with pytest.raises(ValueError, match="volume_face must be one of"):
        read_mesh(path, volume_face="top")


def test_more_than_99_zones_sort_by_name(tmp_path, make_mesh):
    write_plot3d(tmp_path / "a.grid", make_mesh([(2, 2, 1)] * 101))
    names = [b.name for b in read_mesh(tmp_path / "a.grid").blocks]
    assert names == sorted(names)
    assert names[0] == "zone001"


# --- writing


def test_what_cannot_be_written(tmp_path, make_mesh, shell):
    path = tmp_path / "a.grid"
    with pytest.raises(ValueError, match="needs structured blocks"):
        write_plot3d(path, shell)
    with pytest.raises(ValueError, match="blanked nodes"):
        write_plot3d(path, make_mesh(SHAPES["three"], blanked=True), layout=Plot3dLayout())
    with pytest.raises(ValueError, match="3 blocks need multi_block"):
        write_plot3d(path, make_mesh(SHAPES["three"]), layout=Plot3dLayout(multi_block=False))
    assert not list(tmp_path.iterdir())


def test_a_layout_is_checked():
    with pytest.raises(ValueError, match="record_mark must be one of"):
        Plot3dLayout(record_mark=5)
    with pytest.raises(ValueError, match="needs record marks"):
        Plot3dLayout(record_mark=0, records="plane")
    assert Plot3dLayout(note="a") == Plot3dLayout(note="b")


def test_a_file_that_cannot_be_finished_leaves_the_old_one(tmp_path, make_mesh, full_disk):
    path = tmp_path / "a.grid"
    write_plot3d(path, make_mesh([(3, 3, 1)]))
    before = path.read_bytes()
    with full_disk(2000), pytest.raises(FileError, match="cannot be written"):
        write_plot3d(path, make_mesh([(40, 30, 1)]))
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.grid"]
