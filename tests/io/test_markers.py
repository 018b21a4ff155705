"""Marker tables: CSV and .tgts, good and bad."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from windmark.io import FileError, read_markers, read_points, write_markers
from windmark.scene import ROLES, MarkerSet

TGTS = """#GRID_FILE: plate.grid
*Targets
   1  -10.7  -2.0  -7.0   0.0  -0.0  1.0   0.063   6  155  59 st01
   2  -10.5   2.6  -7.0   0.0  -0.0  1.0   0.063   6  158  152 st 02
* taps
   1   -5.0  -2.5  -7.0   0.0   0.0  2.0   0.020   9   10  48 st01
*Virtuals
   1   -8.5   0.0  -7.0   0.0   0.0  0.0   0       6  199  99 K07
*FIDUCIALS
   1   -8.5   1.0  -7.0   0.0   0.0  1.0   0.1     6  199  99 st01
"""


@pytest.fixture
def file(tmp_path):
    def write(text, name="markers.csv"):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return write


def test_smallest_table(file):
    m = read_markers(file("name,x,y,z\nA,1,2,3\n"))
    assert m.name.tolist() == ["A"]
    assert m.xyz.tolist() == [[1, 2, 3]]
    assert np.isnan(m.normal).all()
    assert np.isnan(m.radius).all()
    assert np.isnan(m.sigma).all()
    assert m.volume.tolist() == m.role.tolist() == ["model"]


def test_full_table(file):
    m = read_markers(
        file(
            "role,name,z,y,x,nx,ny,nz,radius,volume,sigma_x,sigma_y,sigma_z\n"
            "wall,W1,3,2,1,0,0,2,1.5,wall,.1,.2,.3\n"
            ",M1,6,5,4,,,,,,,,\n"
        )
    )
    assert m.xyz.tolist() == [[1, 2, 3], [4, 5, 6]]
    np.testing.assert_array_equal(m.normal, [[0, 0, 1], [np.nan] * 3])
    np.testing.assert_array_equal(m.radius, [1.5, np.nan])
    np.testing.assert_array_equal(m.sigma, [[0.1, 0.2, 0.3], [np.nan] * 3])
    assert m.volume.tolist() == ["wall", "model"]
    assert m.role.tolist() == ["wall", "model"]


def test_only_painted_markers_unless_asked(file):
    path = file("name,x,y,z,role\nA,0,0,0,model\nT,1,0,0,tap\nF,1,0,0,Fiducial\n")
    assert read_markers(path).name.tolist() == ["A"]
    assert read_markers(path, roles=None).name.tolist() == ["A", "T", "F"]
    assert read_markers(path, roles=("tap",)).name.tolist() == ["T"]
    with pytest.raises(FileError, match="no markers of role wall; its 3 entries are fiducial, model, tap"):
        read_markers(path, roles=("wall",))
    with pytest.raises(ValueError, match=r"roles must be among model, .*, got tab"):
        read_markers(path, roles=("tab",))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,x,y,z\n", "no markers of role .*; the table has no rows"),
        ("name,x,y\nA,1,2\n", "line 1: no column 'z'"),
        ("name,x,y,z,colour\nA,1,2,3,red\n", "unknown column 'colour'; the columns are name,x,y,z,nx,ny,nz,radius"),
        ("A,1,2,3\nB,1,2,3\n", "line 1: no column 'name'"),
        ("name,x,y,z\nA,1,2,nan\n", "line 2: z is 'nan'; expected a finite number"),
        ("name,x,y,z\nA,1,2,3\n# c\nB,1,-inf,3\n", "line 4: y is '-inf'"),
        ("name,x,y,z\nA,1,2,3\nB,,2,3\n", "line 3: x is ''"),
        ("name,x,y,z\nA,1,2,3\n,1,2,3\n", "line 3: name is empty"),
        ("name,x,y,z\nA,1,2,3\nB,1,2,3\nA,4,5,6\n", "line 4: the name 'A' is already on line 2"),
        ("name,x,y,z\nA,1,2,3\nB,1,2\n", "line 3: 3 values; expected 4"),
        ("name,x,y,z,role\nA,1,2,3,tapp\n", "line 2: role is 'tapp'; expected one of model, wall"),
        ("name,x,y,z,radius\nA,1,2,3,0\n", "line 2: radius must be > 0"),
        ("name,x,y,z,radius\nA,1,2,3,big\n", "line 2: radius is 'big'"),
        ("name,x,y,z,nx,ny\nA,1,2,3,0,1\n", "header: the table has nx, ny but not nz"),
        ("name,x,y,z,nx,ny,nz\nA,1,2,3,0,1,\n", "line 2: expected all of nx, ny, nz or none"),
        ("name,x,y,z,nx,ny,nz\nA,1,2,3,0,0,0\n", "line 2: nx, ny, nz is 0, 0, 0"),
        ("name,x,y,z,sigma_x,sigma_y,sigma_z\nA,1,2,3,0,-1,0\n", "line 2: sigma_x, sigma_y, sigma_z must be >= 0"),
    ],
)
def test_bad_tables(file, text, message):
    path = file(text)
    with pytest.raises(FileError, match=message) as caught:
        read_markers(path)
    assert caught.value.path == path


def marker_sets():
    number = st.floats(-1e6, 1e6)
    unknown = st.one_of(st.just(np.nan), st.floats(1e-6, 1e6))
    word = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1).filter(lambda s: s == s.strip())

    @st.composite
    def build(draw):
        names = draw(st.lists(word, min_size=1, max_size=5, unique=True))
        n = len(names)

        def rows(values, width):
            return draw(st.lists(st.lists(values, min_size=width, max_size=width), min_size=n, max_size=n))

        return MarkerSet.make(
            names,
            rows(number, 3),
            sigma=rows(unknown, 3),
            radius=np.ravel(rows(unknown, 1)),
            normal=rows(number, 3),
            volume=draw(st.lists(word, min_size=n, max_size=n)),
            role=draw(st.lists(st.sampled_from(ROLES), min_size=n, max_size=n)),
        )

    return build()


@given(markers=marker_sets())
def test_round_trip_is_exact(one_folder, markers):
    path = one_folder / "m.csv"
    write_markers(path, markers)
    again = read_markers(path, roles=None)
    for field in ("name", "xyz", "sigma", "radius", "normal", "volume", "role"):
        np.testing.assert_array_equal(getattr(again, field), getattr(markers, field), err_msg=field)


def test_unknown_columns_are_not_written(tmp_path):
    write_markers(tmp_path / "m.csv", MarkerSet.make(["#1"], [[0.1, 2, 3]]))
    assert (tmp_path / "m.csv").read_text() == 'name,x,y,z,volume,role\n"#1",0.1,2.0,3.0,model,model\n'


def test_what_cannot_be_written(tmp_path):
    with pytest.raises(ValueError, match="must name a CSV file"):
        write_markers(tmp_path / "m.tgts", MarkerSet.make(["a"], [[0, 0, 0]]))
    with pytest.raises(ValueError, match="name must not be empty or begin or end with a space: ' a'"):
        write_markers(tmp_path / "m.csv", MarkerSet.make([" a"], [[0, 0, 0]]))
    with pytest.raises(ValueError, match="volume must not be empty"):
        write_markers(tmp_path / "m.csv", MarkerSet.make(["a"], [[0, 0, 0]], volume=""))
    assert not list(tmp_path.iterdir())


# --- .tgts ---------------------------------------------------------------------------------


def test_tgts_keeps_targets_taps_virtuals_and_fiducials_apart(file):
    path = file(TGTS, "plate.TGTS")
    targets = read_markers(path)
    assert targets.name.tolist() == ["st01", "st 02"]
    assert targets.radius.tolist() == [0.0315, 0.0315]
    everything = read_markers(path, roles=None)
    assert everything.name.tolist() == ["st01", "st 02", "tap:st01", "K07", "fiducial:st01"]
    assert everything.role.tolist() == ["model", "model", "tap", "virtual", "fiducial"]
    np.testing.assert_array_equal(everything.radius, [0.0315, 0.0315, 0.01, np.nan, 0.05])
    np.testing.assert_array_equal(everything.normal[2:4], [[0, 0, 1], [np.nan] * 3])


def test_tgts_without_sections_holds_targets(file):
    path = file("# x y z ...\n1 67.0 3.1 -2.7 0 0.76 -0.64 0.433 596 21 55 st6\n", "m.tgts")
    assert read_markers(path).name.tolist() == ["st6"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("*Targets\n", "no markers of role .*; the table has no rows"),
        ("*Taps\n1 0 0 0 0 0 1 0.1 1 2 3 P1\n", "no markers of role .*; its 1 entries are tap"),
        ("*Target\n1 0 0 0 0 0 1 0.1 1 2 3 P1\n", r"line 1: unknown section '\*Target'; expected one of \*Targets"),
        ("*Targets\n1 0 0 0 0 0 1 0.1 1 2 3\n", "line 2: 11 values; expected 12"),
        ("*Targets\n1 0 0 zero 0 0 1 0.1 1 2 3 A\n", "line 2: z is 'zero'; expected a finite number"),
        ("*Targets\n1 0 2e18 0 0 0 1 0.1 1 2 3 A\n", r"line 2: y is '2e18'; expected a finite number of at most 1e"),
        ("*Targets\n1 0 nan 0 0 0 1 0.1 1 2 3 A\n", "line 2: y is 'nan'"),
        ("*Targets\n1 0 0 0 0 0 1 -0.1 1 2 3 A\n", "line 2: size is -0.1"),
        (
            "*Targets\n1 0 0 0 0 0 1 .1 1 2 3 A\n2 0 0 0 0 0 1 .1 1 2 3 A\n",
            "line 3: the name 'A' is already on line 2",
        ),
        (
            "*Targets\n1 0 0 0 0 0 1 .1 1 2 3 A\n*Taps\n1 0 0 0 0 0 1 .1 1 2 3 A\n2 0 0 0 0 0 1 .1 1 2 3 A\n",
            "line 5: the name 'tap:A' is already on line 4",
        ),
    ],
)
def test_bad_tgts(file, text, message):
    with pytest.raises(FileError, match=message):
        read_markers(file(text, "m.tgts"))


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("Name;X [mm];Y[MM];Z (mm)", "mm"),
        ("name,x (inch),y (in),z [inches]", "in"),
        ("name,x [mm],y,z", "mm"),
        ("name,x [],y [-],z", ""),
    ],
)
def test_unit_in_the_header(file, header, unit):
    for read in (read_markers, read_points):
        table = read(file(header + "\n" + ("A;1;2;3" if ";" in header else "A,1,2,3")))
        assert table.length_unit == unit
        assert table.xyz.tolist() == [[1, 2, 3]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,x [mm],y [mm],z [in]\n", "line 1: the header has lengths in several units: x in mm, y in mm, z in in"),
        ("# length unit: in\nname,x [mm],y [mm],z [mm]\nA,1,2,3\n", "says the length unit more than once: in, mm"),
        ("name,x [mm],y [mm],z [mm],radius [in]\n", "several units: .*radius in in; expected one"),
        ("name,x [mm],y [mm],z [mm],x\n", "line 1: the column 'x' is there more than once"),
        ("name,x,y,z,nx [mm],ny,nz\n", r"line 1: unknown column 'nx \[mm\]'"),
    ],
)
def test_units_in_the_header_that_contradict(file, text, message):
    with pytest.raises(FileError, match=message):
        read_markers(file(text))
