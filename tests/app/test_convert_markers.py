"""`windmark convert` with marker tables, and what it takes a file for."""

import numpy as np
import pytest

from windmark import io
from windmark.pipeline.convert_kind import kind_of
from windmark.scene import MarkerSet


@pytest.fixture
def table(tmp_path):
    markers = MarkerSet.make(
        ["W01", "Flügel 2", "st01", "tap:st01", "v1"],
        [[1.1, 2.2, 3.3], [1 / 3, 0, 5], [0, 1, 2], [7, 8, 9], [1e-7, 0, 1e7]],
        sigma=[[0.1, 0.1, 0.1], *[[np.nan] * 3] * 4],
        radius=[2.0, np.nan, 1.5, 0.3, np.nan],
        normal=[[0, 0, 1], [np.nan] * 3, [0.6, 0, 0.8], [0, 1, 0], [np.nan] * 3],
        volume=["wing", "wing", "model", "model", "model"],
        role=["model", "wall", "model", "tap", "virtual"],
    )
    io.write_markers(tmp_path / "m.csv", markers)
    return tmp_path / "m.csv"


def test_there_and_back(windmark, table, tmp_path):
    done = windmark("convert", table, tmp_path / "m.tgts", "--unit", "mm")
    assert done.code == 0
    assert "5 markers (2 model, 1 tap, 1 virtual, 1 wall), 3 with normal, 3 with radius" in done.out
    for what in ("the markers' sigmas", "the volumes (model, wing)", "the role wall of 1 markers"):
        assert f"lost: {what}" in done.out
    text = (tmp_path / "m.tgts").read_text(encoding="utf-8")
    assert "# length unit: mm" in text
    assert [line for line in text.splitlines() if line.startswith("*")] == ["*Targets", "*Taps", "*Virtuals"]
    assert "1 7.0 8.0 9.0 0.0 1.0 0.0 0.6 0 0 0 st01" in text  # a diameter, and the role in front is the reader's
    back = windmark("convert", tmp_path / "m.tgts", tmp_path / "back.csv", "--json")
    assert back.code == 0
    assert back.json["length_unit"] == "mm"
    assert "zone, i and j, the entries' places in the grid file" in back.json["lost"]
    want, got = io.read_markers(table, roles=None), io.read_markers(tmp_path / "back.csv", roles=None)
    for name in ("name", "xyz", "radius", "normal"):
        np.testing.assert_array_equal(getattr(got, name), getattr(want, name))
    assert got.role.tolist() == ["model", "model", "model", "tap", "virtual"]
    assert io.read_marker_unit(tmp_path / "back.csv") == "mm"


def test_units(windmark, table, tmp_path):
    done = windmark("convert", table, tmp_path / "in.csv", "--unit", "mm", "--to-unit", "in", "--json")
    assert done.json["scale"] == 1 / 25.4
    got, want = io.read_markers(tmp_path / "in.csv", roles=None), io.read_markers(table, roles=None)
    for name in ("xyz", "radius", "sigma"):
        np.testing.assert_allclose(getattr(got, name) * 25.4, getattr(want, name), rtol=1e-14)
    np.testing.assert_array_equal(got.normal, want.normal)
    assert done.json["lost"] == []
    twice = windmark("convert", tmp_path / "in.csv", tmp_path / "x.tgts", "--unit", "mm")
    assert twice.code == 2
    assert "the length unit is in; expected mm, as --unit says" in twice.err
    unknown = windmark("convert", table, tmp_path / "u.tgts")
    assert "nothing says the length unit: --unit writes it" in unknown.out
    assert "needs --unit too" in windmark("convert", table, tmp_path / "u.tgts", "--to-unit", "m").err


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("name,x,y,z\n", "no markers; the table has no rows"),
        ("name,x,y,z\nA,1,2,3\nA,4,5,6\n", "line 3: the name 'A' is already on line 2"),
        ("name,x,y,z\nA,1,2,nan\n", "line 2: z is 'nan'; expected a finite number"),
        ("name,x,y,z\nA  B,1,2,3\n", "must not be empty, nor have double or outer spaces: 'A  B'"),
        ("# length unit: mm\n# length unit: in\nname,x,y,z\nA,1,2,3\n", "says the length unit more than once: in, mm"),
        ("# length unit: miles\nname,x,y,z\nA,1,2,3\n", "the length unit is 'miles'; expected one of in, ft"),
    ],
)
def test_bad_tables(windmark, tmp_path, content, message):
    (tmp_path / "m.csv").write_text(content)
    done = windmark("convert", tmp_path / "m.csv", tmp_path / "m.tgts")
    assert done.code == 2
    assert message in done.err
    assert not (tmp_path / "m.tgts").exists()


