"""VTK files: written for ParaView, read from others; pyvista is the witness for what is written."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import pyvista as pv

from windmark.io import FileError, read_mesh, write_mesh, write_nodes_vtk
from windmark.io.vtk_read import read_vtk_nodes
from windmark.scene import Mesh


def values(mesh, seed=0):
    rng = np.random.default_rng(seed)
    cp = rng.normal(size=len(mesh.vertices)).astype(np.float32)
    cp[::4] = np.nan
    return {"cp": cp, "p": rng.uniform(9e4, 1.1e5, len(mesh.vertices))}


@pytest.mark.parametrize("single", [True, False])
def test_paraview_sees_nodes_values_and_names(tmp_path, make_mesh, single):
    mesh = make_mesh([(5, 4, 1), (1, 6, 3)], single=single)
    fields = values(mesh)
    write_nodes_vtk(tmp_path / "a.vtp", mesh, fields, units={"p": "Pa", "length": "in"})
    seen = pv.read(tmp_path / "a.vtp")
    assert seen.points.dtype == (np.float32 if single else np.float64)
    np.testing.assert_array_equal(seen.points, mesh.vertices)
    np.testing.assert_array_equal(seen.regular_faces, mesh.triangles)
    np.testing.assert_array_equal(seen["cp"], fields["cp"])
    np.testing.assert_array_equal(seen["p [Pa]"], fields["p"])
    assert seen["cp"].dtype == np.float32
    assert seen.field_data["length_unit"][0] == "in"
    assert seen.field_data["written_by"][0].startswith("windmark ")
    assert b'compressor="vtkZLibDataCompressor"' in (tmp_path / "a.vtp").read_bytes()


def test_vtp_round_trip_keeps_blocks_volumes_and_blanking(tmp_path, make_mesh):
    mesh = make_mesh([(5, 4, 1), (1, 6, 3), (4, 1, 7)], blanked=True, single=False)
    mesh = replace(mesh, volume=np.where(mesh.volume == "zone02", "flap", mesh.volume))
    write_mesh(tmp_path / "a.vtp", mesh)
    got = read_mesh(tmp_path / "a.vtp")
    for name in ("vertices", "triangles", "volume", "blanked"):
        np.testing.assert_array_equal(getattr(got, name), getattr(mesh, name))
    assert got.blocks == mesh.blocks


def test_vtp_keeps_triangles_turned_round(tmp_path, make_mesh):
    mesh = make_mesh([(5, 4, 1)])
    turned = replace(mesh, triangles=np.ascontiguousarray(mesh.triangles[:, ::-1]))
    write_mesh(tmp_path / "a.vtp", turned)
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.vtp").triangles, turned.triangles)


@pytest.mark.parametrize("suffix", [".vtp", ".vtk", ".vtu", ".vtm"])
def test_values_and_units_come_back(tmp_path, make_mesh, suffix):
    mesh = replace(make_mesh([(5, 4, 1), (1, 6, 3)], blanked=True))
    mesh = replace(mesh, volume=np.where(mesh.volume == "zone02", "flap ä", mesh.volume))
    fields = values(mesh)
    write_nodes_vtk(tmp_path / f"a{suffix}", mesh, fields, units={"p": "Pa", "length": "in"})
    got, found, units, left_out = read_vtk_nodes(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(got.vertices, mesh.vertices)
    np.testing.assert_array_equal(got.triangles, mesh.triangles)
    np.testing.assert_array_equal(got.volume, mesh.volume)
    np.testing.assert_array_equal(got.blanked, mesh.blanked)
    assert got.blocks == (() if suffix == ".vtu" else mesh.blocks)
    assert units == {"p": "Pa", "length": "in"}
    assert left_out == ()
    for name, column in fields.items():
        np.testing.assert_array_equal(found[name], column)
        assert found[name].dtype == column.dtype


def test_vectors_become_columns_and_the_rest_is_named(tmp_path, shell):
    surface = pv.PolyData.from_regular_faces(shell.vertices, shell.triangles)
    surface["shift [mm]"] = shell.vertices * 2
    surface["tensor"] = np.zeros((surface.n_points, 9))
    surface.cell_data["patch"] = np.arange(surface.n_cells)
    surface.save(tmp_path / "a.vtp")
    _, fields, units, left_out = read_vtk_nodes(tmp_path / "a.vtp")
    np.testing.assert_array_equal(fields["shift_y"], 2 * shell.vertices[:, 1])
    assert units == {"shift_x": "mm", "shift_y": "mm", "shift_z": "mm"}
    assert left_out == (
        "the array 'tensor', not a number or vector at every node", "the array 'patch', values at cells"
    )  # fmt: skip


def test_unstructured_round_trips(tmp_path, shell):
    write_mesh(tmp_path / "a.vtp", shell)
    got = read_mesh(tmp_path / "a.vtp")
    np.testing.assert_array_equal(got.vertices, shell.vertices)
    np.testing.assert_array_equal(got.triangles, shell.triangles)
    np.testing.assert_array_equal(got.volume, shell.volume)
    assert got.blocks == ()
    assert set(read_mesh(tmp_path / "a.vtp", volumes={"fuselage": "body"}).volume) == {"body", "wing, left"}


@pytest.mark.parametrize("blanked", [False, True])
def test_multi_block_files_are_structured_grids(tmp_path, make_mesh, blanked):
    mesh = make_mesh([(5, 4, 1), (1, 6, 3), (4, 1, 7)], blanked=blanked)
    mesh = replace(mesh, volume=np.where(mesh.volume == "zone02", "flap", mesh.volume))
    fields = values(mesh)
    write_nodes_vtk(tmp_path / "a.vtm", mesh, fields, units={"length": "mm"})
    seen = pv.read(tmp_path / "a.vtm")
    assert seen.keys() == ["zone01", "zone02", "zone03"]
    for block, piece in zip(mesh.blocks, seen, strict=True):
        nodes = slice(block.first, block.first + block.size)
        assert piece.dimensions == block.shape_ijk
        np.testing.assert_array_equal(piece.points, mesh.vertices[nodes])
        np.testing.assert_array_equal(piece["cp"], fields["cp"][nodes])
        if blanked:
            np.testing.assert_array_equal(piece["vtkGhostType"] == 2, mesh.blanked[nodes])
    got = read_mesh(tmp_path / "a.vtm")
    np.testing.assert_array_equal(got.vertices, mesh.vertices)
    np.testing.assert_array_equal(got.triangles, mesh.triangles)
    np.testing.assert_array_equal(got.volume, mesh.volume)
    assert got.blocks == mesh.blocks


def test_multi_block_files_of_triangles_are_volumes(tmp_path, shell):
    fields = values(shell)
    write_nodes_vtk(tmp_path / "a.vtm", shell, fields)
    seen = pv.read(tmp_path / "a.vtm")
    assert seen.keys() == ["fuselage", "wing, left"]
    used = np.unique(shell.triangles[shell.volume == "fuselage"])
    np.testing.assert_array_equal(seen[0]["cp"], fields["cp"][used])
    got = read_mesh(tmp_path / "a.vtm")
    np.testing.assert_array_equal(
        np.sort(got.vertices[got.triangles].reshape(-1, 9), axis=0),
        np.sort(shell.vertices[shell.triangles].reshape(-1, 9), axis=0),
    )
    assert sorted(got.volume) == sorted(shell.volume)


def test_writing_again_replaces_the_pieces(tmp_path, make_mesh):
    write_mesh(tmp_path / "a.vtm", make_mesh([(5, 4, 1)], seed=1))
    mesh = make_mesh([(5, 4, 1)], seed=2)
    write_mesh(tmp_path / "a.vtm", mesh)
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.vtm").vertices, mesh.vertices)


# --- files of others


def same_surface(got: Mesh, wanted: pv.PolyData) -> bool:
    poly = pv.PolyData.from_regular_faces(got.vertices, got.triangles)
    return poly.area == pytest.approx(wanted.area, rel=1e-6) and poly.volume == pytest.approx(wanted.volume, rel=1e-6)


@pytest.mark.parametrize("suffix", [".vtp", ".vtk", ".ply"])
@pytest.mark.parametrize("binary", [True, False])
def test_polygons_become_triangles(tmp_path, suffix, binary):
    cylinder = pv.Cylinder(resolution=7).clean()
    assert {len(face) for face in cylinder.irregular_faces} == {4, 7}
    cylinder.save(tmp_path / f"a{suffix}", binary=binary)
    got = read_mesh(tmp_path / f"a{suffix}")
    np.testing.assert_allclose(got.vertices, cylinder.points, atol=1e-6)  # text holds six digits
    assert same_surface(got, cylinder)
    assert set(got.volume) == {"model"}


def test_unstructured_grids_give_their_outside_on_the_files_nodes(tmp_path):
    solid = pv.ImageData(dimensions=(4, 3, 3)).cast_to_unstructured_grid()
    solid.save(tmp_path / "a.vtu")
    got = read_mesh(tmp_path / "a.vtu")
    np.testing.assert_array_equal(got.vertices, solid.points)
    assert same_surface(got, solid.extract_surface(algorithm="dataset_surface").triangulate())
    inside = np.setdiff1d(np.arange(len(got.vertices)), got.triangles)
    np.testing.assert_array_equal(got.vertices[inside], [[1, 1, 1], [2, 1, 1]])


def test_flat_cells_of_unstructured_grids(tmp_path):
    sheet = pv.Plane(i_resolution=3, j_resolution=2).cast_to_unstructured_grid()
    sheet.save(tmp_path / "a.vtu")
    got = read_mesh(tmp_path / "a.vtu")
    np.testing.assert_array_equal(got.vertices, sheet.points)
    assert len(got.triangles) == 12


def test_structured_grids_keep_their_block(tmp_path):
    x, y = np.meshgrid(np.arange(4.0), np.arange(3.0), indexing="ij")
    pv.StructuredGrid(x, y, x * y).save(tmp_path / "a.vts")
    got = read_mesh(tmp_path / "a.vts", volumes="wing")
    assert got.blocks[0].shape_ijk == (4, 3, 1)
    assert len(got.triangles) == 12
    assert set(got.volume) == {"wing"}


def test_solid_structured_grids_are_refused(tmp_path):
    x, y, z = np.meshgrid(np.arange(4.0), np.arange(3.0), np.arange(2.0), indexing="ij")
    pv.StructuredGrid(x, y, z).save(tmp_path / "a.vts")
    with pytest.raises(FileError, match=r"structured grid of \(4, 3, 2\) nodes is a volume"):
        read_mesh(tmp_path / "a.vts")


def test_nested_blocks_and_empty_ones(tmp_path):
    parts = pv.MultiBlock({"wing": pv.Plane(), "inner": pv.MultiBlock({"tail": pv.Sphere()}), "nothing": None})
    parts.save(tmp_path / "a.vtm")
    assert set(read_mesh(tmp_path / "a.vtm").volume) == {"wing", "tail"}


def test_clouds_and_lines_are_no_surface(tmp_path):
    pv.PolyData(np.random.default_rng(0).random((50, 3))).save(tmp_path / "cloud.vtp")
    with pytest.raises(FileError, match="has 50 points but no faces"):
        read_mesh(tmp_path / "cloud.vtp")
    pv.Line().save(tmp_path / "line.vtk")
    with pytest.raises(FileError, match="no faces"):
        read_mesh(tmp_path / "line.vtk")
    pv.ImageData(dimensions=(3, 3, 3)).save(tmp_path / "image.vtk")
    with pytest.raises(FileError, match=r"holds a vtk(StructuredPoints|ImageData)"):
        read_mesh(tmp_path / "image.vtk")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.vtp", b""),
        ("a.vtp", b'<VTKFile type="PolyData"><x>'),
        ("a.vtp", b"nothing of the kind"),
        ("a.vtm", b'<VTKFile type="vtkMultiBlockDataSet"><vtkMultiBlockDataSet><DataSet index="0" file="none.vts"/>'
                  b"</vtkMultiBlockDataSet></VTKFile>"),
        ("a.vtk", b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 3 float\n 0 0"),
    ],
)  # fmt: skip
def test_damaged_files(tmp_path, capfd, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileError, match=name):
        read_mesh(tmp_path / name)
    assert capfd.readouterr() == ("", "")  # VTK's own complaints stay off the screen


HEAD = b"# vtk DataFile Version "
LEGACY = HEAD + b"5.1\nx\n%s\nDATASET POLYDATA\nPOINTS 3 float\n0 0 0 1 0 0 0 1 0\n%s"
POLYGONS = b"POLYGONS 2 3\nOFFSETS vtktypeint64\n0 %s\nCONNECTIVITY vtktypeint64\n0 1 %s\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (HEAD + b"5.1\nx\nBINARY\nDATASET POLYDATA\nPOINTS 6\xff", r"Unsupported data type: \\xff"),
        (HEAD + b"1_0\nx\nBINARY\nDATASET POLYDATA\nFIELD FieldData 5\nwritten", "a.vtk"),
        (LEGACY % (b"ASCII", POLYGONS % (b"3", b"999999999")), "connectivity: a cell names the points 0 to 999999999"),
        (LEGACY % (b"ASCII", POLYGONS % (b"3", b"-7")), "connectivity: a cell names the points -7 to 1;"),
        (LEGACY % (b"ASCII", POLYGONS % (b"900", b"2")), "offsets: its cells end at 900 of 3 corners"),
        (LEGACY % (b"ASCII", b"POLYGONS 99999999999 3\n"), "'POLYGONS 99999999999' cannot come from 1.. bytes"),
        (LEGACY % (b"ASCII", b"POLYGONS 1 4\n3 0 1 2\nPOINT_DATA 3\nSCALARS \xe9\xff float\n"), "a.vtk"),
    ],
)  # fmt: skip
def test_files_that_ended_the_process(tmp_path, shell, content, words):
    """Within VTK, which no Python code can prevent: so it happens to another process, and is told here."""
    (tmp_path / "a.vtk").write_bytes(content)
    with pytest.raises(FileError, match=words):
        read_vtk_nodes(tmp_path / "a.vtk")
    write_mesh(tmp_path / "b.vtp", shell)
    assert len(read_mesh(tmp_path / "b.vtp").triangles) == len(shell.triangles)


def test_a_version_that_there_is_not(tmp_path):
    """VTK takes the cells for those of another version, and crashes."""
    pv.Cylinder(resolution=7).clean().save(tmp_path / "a.vtk", binary=True)
    raw = (tmp_path / "a.vtk").read_bytes()
    (tmp_path / "a.vtk").write_bytes(raw.replace(b"Version 5.1", b"Version 1_0"))
    with pytest.raises(FileError, match=r"a.vtk: "):
        read_mesh(tmp_path / "a.vtk")


@pytest.mark.slow
def test_a_file_that_never_ends(tmp_path, shell, monkeypatch):
    monkeypatch.setattr("windmark.io.apart._TIME_S", 1.0)
    write_mesh(tmp_path / "a.vtk", shell)
    raw = (tmp_path / "a.vtk").read_bytes()
    at = raw.index(b"POINTS") + 40
    (tmp_path / "a.vtk").write_bytes(raw[: at + 317] + b" " * 20_000 + raw[at + 317 :])
    with pytest.raises(FileError, match=r"a.vtk: "):
        read_mesh(tmp_path / "a.vtk")


def test_names_in_another_encoding(tmp_path, shell):
    write_nodes_vtk(tmp_path / "a.vtp", shell, {"druck": np.ones(len(shell.vertices))})
    raw = (tmp_path / "a.vtp").read_bytes()
    (tmp_path / "a.vtp").write_bytes(raw.replace(b'Name="druck"', b'Name="dr\xfcck"'))
    with pytest.raises(FileError, match=r"a.vtp: "):
        read_vtk_nodes(tmp_path / "a.vtp")


def test_truncated_files(tmp_path, make_mesh):
    write_mesh(tmp_path / "a.vtp", make_mesh([(9, 8, 1)]))
    raw = (tmp_path / "a.vtp").read_bytes()
    for part in (0.3, 0.6, 0.9, 0.98):
        (tmp_path / "b.vtp").write_bytes(raw[: int(part * len(raw))])
        with pytest.raises(FileError):
            read_mesh(tmp_path / "b.vtp")


def test_what_cannot_be_written(tmp_path, blocks):
    with pytest.raises(ValueError, match=r"must end in one of .*'\.vtp', '\.vtm'"):
        write_nodes_vtk(tmp_path / "a.vts", blocks)
    for fields, message in (
        ({"cp": np.zeros(3)}, r"'cp' must have shape \(66,\)"),
        ({"cp": np.zeros(66, complex)}, "'cp' must be real numbers"),
        ({"iblank": np.zeros(66)}, "used by the file format itself"),
        ({"": np.zeros(66)}, "is empty, padded"),
        ({"a\nb": np.zeros(66)}, "control characters"),
    ):
        with pytest.raises(ValueError, match=message):
            write_nodes_vtk(tmp_path / "a.vtp", blocks, fields)
    with pytest.raises(ValueError, match="units: 'cl' is no field"):
        write_nodes_vtk(tmp_path / "a.vtp", blocks, {"cp": np.zeros(66)}, units={"cl": "-"})
    assert not list(tmp_path.iterdir())


def test_integers_and_flags_become_floats_without_loss(tmp_path, blocks):
    big = np.arange(66) + 2**40
    write_nodes_vtk(tmp_path / "a.vtp", blocks, {"seen": np.arange(66) % 2 == 0, "big": big, "half": np.ones(66, "f2")})
    seen = pv.read(tmp_path / "a.vtp")
    assert [seen[n].dtype for n in ("seen", "big", "half")] == [np.float32, np.float64, np.float32]
    np.testing.assert_array_equal(seen["big"], big)


@pytest.mark.parametrize("name", ["a.vtp", "a.vtm"])
def test_nothing_appears_on_a_full_disk(tmp_path, make_mesh, full_disk, name):
    mesh = make_mesh([(40, 30, 1), (3, 3, 1)])
    with full_disk(5000), pytest.raises(FileError, match="cannot be written"):
        write_nodes_vtk(tmp_path / name, mesh, values(mesh))
    assert not list(tmp_path.iterdir())


def test_a_unit_that_is_no_text(tmp_path):
    surface = pv.Plane(i_resolution=2, j_resolution=2).triangulate()
    surface.field_data["length_unit"] = ["mm"]
    surface.save(tmp_path / "a.vtk", binary=False)
    assert read_mesh(tmp_path / "a.vtk").length_unit == "mm"
    content = (tmp_path / "a.vtk").read_bytes()
    assert content.count(b"\nmm\n") == 1
    (tmp_path / "a.vtk").write_bytes(content.replace(b"\nmm\n", b"\n%b2\xff\n"))
    with pytest.raises(FileError, match="is not UTF-8; expected UTF-8 text"):
        read_mesh(tmp_path / "a.vtk")
    surface.field_data["length_unit"] = [25.4]
    surface.save(tmp_path / "a.vtk")
    assert read_mesh(tmp_path / "a.vtk").length_unit == ""
