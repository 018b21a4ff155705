"""`windmark convert` with surface grids: every pair of formats, what is lost, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from windmark import io
from windmark.io import GridFile, Plot3dLayout
from windmark.scene import Block, Mesh, structured_triangles


def wing(blanked: bool = False) -> Mesh:
    """Two curved blocks, the first 7 x 5 nodes, the second a plane of constant i, in millimetres that need double."""
    first = [(7.1 * i, 11.3 * j, np.sin(0.3 * i) * 5 + 0.1 * j) for j in range(5) for i in range(7)]
    second = [(50.0, 11.3 * j, 20 + 3.7 * k) for k in range(4) for j in range(6)]
    blocks = (Block("zone01", (7, 5, 1), 0), Block("zone02", (1, 6, 4), 35))
    triangles = np.concatenate([structured_triangles(7, 5), structured_triangles(6, 4, 35)])
    volume = np.repeat(["zone01", "zone02"], [48, 30])
    hidden = np.zeros(59, dtype=bool)
    hidden[0] = True
    if not blanked:
        return Mesh(np.array(first + second), triangles, volume, blocks)
    kept = (triangles != 0).all(axis=1)
    return Mesh(np.array(first + second), triangles[kept], volume[kept], blocks, hidden)


@pytest.fixture
def grid(tmp_path):
    io.write_mesh(tmp_path / "wing.grid", wing())
    return tmp_path / "wing.grid"


@pytest.fixture
def results(tmp_path):
    """A NetCDF of node values, one of them unknown."""
    mesh = wing()
    values = np.linspace(280.0, 320.0, 59)
    values[7] = np.nan
    fields = {"temperature_K": values.astype(np.float32), "Größe": np.arange(59.0)}
    io.write_nodes_netcdf(tmp_path / "nodes.nc", mesh, fields, units={"temperature_K": "K", "length": "mm"})
    return tmp_path / "nodes.nc"


STRUCTURED = (".x", ".dat", ".vtp", ".vtm", ".vtk", ".nc")
SURFACES = (".stl", ".obj", ".ply", ".tri", ".vtu")


@pytest.mark.parametrize("suffix", STRUCTURED)
def test_structured_formats_keep_every_bit_and_the_blocks(windmark, grid, tmp_path, suffix):
    done = windmark("convert", grid, tmp_path / f"to{suffix}", "--unit", "mm", "--json")
    assert done.code == 0
    assert done.json["read_back_largest"] == 0
    assert done.json["lost"] == ([] if suffix != ".x" else ["the length unit (mm)"])
    got, want = io.read_mesh(tmp_path / f"to{suffix}"), wing()
    np.testing.assert_array_equal(got.vertices, want.vertices)
    np.testing.assert_array_equal(got.triangles, want.triangles)
    assert got.blocks == want.blocks
    again = windmark("convert", tmp_path / f"to{suffix}", tmp_path / "again.nc", *(["--unit", "mm"] * (suffix == ".x")))
    assert again.code == 0
    assert io.read_grid_file(tmp_path / "again.nc").length_unit == "mm"


@pytest.mark.parametrize("suffix", SURFACES)
def test_surfaces_keep_the_triangles_and_say_what_they_lose(windmark, grid, tmp_path, suffix):
    done = windmark("convert", grid, tmp_path / f"to{suffix}", "--unit", "mm")
    assert done.code == 0
    assert "lost: the structure of 2 blocks" in done.out
    assert ("lost: the 2 volumes (zone01, zone02)" in done.out) == (suffix in (".stl", ".ply"))
    assert ("lost: the names of the volumes (zone01, zone02 are now comp01, comp02)" in done.out) == (suffix == ".tri")
    assert ("lost: the length unit (mm)" in done.out) == (suffix in (".stl", ".tri"))
    if suffix == ".stl":
        assert "of single precision's step" in done.out
    got, want = io.read_mesh(tmp_path / f"to{suffix}"), wing()
    np.testing.assert_allclose(got.vertices[got.triangles], want.vertices[want.triangles], rtol=2**-23)


def test_a_change_of_unit_is_said(windmark, grid, tmp_path):
    done = windmark("convert", grid, tmp_path / "in.vtp", "--unit", "mm", "--to-unit", "in")
    assert "scaled by 0.03937007874, into in" in done.out
    got = io.read_grid_file(tmp_path / "in.vtp")
    assert got.length_unit == "in"
    np.testing.assert_allclose(got.mesh.vertices * 25.4, wing().vertices, rtol=1e-14)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.vtp"], "the file does not say its length unit, and VTK keeps it: give --unit"),
        (["a.stl", "--to-unit", "in"], "so --to-unit in needs --unit too"),
        (["a.stl", "--unit", "yard"], "--unit must be one of in, ft, mm, cm, m, got 'yard'"),
        (["a.stl", "--unit", "mm", "--to-unit", "km"], "--to-unit must be one of"),
        (["a.json"], "is a surface grid; the target's path must end in one of .grid"),
        (["a"], "is a surface grid; the target's path must end in one of .grid"),
        (["no/a.stl"], "does not exist"),
        (["wing.grid"], "is the source itself"),
        (["a.stl", "--volume", "wing="], "--volume: expected NAME=zone01,zone02"),
        (["a.stl", "--volume", "wing"], "wing.grid: volumes: the file has no zone wing"),
        (["a.stl", "--volume", "a=zone01", "--volume", "b=zone01"], "zone01 is in a and in b"),
        (["a.stl", "--volume", "a=zone09"], "wing.grid: volumes: the file has no zone zone09"),
        (["a.stl", "--volume-face", "kmin"], "has surfaces only; expected volume blocks"),
        (["a.stl", "--volume-face", "lmin"], "--volume-face must be one of imin"),
        (["a.stl", "--orientation", "out"], "--orientation must be one of file, auto"),
        (["a.stl", "--plot3d", "big"], "--plot3d is for PLOT3D targets"),
        (["a.grid", "--plot3d", "huge"], "--plot3d takes words of ascii"),
        (["a.grid", "--plot3d", "ascii,big"], "--plot3d: ascii and big contradict each other"),
        (["a.grid", "--plot3d", "one-block"], "--plot3d one-block: the grid has 2 blocks"),
        (["a.grid", "--from-plot3d", "ascii"], "does not fit --from-plot3d ascii; it could be: Fortran records"),
        (["a.grid", "--size", "640x480"], "--size is for camera, and"),
        (["a.grid", "--as", "wings"], "--as must be one of camera, grid, markers, pictures"),
        (["a.yml", "--as", "camera"], "wing.grid: is a surface grid, by its name; expected a camera file"),
        (["a.grid", "--values", "none.f"], "none.f: no such file"),
    ],
)  # fmt: skip
def test_refusals_write_nothing(windmark, grid, tmp_path, arguments, message):
    done = windmark("convert", grid, tmp_path / arguments[0], *arguments[1:])
    assert done.code == 2
    assert message in done.err
    assert [p.name for p in tmp_path.iterdir()] == ["wing.grid"]


@pytest.mark.parametrize(
    ("words", "layout"),
    [
        ("ascii", Plot3dLayout(text=True, real_bytes=8)),
        ("big,stream", Plot3dLayout(byte_order=">", record_mark=0, real_bytes=8)),
        ("records8,component,iblank", Plot3dLayout(record_mark=8, records="component", real_bytes=8, iblank=True)),
        ("single,plane", Plot3dLayout(real_bytes=4, records="plane")),
    ],
)
def test_layouts_of_plot3d(windmark, grid, tmp_path, words, layout):
    done = windmark("convert", grid, tmp_path / "to.grid", "--plot3d", words)
    assert done.code == 0, done.err
    assert io.detect_plot3d(tmp_path / "to.grid") == layout
    back = windmark("convert", tmp_path / "to.grid", tmp_path / "kept.grid", "--json")
    assert io.detect_plot3d(tmp_path / "kept.grid") == layout  # the source's own, unless said otherwise
    assert back.json["read_back_largest"] == 0
    assert ("of single precision's step" in done.out) == ("single" in words)


def test_blanked_nodes(windmark, tmp_path):
    io.write_mesh(tmp_path / "wing.grid", wing(blanked=True))
    assert windmark("convert", tmp_path / "wing.grid", tmp_path / "a.dat", "--unit", "m").code == 0
    np.testing.assert_array_equal(io.read_mesh(tmp_path / "a.dat").blanked, wing(blanked=True).blanked)
    done = windmark("convert", tmp_path / "wing.grid", tmp_path / "a.obj", "--unit", "m")
    assert "lost: the mark of 1 blanked nodes" in done.out
    done = windmark("convert", tmp_path / "wing.grid", tmp_path / "b.grid", "--plot3d", "no-iblank")
    assert done.code == 2
    assert "has blanked nodes, which need IBLANK" in done.err


@pytest.mark.parametrize("suffix", [".dat", ".vtp", ".vtk", ".vtu", ".vtm", ".nc"])
def test_values_go_with_the_grid(windmark, results, tmp_path, suffix):
    target = tmp_path / f"to{suffix}"
    done = windmark("convert", results, target)
    assert done.code == 0, done.err
    assert "values temperature_K, Größe" in done.out
    got, want = io.read_grid_file(target), io.read_grid_file(results)
    assert got.units == {"temperature_K": "K"}
    assert list(got.fields) == list(want.fields)
    for name in want.fields:
        np.testing.assert_allclose(got.fields[name], want.fields[name], rtol=1e-7)
    assert np.isnan(got.fields["temperature_K"][7])


def test_values_beside_plot3d(windmark, results, tmp_path):
    done = windmark("convert", results, tmp_path / "to.grid")
    assert done.code == 0
    assert (tmp_path / "to.nam").read_text(encoding="utf-8").split("\n")[0] == "temperature_K [K]"
    back = windmark(
        "convert", tmp_path / "to.grid", tmp_path / "back.nc", "--values", tmp_path / "to.f", "--unit", "mm", "--json"
    )
    assert back.json["values"] == ["temperature_K", "Größe"]
    assert io.read_grid_file(tmp_path / "back.nc").units == {"temperature_K": "K"}
    rough = windmark("convert", results, tmp_path / "single.grid", "--plot3d", "single")
    assert "lost: digits of" not in rough.out  # these values are whole numbers or single already
    lost = windmark("convert", results, tmp_path / "to.stl")
    assert "lost: the values temperature_K, Größe" in lost.out


def test_digits_of_values_that_are_lost_are_said(windmark, tmp_path):
    fields = {"cp": np.linspace(0, 1, 59) / 3}
    io.write_nodes_netcdf(tmp_path / "a.nc", wing(), fields, units={"length": "mm"})
    done = windmark("convert", tmp_path / "a.nc", tmp_path / "b.grid", "--plot3d", "single")
    assert "lost: digits of cp (off by" in done.out
    assert "lost: digits" not in windmark("convert", tmp_path / "a.nc", tmp_path / "c.grid").out
    assert "lost: digits of cp (off by" in windmark("convert", tmp_path / "a.nc", tmp_path / "d.dat").out


def test_volumes_from_zones(windmark, results, tmp_path):
    done = windmark("convert", results, tmp_path / "a.vtp", "--volume", "Flügel=zone01")
    assert "left out: zone02, which no --volume names" in done.out
    got = io.read_grid_file(tmp_path / "a.vtp")
    assert set(got.mesh.volume) == {"Flügel"}
    assert got.mesh.blocks == (Block("zone01", (7, 5, 1), 0),)
    np.testing.assert_array_equal(got.mesh.vertices, wing().vertices[:35])
    np.testing.assert_array_equal(got.fields["Größe"], np.arange(35.0))
    second = windmark("convert", results, tmp_path / "b.grid", "--volume", "fin=zone02")
    assert second.code == 0
    np.testing.assert_array_equal(io.read_mesh(tmp_path / "b.grid").vertices, wing().vertices[35:])


def test_triangles_turned_outward_are_lost_where_only_blocks_are_held(windmark, tmp_path):
    mesh = wing()
    turned = replace(mesh, triangles=np.ascontiguousarray(mesh.triangles[:, ::-1]))
    io.write_mesh(tmp_path / "a.vtp", turned)
    assert windmark("convert", tmp_path / "a.vtp", tmp_path / "b.vtu", "--unit", "m").code == 0
    done = windmark("convert", tmp_path / "a.vtp", tmp_path / "b.dat", "--unit", "m")
    assert "lost: the orientation of 78 triangles, which face the other way" in done.out


def test_orientation_auto_turns_a_closed_surface(windmark, tmp_path):
    corners = np.array([[x, y, z] for z in (0, 1.0) for y in (0, 1.0) for x in (0, 1.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]  # all inward
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)
    io.write_mesh(tmp_path / "cube.stl", Mesh.make(corners, triangles))
    call = ["convert", tmp_path / "cube.stl", tmp_path / "out.obj", "--unit", "m"]

    def volume():
        mesh = io.read_mesh(tmp_path / "out.obj")
        return float(np.sum(mesh.vertices[mesh.triangles[:, 0]] * mesh.triangle_normals())) / 6

    windmark(*call)
    before = volume()
    done = windmark(*call, "--orientation", "auto")
    assert abs(before) == pytest.approx(1)
    assert volume() == pytest.approx(1)
    assert ("turned outward: 12 of 12 triangles" in done.out) == (before < 0)


def test_damaged_sources_leave_the_older_target(windmark, grid, tmp_path):
    raw = grid.read_bytes()
    (tmp_path / "cut.grid").write_bytes(raw[: len(raw) // 2])
    (tmp_path / "a.vtp").write_text("mine")
    done = windmark("convert", tmp_path / "cut.grid", tmp_path / "a.vtp", "--unit", "mm")
    assert done.code == 2
    assert "cut.grid" in done.err
    assert (tmp_path / "a.vtp").read_text() == "mine"
    bad = wing()
    bad.vertices[3, 1] = np.nan
    io.write_plot3d(tmp_path / "nan.grid", bad)
    done = windmark("convert", tmp_path / "nan.grid", tmp_path / "a.vtp", "--unit", "mm")
    assert "expected finite coordinates" in done.err
    (tmp_path / "empty.obj").write_text("v 0 0 0\nv 1 0 0\n")
    done = windmark("convert", tmp_path / "empty.obj", tmp_path / "a.vtp", "--unit", "mm")
    assert "has 2 vertices but no faces; expected a surface" in done.err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.vtp", "cut.grid", "empty.obj", "nan.grid", "wing.grid"]


def test_a_file_that_reads_back_as_another_surface_is_not_written(monkeypatch, windmark, grid, tmp_path):
    """The check is one: a writer that moves a node is caught."""
    from windmark.pipeline import convert_grids

    write = io.write_grid_file

    def moved(path, content: GridFile, **options):
        vertices = content.mesh.vertices.copy()
        vertices[20, 2] += 0.01
        return write(path, replace(content, mesh=replace(content.mesh, vertices=vertices)), **options)

    monkeypatch.setattr(convert_grids.io, "write_grid_file", moved)
    done = windmark("convert", grid, tmp_path / "a.vtp", "--unit", "mm")
    assert done.code == 2
    assert "read back, a corner of a triangle is off by 0.01; expected the same surface" in done.err
    assert [p.name for p in tmp_path.iterdir()] == ["wing.grid"]


@pytest.mark.parametrize("name", ["nodes.nc", "s.dat", "s.obj", "s.ply", "s.tri", "s.fmt"])
def test_changed_bytes_give_a_sentence_or_a_surface(windmark, results, tmp_path, name):
    """No change of bytes ends the process or leaves half a file; what is refused is refused in one line."""
    if name != "nodes.nc":
        words = ["--plot3d", "ascii"] if name.endswith(".fmt") else []
        assert windmark("convert", results, tmp_path / name, *words).code == 0
    raw, rng = (tmp_path / name).read_bytes(), np.random.default_rng(0)
    target = tmp_path / "out.vtu"
    for k in range(10):
        changed = bytearray(raw)
        for at in rng.integers(len(raw), size=1 + k % 4):
            changed[at] = rng.integers(256)
        (tmp_path / name).write_bytes(changed)
        done = windmark("convert", tmp_path / name, target, "--unit", "mm")
        assert done.code in (0, 2)
        assert target.exists() == (done.code == 0)
        assert len(done.err.splitlines()) == (done.code == 2)
        assert not [p for p in tmp_path.iterdir() if p.name.startswith(".windmark")]
        target.unlink(missing_ok=True)