TECPLOT = 'TITLE = "a"\nVARIABLES = "x" "y" "z"\nZONE I=2, J=2, K=1, F=POINT\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n'
PLOT3D = "1\n2 2 1\n0. 1. 0. 1.\n0. 0. 1. 1.\n0. 0. 0. 0.\n"


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("a.dat", TECPLOT, "grid"),
        ("a.dat", PLOT3D, "grid"),
        ("a.txt", PLOT3D, "grid"),
        ("a.dat", "name\tx\ty\tz\nA\t1\t2\t3\n", "markers"),
        ("a.txt", "# targets\nname;x;y;z\nA;1;2;3\n", "markers"),
        ("a", "Name,X,Y,Z\nA,1,2,3\n", "markers"),
        ("a.json", "{}", "camera"),
        ("a.xml", "<calibration/>", "camera"),
        ("a.tgts", "", "markers"),
        ("a.txt", "c 10\nxp 0.1\nyp 0\n", "camera"),
        ("a.txt", "# Camera list\n1 PINHOLE 640 480 500 500 320 240\n", "camera"),
    ],
)
def test_what_a_file_is(tmp_path, name, content, kind):
    (tmp_path / name).write_text(content)
    assert kind_of(tmp_path / name) == kind


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", "image,x,y,merit\np,1,2,0.3\n", "is a table of detections, which is not converted"),
        ("a.csv", "image,name,x,y,dx,dy\n", "is a table of matches, which is not converted"),
        ("a.csv", "node,x [mm],y [mm],z [mm],value\n", "is a table of node values, which is not converted"),
        ("a.toml", 'title = "a"\nlength_unit = "mm"\n', "is text of no known form"),
        ("a.dat", "1 0.5 0.5 3\n2 1 2 3\n", "is a table of 4 numbers per line without a header"),
        ("a.txt", "*Targets\n", "a targets file; name it .tgts"),
        ("a.bin", "\0\1\2\3", "is binary, and no PLOT3D grid"),
        ("a.csv", " \n", "is empty"),
    ],
)
def test_what_is_none(windmark, tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    done = windmark("convert", tmp_path / name, tmp_path / "out.csv")
    assert done.code == 2
    assert message in done.err


def test_an_open_question_is_asked(windmark, tmp_path):
    """Sixteen numbers in each of four lines: a grid of one block of 20 nodes, or a picture."""
    numbers = [*["1", "20", "1", "1"], *["1.0"] * 60]
    (tmp_path / "open.csv").write_text("\n".join(",".join(numbers[k : k + 16]) for k in range(0, 64, 16)) + "\n")
    done = windmark("convert", tmp_path / "open.csv", tmp_path / "a.tif")
    assert done.code == 2
    assert "could be a surface grid or pictures; say which with --as grid or --as pictures" in done.err
    assert windmark("convert", tmp_path / "open.csv", tmp_path / "a.tif", "--as", "pictures").code == 0
    assert io.read_image(tmp_path / "a.tif").shape == (4, 16)


def test_pictures_become_recordings(windmark, tmp_path):
    rng = np.random.default_rng(0)
    for name in ("a", "b"):
        io.write_image(tmp_path / f"{name}.tif", rng.integers(0, 4000, (24, 32)).astype(np.uint16))
    done = windmark("convert", tmp_path / "a.tif", tmp_path / "b.tif", tmp_path / "run.h5")
    assert done.code == 0, done.err
    assert "written:" in done.out
    assert "2 frames: every pixel is the same" in done.out
    second = windmark("convert", tmp_path / "run.h5[1]", tmp_path / "one.png", "--json")
    assert second.json["kind"] == "pictures"
    np.testing.assert_array_equal(io.read_image(tmp_path / "one.png"), io.read_image(tmp_path / "b.tif"))
    first = windmark("convert", tmp_path / "run.h5", tmp_path / "pictures", "--frames", "0", "--pictures", "png")
    assert first.code == 0, first.err
    assert sorted(p.name for p in (tmp_path / "pictures").iterdir()) == ["manifest.json", "run-000000.png"]
    for target, options, message in (
        ("a.stl", [], "holds pictures; the target's path must end in one of .tif"),
        ("c.tif", ["--unit", "mm"], "--unit is for camera, grid, markers, and"),
        ("a.tif", [], "is the source itself"),
    ):
        done = windmark("convert", tmp_path / "a.tif", tmp_path / target, *options)
        assert done.code == 2
        assert message in done.err


def test_wrong_pairs_and_numbers_of_files(windmark, table, tmp_path):
    done = windmark("convert", table, tmp_path / "a.stl")
    assert done.code == 2
    assert "is a table of markers; the target's path must end in one of .csv, .tgts" in done.err
    done = windmark("convert", table, table, tmp_path / "a.tgts")
    assert "several sources must all be pictures" in done.err
    assert "needs a source and a target" in windmark("convert", table).err
    assert "no such file" in windmark("convert", tmp_path / "none.csv", tmp_path / "a.tgts").err
    assert windmark("convert", table, tmp_path / "a.tgts", "--orientation", "auto").code == 2
    assert [p.name for p in tmp_path.iterdir()] == ["m.csv"]


def test_a_table_of_another_program_by_the_names_of_its_columns(windmark, tmp_path):
    (tmp_path / "list.txt").write_text("made elsewhere\nP X Y Z rays\nT1 0,5 400 -2,25 12\nT2 100 0 7 9\n")
    bare = windmark("convert", tmp_path / "list.txt", tmp_path / "m.csv")
    assert bare.code == 2
    assert "--columns names its columns" in bare.err
    done = windmark("convert", tmp_path / "list.txt", tmp_path / "m.csv", "--columns", "name,x,y,z,-", "--unit", "mm")
    assert done.code == 0, done.err
    assert "list.txt (text): 2 markers" in done.out
    assert "lost: 2 lines before the first row: 'made elsewhere', 'P X Y Z rays'" in done.out
    markers = io.read_markers(tmp_path / "m.csv")
    assert markers.length_unit == "mm"
    np.testing.assert_array_equal(markers.xyz, [[0.5, 400, -2.25], [100, 0, 7]])
    with pytest.raises(io.FileError, match="windmark convert --columns makes such a table of others"):
        io.read_markers(tmp_path / "list.txt")
    image = windmark("convert", tmp_path / "list.txt", tmp_path / "m.csv", "--as", "grid", "--columns", "name,x,y,z")
    assert (image.code, "--columns is for markers" in image.err) == (2, True)
