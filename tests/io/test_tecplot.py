"""Tecplot ASCII: round trips, files as other programs write them, and VTK's reader as a witness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from windmark.io import FileError, read_mesh, read_tecplot, write_tecplot
from windmark.scene import Mesh


def values(mesh, seed=0):
    rng = np.random.default_rng(seed)
    cp = rng.normal(size=len(mesh.vertices)).astype(np.float32)
    cp[::4] = np.nan
    return {"cp": cp, "p": rng.uniform(9e4, 1.1e5, len(mesh.vertices)).astype(np.float32)}


@pytest.mark.parametrize("single", [True, False])
def test_blocks_and_values_come_back(tmp_path, make_mesh, single):
    mesh = make_mesh([(5, 4, 1), (1, 6, 3), (4, 1, 7)], single=single, blanked=True)
    fields = values(mesh)
    write_tecplot(tmp_path / "a.dat", mesh, fields, units={"p": "Pa", "length": "in"}, title='run "12"\nB')
    got, back = read_tecplot(tmp_path / "a.dat")
    np.testing.assert_allclose(got.vertices, mesh.vertices, rtol=1e-8 if single else 0)
    np.testing.assert_array_equal(got.vertices.astype(np.float32), mesh.vertices.astype(np.float32))
    np.testing.assert_array_equal(got.triangles, mesh.triangles)
    np.testing.assert_array_equal(got.blanked, mesh.blanked)
    assert got.blocks == mesh.blocks
    assert list(back) == ["cp", "p [Pa]"]
    for given, column in zip(fields.values(), back.values(), strict=True):
        np.testing.assert_array_equal(column.astype(np.float32), given)
    text = (tmp_path / "a.dat").read_text()
    assert "TITLE = \"run '12' B\"" in text
    assert '"x [in]" "y [in]" "z [in]" "iblank" "cp" "p [Pa]" "valid"' in text
    assert 'LengthUnit = "in"' in text


def test_valid_says_where_all_values_are(tmp_path, blocks):
    write_tecplot(tmp_path / "a.dat", blocks, values(blocks))
    lines = (tmp_path / "a.dat").read_text().splitlines()
    numbers = np.array([line.split() for line in lines if line[0] not in "TVDZ"], dtype=float)
    np.testing.assert_array_equal(numbers[:, -1] == 0, np.isnan(values(blocks)["cp"]))
    np.testing.assert_array_equal(numbers[:, 3] == -9999, numbers[:, -1] == 0)
    write_tecplot(tmp_path / "b.dat", blocks, {"p": values(blocks)["p"]})
    assert "valid" not in (tmp_path / "b.dat").read_text()


def test_the_fill_value_must_be_free(tmp_path, blocks):
    fields = values(blocks)
    fields["cp"][1] = -9999
    with pytest.raises(ValueError, match=r"fill: -9999.0 is a value of 'cp'"):
        write_tecplot(tmp_path / "a.dat", blocks, fields)
    with pytest.raises(ValueError, match="fill: must be a finite number"):
        write_tecplot(tmp_path / "a.dat", blocks, fields, fill=np.nan)
    write_tecplot(tmp_path / "a.dat", blocks, fields, fill=-0.1)
    _, back = read_tecplot(tmp_path / "a.dat")
    np.testing.assert_array_equal(back["cp"].astype(np.float32), fields["cp"])


def test_triangles_and_their_volumes_come_back(tmp_path, shell):
    fields = values(shell)
    write_tecplot(tmp_path / "a.tec", shell, fields)
    got, back = read_tecplot(tmp_path / "a.tec")
    np.testing.assert_array_equal(got.vertices, shell.vertices)
    order = np.argsort(shell.volume, kind="stable")
    np.testing.assert_array_equal(got.triangles, shell.triangles[order])
    np.testing.assert_array_equal(got.volume, shell.volume[order])
    np.testing.assert_array_equal(back["cp"].astype(np.float32), fields["cp"])
    assert set(read_mesh(tmp_path / "a.tec", volumes={"wing, left": "wing"}).volume) == {"fuselage", "wing"}


def test_renamed_volumes_of_blocks_come_back(tmp_path, blocks):
    named = replace(blocks, volume=np.where(blocks.volume == "zone02", "flap", blocks.volume))
    write_tecplot(tmp_path / "a.dat", named)
    got = read_mesh(tmp_path / "a.dat")
    np.testing.assert_array_equal(got.volume, named.volume)
    assert got.blocks == blocks.blocks


def test_vtk_reads_the_same(tmp_path, blocks):
    pyvista = pytest.importorskip("pyvista")
    flat = [b for b in blocks.blocks if b.shape_ijk[2] == 1]
    mesh = Mesh(blocks.vertices[:20], blocks.triangles[: 2 * 12], blocks.volume[: 2 * 12], tuple(flat))
    fields = values(mesh)
    write_tecplot(tmp_path / "a.dat", mesh, {"p": fields["p"]})
    zone = pyvista.TecplotReader(str(tmp_path / "a.dat")).read()[0]
    assert zone.dimensions == (5, 4, 1)
    np.testing.assert_allclose(zone.points, mesh.vertices, rtol=1e-6)
    np.testing.assert_allclose(zone["p"], fields["p"], rtol=1e-6)


# --- as other programs write

POINTS = "0 0 0 1\n1 0 0 2\n0 1 0 3\n1 1 .5 4\n"
COLUMNS = "0 1 0 1\n0 0 1 1\n0 0 0 .5\n1 2 3 4\n"


@pytest.mark.parametrize(
    "header",
    [
        'VARIABLES = "X" "Y" "Z" "cp"\nZONE T="w", I=2, J=2, DATAPACKING=POINT\n',
        'TITLE="t"\r\nvariables = x, y, z, cp\r\nzone i=2 j=2 f=point t="w"\r\n',
        'Variables="X [m]"\n"Y [m]"\n"Z [m]"\n"cp"\n# note\nZone\n T="w"\n I = 2, J= 2, K=1,\nDT=(SINGLE SINGLE)\n',
        'VARIABLES = "X","Y","Z","cp"\nZONE T="w", I=2, J=2\n',
    ],
)
def test_headers_of_ordered_zones(tmp_path, header):
    (tmp_path / "a.dat").write_bytes((header + POINTS).encode())
    mesh, fields = read_tecplot(tmp_path / "a.dat")
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.5]])
    np.testing.assert_array_equal(mesh.triangles, [[0, 1, 3], [0, 3, 2]])
    np.testing.assert_array_equal(fields["cp"], [1, 2, 3, 4])
    assert mesh.blocks[0].name == "w"


def test_block_packing_and_repeats(tmp_path):
    (tmp_path / "a.dat").write_text(
        "VARIABLES = x y z cp\nZONE I=2, J=2, DATAPACKING=BLOCK\n" + COLUMNS.replace("0 0 0 .5", "3*0 .5")
    )
    mesh, fields = read_tecplot(tmp_path / "a.dat")
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.5]])
    np.testing.assert_array_equal(fields["cp"], [1, 2, 3, 4])


@pytest.mark.parametrize(
    ("zone", "elements", "triangles"),
    [
        ("N=4, E=2, ZONETYPE=FETRIANGLE, DATAPACKING=POINT", "1 2 4\n1 4 3\n", [[0, 1, 3], [0, 3, 2]]),
        ("N=4, E=2, F=FEPOINT, ET=TRIANGLE", "1 2 4\n1 4 3\n", [[0, 1, 3], [0, 3, 2]]),
        ("NODES=4 ELEMENTS=1 ZONETYPE=FEQUADRILATERAL F=FEPOINT", "1 2 4 3\n", [[0, 1, 3], [0, 3, 2]]),
        ("N=4, E=2, F=FEPOINT, ET=QUADRILATERAL", "1 2 4 4\n1 4 3 3", [[0, 1, 3], [0, 3, 2]]),
    ],
)
def test_finite_elements(tmp_path, zone, elements, triangles):
    (tmp_path / "a.dat").write_text(f"VARIABLES = x y z cp\nZONE {zone}\n{POINTS}# elements\n{elements}")
    mesh, _ = read_tecplot(tmp_path / "a.dat")
    np.testing.assert_array_equal(mesh.triangles, triangles)
    assert mesh.blocks == ()
    assert set(mesh.volume) == {"zone01"}


def test_ordered_and_element_zones_together(tmp_path):
    (tmp_path / "a.dat").write_text(
        f"VARIABLES = x y z cp\nZONE T=a I=2 J=2 F=POINT\n{POINTS}"
        f"ZONE T=b N=4 E=1 F=FEPOINT ET=TRIANGLE\n{POINTS}1 2 3\n"
    )
    mesh, fields = read_tecplot(tmp_path / "a.dat")
    np.testing.assert_array_equal(mesh.triangles, [[0, 1, 3], [0, 3, 2], [4, 5, 6]])
    np.testing.assert_array_equal(mesh.volume, ["a", "a", "b"])
    assert len(fields["cp"]) == 8


HEAD = "VARIABLES = x y z cp\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("TITLE = nothing\n", "no ZONE"),
        ("# made by hand\n1 2 3\n", "line 1: numbers before the first ZONE"),
        ("#!TDV112", "is a binary Tecplot file"),
        (
            HEAD + "ZONE I=2 J=2 F=POINT\n" + POINTS + "5 5 5",
            "line 2: the zone holds 19 numbers; expected 16 values of 4",
        ),
        (
            HEAD + "ZONE I=2 J=20000000000 F=POINT\n" + POINTS,
            "line 2: the zone holds 16 numbers; expected 160000000000",
        ),
        (HEAD + "ZONE I=2 J=2 F=POINT\n0 0 0 1\n1 0 oh 2", "line 4: expected a number, got 'oh'"),
        (
            HEAD + "ZONE I=2 J=2 F=POINT\n0 0 0 1\noh 0 0 2",
            "line 4: expected a record of a Tecplot ASCII file, got 'oh",
        ),
        (HEAD + "ZONE I=2 J=two F=POINT\n" + POINTS, "line 2: J is two; expected a whole number"),
        (HEAD + "ZONE E=1 F=FEPOINT\n" + POINTS, "line 2: N is missing"),
        (HEAD + "ZONE I=2 J=2 K=2 F=POINT\n" + POINTS, r"line 2: a zone of \(2, 2, 2\) nodes is a volume"),
        (HEAD + "ZONE N=4 E=1 ZONETYPE=FEBRICK F=FEPOINT\n" + POINTS, "zone type FEBRICK is not read"),
        (
            HEAD + "ZONE N=4 E=1 F=FEPOINT\n" + POINTS + "1 2 5",
            "names a node that is none; expected whole numbers 1 to 4",
        ),
        (HEAD + "ZONE I=2 J=2 DATAPACKING=ROWS\n" + POINTS, "DATAPACKING is ROWS"),
        (HEAD + "ZONE I=2 J=2\n" + POINTS.replace("\n", " "), "DATAPACKING is missing"),
        (HEAD + "ZONE I=2 J=2 F=BLOCK VARLOCATION=([4]=CELLCENTERED)\n" + COLUMNS, "cell centres"),
        (HEAD + "ZONE I=2 J=2 F=POINT PASSIVEVARLIST=[4]\n" + COLUMNS, "PASSIVEVARLIST is not read"),
        (HEAD + "ZONE I=2 J=2 F=POINT VARSHARELIST=([1-4]=1)\n" + COLUMNS, "VARSHARELIST is"),
        (HEAD + "TEXT X=1\n", "line 2: TEXT records are not read"),
        ("VARIABLES = x y z cp cp\nZONE I=2 J=2 F=POINT\n", "VARIABLES: 'cp' and 'cp' are two variables of one name"),
        ('VARIABLES = "X [mm]" y z x\nZONE I=2 J=2 F=POINT\n', r"VARIABLES: 'X \[mm\]' and 'x' are two variables"),
        (
            "VARIABLES = x y cp\nZONE I=2 J=2 F=POINT\n1 2 3\n4 5 6\n7 8 9\n1 2 3",
            r"VARIABLES: no variable z; it has \['cp'",
        ),
    ],
)
def test_files_that_cannot_be_read_say_where(tmp_path, text, message):
    (tmp_path / "a.dat").write_text(text)
    with pytest.raises(FileError, match=message):
        read_mesh(tmp_path / "a.dat")


def test_a_missing_coordinate_is_an_error(tmp_path):
    (tmp_path / "a.dat").write_text(HEAD + "ZONE I=2 J=2 F=POINT\n" + POINTS.replace("1 0 0 2", "nan 0 0 2"))
    with pytest.raises(FileError, match=r"node 1 \(from 0\) is at \(nan, 0, 0\)"):
        read_mesh(tmp_path / "a.dat")


def test_nothing_appears_on_a_full_disk(tmp_path, make_mesh, full_disk):
    mesh = make_mesh([(40, 30, 1)])
    with full_disk(5000), pytest.raises(FileError, match="cannot be written"):
        write_tecplot(tmp_path / "a.dat", mesh, values(mesh))
    assert not list(tmp_path.iterdir())
