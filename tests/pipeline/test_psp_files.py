"""Small files of a paint project that are read alone: linearity, polygons, colours of the table of points."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from windmark.errors import DataError, UsageError
from windmark.geometry import Camera, Pose
from windmark.io import FileError, write_nodes_netcdf
from windmark.paint import TunnelGain
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.psp import PointRecord
from windmark.pipeline.psp.calibration import read_calibration
from windmark.pipeline.psp.load import read_polygons
from windmark.pipeline.psp.offs import by_incidence, by_run, read_references, run_remarks
from windmark.pipeline.psp.outputs import on_pixels
from windmark.pipeline.psp.sensors import read_linearity
from windmark.pipeline.psp.stream import constants_of, contradiction, contradiction_words, dynamic_pressure
from windmark.pipeline.psp.table import read_points_table
from windmark.pipeline.psp.wall import read_map
from windmark.pipeline.psp.wtd import read_wtd
from windmark.pipeline.verdict import DOUBTFUL, GOOD
from windmark.pipeline.verdict.paint import psp_verdict
from windmark.resection import map_pixels
from windmark.scene import Mesh, structured_triangles

HEAD = "point,alpha_deg,p_inf_Pa,q_inf_Pa,p_off_Pa,T_off_K,on,off"
ROW = "a,1,65000,29000,99000,293,on.tif,off.tif"


def written(folder, name, *lines):
    (folder / name).write_text("\n".join(lines) + "\n")
    return folder / name


def test_a_linearity_is_a_rising_table(tmp_path):
    found = read_linearity(written(tmp_path, "l.csv", "level,light", "0,0", "100,105", "200,230"))
    assert found.light.tolist() == [0, 105, 230]
    for lines, words in ((("0,0",), "has 1 rows"), (("0,0", "5,5", "4,6"), "line 4: level and light must both rise"),
                         (("0,0", "x,5"), "line 3: level is 'x'")):  # fmt: skip
        with pytest.raises(FileError, match=words):
            read_linearity(written(tmp_path, "l.csv", "level,light", *lines))


def test_polygons_are_corners_in_order_in_the_jobs_unit(tmp_path):
    corners = ("a,0,0,0", "a,1,0,0", "a,1,1,0", "b,5,0,0", "b,6,0,0", "b,6,2,0", "b,5,2,0")
    file = written(tmp_path, "p.csv", "# length unit: mm", "name,x,y,z", *corners)
    assert [len(p) for p in read_polygons(file, Lengths("mm"))] == [3, 4]
    with pytest.raises(FileError, match="mm"):
        read_polygons(file, Lengths("in"))
    with pytest.raises(FileError, match=r"name: polygon 'a' has 3 corners, on one line"):
        read_polygons(written(tmp_path, "p.csv", "name,x,y,z", "a,0,0,0", "a,1,0,0", "a,2,0,0"), Lengths("mm"))


def test_other_colours_belong_to_the_points_that_name_them(tmp_path):
    file = written(tmp_path, "t.csv", f"{HEAD},on_reference,off_reference", f"{ROW},r1.tif,r0.tif",
                   f"{ROW.replace('a,', 'b,', 1)},,")  # fmt: skip
    first, second = read_points_table(file)
    assert dict(first.channels) == {"reference": ("r1.tif", "r0.tif")}
    assert first.patterns["wind-off reference"] == "r0.tif"
    assert dict(second.channels) == {}
    assert set(second.patterns) == {"wind-on", "wind-off"}
    with pytest.raises(FileError, match="has on_temperature alone; expected on_temperature and off_temperature"):
        read_points_table(written(tmp_path, "t.csv", f"{HEAD},on_temperature", f"{ROW},r1.tif"))


def test_a_cell_table_is_read_whatever_its_columns_order(tmp_path):
    from windmark.pipeline.psp.cell import read_cell

    cell = read_cell(written(tmp_path, "c.csv", "ratio,temperature_degC,pressure_kPa", "0.5,20,50", "1,20,100"))
    assert cell.pressure.tolist() == [50_000, 100_000]
    assert cell.temperature.tolist() == [293.15, 293.15]
    assert cell.ratio_sigma is None
    with pytest.raises(FileError, match="has no rows"):
        read_cell(written(tmp_path, "c.csv", "ratio,temperature_degC,pressure_kPa"))


def test_a_column_that_nobody_knows_is_named(tmp_path):
    """A sigma that is called otherwise than expected would not count, and another one would be taken."""
    from windmark.pipeline.psp.cell import read_cell
    from windmark.pipeline.psp.table import read_sensors

    head, row = "pressure_Pa,temperature_K,ratio", "1e5,293,1"
    columns = "ratio,sigma,run,time,note,pressure_UNIT,temperature_UNIT,sigma_pressure_UNIT,sigma_temperature_UNIT"
    with pytest.raises(FileError, match=f"unknown column 'sigma_ratio'; the columns are {columns}"):
        read_cell(written(tmp_path, "c.csv", f"{head},sigma_ratio", f"{row},0.001"))
    all_of_them = f"{head},Sigma,sigma_pressure_kPa,sigma_temperature_degC"
    assert read_cell(written(tmp_path, "c.csv", all_of_them, f"{row},0.001,0.1,0.2")).pressure_sigma.tolist() == [100.0]
    with pytest.raises(FileError, match="unknown column 'sig_pa'; the columns are point,name,pressure_UNIT,"):
        read_sensors(written(tmp_path, "p.csv", "point,name,pressure_Pa,sig_Pa", "a,t1,6e4,20"), "pressure", 50.0)
    both = written(tmp_path, "p.csv", "point,name,pressure_Pa,temperature_K,sigma_Pa", "a,t1,6e4,293,20")
    assert read_sensors(both, "pressure", 50.0).at("a", ["t1"])[1].tolist() == [20.0]


WTD = """\
RUN 3016 2
#  MACH	ALPHA	BETA	PTOT	TTF	PS	Q	T102
0.80	2.05	0.12	2116.2	90.0	1388.3	622.0	99999.0

# Tap  CP
    1  9.9999
"""


def test_a_wtd_file_says_what_the_table_does_not(tmp_path):
    """Pounds per square foot and degrees Fahrenheit; a cell of the table counts before the file's value."""
    (tmp_path / "a.wtd").write_text(WTD)
    (tmp_path / "none.wtd").write_text(WTD.replace("2116.2", "0.00"))
    head = "point,alpha_deg,q_inf_Pa,p_off_Pa,T_off_K,on,off,wtd"
    rows = read_points_table(written(
        tmp_path, "t.csv", head, "a,,,99000,293,x,y,a.wtd", "b,1.5,29000,99000,293,x,y,a.wtd",
        "c,,,99000,293,x,y,gone.wtd", "d,1,,99000,293,x,y,none.wtd", "e,1,29000,99000,293,x,y,",
    ))  # fmt: skip
    stream = rows[0].conditions()
    assert (stream.p_inf, stream.q_inf) == pytest.approx((1388.3 * 47.880259, 622.0 * 47.880259))
    assert (stream.t_0, stream.mach, rows[0].alpha_deg, rows[0].beta_deg) == pytest.approx((305.372, 0.8, 2.05, 0.12))
    assert rows[0].conditions_file == tmp_path / "a.wtd"
    assert (rows[1].alpha_deg, rows[1].q_inf) == (1.5, 29000)
    for row, words in zip(rows[2:], ("line 4 of the table of points.*gone.wtd", "p_inf is missing", "p_inf is missing"),
                          strict=True):  # fmt: skip
        with pytest.raises(DataError, match=words):
            row.conditions()


@pytest.mark.parametrize(
    "text", ["", "# ALPHA BETA\n1 2\n", "# MACH PS\n1\n", "# MACH PS\n1 x\n", "# MACH MACH\n1 2\n"]
)
def test_what_is_no_wtd_file_is_refused(tmp_path, text):
    (tmp_path / "a.wtd").write_text(text)
    with pytest.raises(FileError, match=r"names|the file is empty"):
        read_wtd(tmp_path / "a.wtd")


def test_nasas_own_file_has_no_pressures(request):
    file = request.config.rootpath / "../shared/data/nasa-upsp-cam5/wtd_test.wtd"
    if not file.is_file():
        pytest.skip("the file is not here")
    said = read_wtd(file)
    assert (said["mach"], said["alpha_deg"], said["beta_deg"]) == (1.0, 0.05, 0.12)
    assert all(np.isnan(said[k]) for k in ("p_inf", "q_inf", "t_0"))


def test_a_view_shows_the_values_of_nodes_and_nothing_where_one_is_missing():
    mesh = Mesh.make([[-2.0, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]], [[0, 1, 2], [0, 2, 3]])
    above = Pose.look_at(np.array([0.0, 0.0, 10.0]), np.zeros(3), [0.0, 1.0, 0.0])
    pixels = map_pixels(mesh, Camera((80, 60), 100.0), above, cull_backfaces=True)
    image = on_pixels(mesh.vertices @ [1.0, 10.0, 0.0], pixels)
    rows, columns = np.nonzero(np.isfinite(image))
    assert len(rows) > 1400  # 40 x 40 pixels less rims
    np.testing.assert_allclose(image[rows, columns], (columns - 39.5) / 10 - (rows - 29.5), atol=1e-4)
    lower = on_pixels(np.array([1.0, 1.0, 1.0, np.nan]), pixels)
    assert np.isfinite(lower).sum() == pytest.approx(0.5 * len(rows), rel=0.05)


def rows_of(folder, head, *lines, **how):
    return read_points_table(written(folder, "t.csv", head, *lines), **how)


def test_a_points_own_cell_counts_before_its_file_and_that_before_the_project(tmp_path):
    (tmp_path / "a.wtd").write_text(WTD)
    constants = constants_of({"mach": 0.75, "q_inf_kPa": 29.0, "T0_degC": 30.0, "p_off_hPa": 990.0, "T_off_K": 293.0})
    assert constants["t_0"] == pytest.approx(303.15)
    first, second, third = rows_of(
        tmp_path,
        "point,alpha_deg,p_inf_Pa,q_inf_Pa,on,off,wtd",
        "a,2.05,66000,30000,x,y,a.wtd",
        "b,,65000,,x,y,",
        "c,1,65000,29010,x,y,",
        constants=constants,
    )
    assert (first.p_inf, first.q_inf, first.mach, first.p_off, first.t_off) == (66000, 30000, 0.8, 99000, 293)
    assert first.t_0 == pytest.approx(305.372, abs=1e-3)
    words = "; ".join(first.remarks)
    for part in (
        "p_inf is 66000 Pa by its row, which counts, and 66472.2 Pa by its file of conditions",
        "q_inf is 30000 Pa by its row, which counts, and 29781.5 Pa by its file of conditions",
        "and 29000 Pa by the project",
        "Mach is 0.8 by its file of conditions, which counts, and 0.75 by the p",
        "T0 is 305.372 K by its file of conditions, which counts, and 303.15 K by the project",
    ):
        assert part in words
    assert "alpha" not in words  # the same in both
    assert (second.q_inf, second.mach, second.remarks) == (29000, 0.75, ())
    assert (third.q_inf, third.remarks) == (29010, ())  # rounding is no contradiction
    with pytest.raises(DataError, match=r"alpha is missing"):
        second.conditions()


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"p_inf": 1.0}, "p_inf is not known; expected alpha_deg"),
        ({"p_inf_bars": 1.0}, "p_inf_bars is not known"),
        ({"p_inf_Pa": 1e5, "p_inf_kPa": 100.0}, "p_inf is there more than once"),
        ({"q_inf_Pa": 0.0}, "q_inf_Pa: expected a number above 0"),
        ({"T0_K": 20.0}, "T0_K: expected above 50 K, got 20 K"),
        ({"sigma_p_inf_Pa": -1.0}, "expected at least 0"),
        ({"on": 1.0}, "on is not known"),
    ],
)
def test_conditions_that_no_tunnel_has_are_refused(said, words):
    with pytest.raises(UsageError, match=words):
        constants_of(said)


REFS = "alpha_deg,p_off_kPa,T_off_degC,off"


def test_points_without_wind_off_pictures_get_the_references_they_lie_between(tmp_path):
    refs = read_references(
        written(tmp_path, "r.csv", f"{REFS},off_reference", "4,99,20,c,rc", "0,98,22,a,ra", "2,98.4,21,b,rb")
    )
    head = "point,alpha_deg,p_inf_Pa,q_inf_Pa,on,off,on_reference,p_off_Pa,T_off_K"
    rows = by_incidence(
        rows_of(
            tmp_path,
            head,
            "own,1,65000,29000,x,y,,99000,293",
            "mid,3,65000,29000,x,,r,,",
            "hit,2,65000,29000,x,,,,",
            "past,4.3,65000,29000,x,,,,",
            "out,9,65000,29000,x,,,,",
            "two,1,65000,29000,x,,,97000,293",
            "no,,65000,29000,x,,,,",
            references=True,
        ),
        refs,
    )
    of = {row.name: row for row in rows}
    assert of["own"].parts == ()
    assert of["own"].patterns == {"wind-on": "x", "wind-off": "y"}
    assert (of["mid"].p_off, of["mid"].t_off) == pytest.approx((98700, 293.65))
    assert [(p.name, p.share) for p in of["mid"].parts] == [("at 2 degrees", 0.5), ("at 4 degrees", 0.5)]
    assert of["mid"].patterns == {
        "wind-on": "x",
        "wind-on reference": "r",
        "wind-off (at 2 degrees)": "b",
        "wind-off (at 4 degrees)": "c",
        "wind-off reference (at 2 degrees)": "rb",
        "wind-off reference (at 4 degrees)": "rc",
    }
    assert [(p.pattern, p.share) for p in of["hit"].parts] == [("b", 1.0)]
    assert sum(p.share for p in of["past"].parts) == pytest.approx(1)
    assert "beyond the references' 0 to 4" in of["past"].remarks[0]
    assert "p_off is 98200 Pa by the table of references, which counts, and 97000 Pa by its row" in of["two"].remarks[0]
    for name, words in (
        ("out", r"incidence 9 lies outside the references' 0 to 4.*line 6"),
        ("no", "alpha is missing"),
    ):
        with pytest.raises(DataError, match=words):
            of[name].conditions()
    for lines, words in (
        (("0,98,20,a", "0,98,20,b"), "alpha_deg is there more than once"),
        ((), "has no rows"),
        (("0,98,20,",), "off must name pictures"),
        (("0,0,20,a",), "p_off must be"),
        (("0,98,-260,a",), "T_off must be above 50 K"),
    ):
        with pytest.raises(FileError, match=words):
            read_references(written(tmp_path, "r.csv", REFS, *lines))


def test_the_points_of_a_run_are_each_others_reference(tmp_path):
    head = "point,alpha_deg,p_inf_Pa,q_inf_Pa,on,off,run,on_temperature"
    lines = [
        "a,1,65000,29000,xa,,r1,",
        "b,1,65000,29000,xb,,r1,",
        "c,3,65000,29000,xc,,r1,",
        "d,1,65000,29000,xd,,r2,",
        "e,1,65000,29000,xe,y,r1,",
        "f,1,65000,29000,xf,,r1,t",
    ]
    rows = by_run(rows_of(tmp_path, head, *lines, references=True))
    of = {row.name: row for row in rows}
    assert [(p.pattern, p.share) for p in of["a"].parts] == [(x, 0.25) for x in ("xb", "xc", "xe", "xf")]
    assert of["a"].own
    assert of["a"].conditions().p_inf == 65000  # no p_off is asked for
    for name, words in (
        ("d", "run 'r2' has no other point"),
        ("e", "names wind-off pictures"),
        ("f", "temperature paint"),
    ):
        with pytest.raises(DataError, match=words):
            of[name].conditions()
    assert "run 'r1': its incidences span 2 degrees" in run_remarks(rows, 0.5)[0]
    assert run_remarks(rows, 2.5) == []


GAIN = {
    "format": "windmark paint calibration 1",
    "kind": "gain",
    "coefficients": [900, -2, 0.01, 0.5, 1e-3, 0],
    "p_range": [500, 2500],
    "t_range": [60, 120],
    "pressure_unit": "psf",
    "temperature_unit": "degF",
}


def test_a_gain_is_a_kind_of_calibration(tmp_path):
    def read(**other):
        (tmp_path / "g.json").write_text(json.dumps({**GAIN, **other}))
        return read_calibration(tmp_path / "g.json")

    got = read(cov=np.diag([4.0, 0, 0, 0, 0, 0]).tolist())
    assert isinstance(got.law, TunnelGain)
    assert got.law.cov[0, 0] == 4
    assert got.record() == {"gain": GAIN["coefficients"]}
    assert "500 to 2500 psf, 60 to 120 degF" in str(got)
    assert "taken as exact" in str(read())
    for other, words in (
        ({"coefficients": [1, 2]}, r"coefficients(\[2\])?: "),
        ({"p_range": [5, 5]}, "p_range: expected two"),
        ({"coefficients": [-900, 0, 0, 0, 0, 0]}, "above zero everywhere"),
        ({"cov": [[1]]}, "cov must be"),
        ({"pressure_unit": "bar"}, "pressure_unit"),
        ({"t_ref_K": 3}, "t_ref_K"),
    ):
        with pytest.raises(FileError, match=words):
            read(**other)


@pytest.mark.parametrize("name", ["beta", "beta_rad", "mach_number", "T0", "sigma_p_inf"])
def test_a_quantity_of_the_points_without_its_unit_is_named(tmp_path, name):
    """Its cells would not count: the sideslip would be 0, whatever they say."""
    with pytest.raises(FileError, match=rf"unknown column '{name.lower()}'; expected {name[:4].rstrip('_')}"):
        read_points_table(written(tmp_path, "t.csv", f"{HEAD},{name}", f"{ROW},5"))


@pytest.mark.parametrize("name", ["operator", "theta_deg", "alpha_encoder", "time", "T0_K", "beta_deg"])
def test_columns_of_ones_own_are_left(tmp_path, name):
    assert len(read_points_table(written(tmp_path, "t.csv", f"{HEAD},{name}", f"{ROW},5"))) == 1


def test_places_of_sensors_have_no_unknown_column(tmp_path):
    """A normal that is called otherwise than expected would not count, and a tap would land on the other side."""
    lines = "# length unit: mm", "name,x,y,z,normal_x,normal_y,normal_z", "A,1,2,3,0,0,1"
    lengths = Lengths("mm")
    with pytest.raises(FileError, match="unknown column 'normal_x'; the columns are name,x,y,z,nx,ny,nz"):
        lengths.points(written(tmp_path, "p.csv", *lines), strict=True)
    assert len(lengths.points(written(tmp_path, "p.csv", *lines))) == 1  # of a list of places that are wanted
    head = "name,x [mm],y [mm],z [mm],nx,ny,nz,radius [mm],volume,role,sigma_x,run,time,note"
    own = written(tmp_path, "q.csv", head, "A,1,2,3,0,0,1,0.2,wing,tap,0.1,7,12:30,new")
    assert lengths.points(own, strict=True).normal.tolist() == [[0, 0, 1]]


@pytest.mark.parametrize(("value", "sigma", "words"), [
    (0.0, 0.3, "temperature: 1 of its 4 nodes are not above 50 K; expected NaN where it is not known"),
    (-9999.0, 0.3, "are not above 50 K"),
    (295.0, np.nan, "sigma_temperature: 1 nodes with a temperature have no sigma"),
])  # fmt: skip
def test_a_map_of_the_wall_whose_holes_are_numbers_is_refused(tmp_path, value, sigma, words):
    """A hole that counts as 0 K, and a sigma that is not known and counts as 0, are no measurement."""
    mesh = Mesh.make([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], "wing")

    def read(*of):
        fields = dict(zip(("temperature", "sigma_temperature"), map(np.array, of), strict=True))
        write_nodes_netcdf(tmp_path / "T.nc", mesh, fields, units=dict.fromkeys(fields, "K"), history={})
        return read_map(tmp_path / "T.nc", SimpleNamespace(mesh=mesh), 0.2)

    with pytest.raises(FileError, match=words):
        read([295.0, 296.0, 297.0, value], [0.3, 0.3, 0.3, sigma])
    found = read([295.0, 296.0, 297.0, np.nan], [0.3, 0.3, 0.3, np.nan])
    assert found.known.tolist() == [True, True, True, False]


def test_a_map_is_taken_in_its_own_unit_on_nodes_that_are_moved_and_bent_and_on_no_others(tmp_path):
    """One in metres was refused as having "1581 nodes, not those of the grid, which has 1581"; other nodes passed."""
    x, y = np.meshgrid(np.linspace(0, 200, 21), np.linspace(0, 120, 13))
    xyz = np.c_[x.ravel(), y.ravel(), 10 - x.ravel() ** 2 / 4000]
    mesh = replace(Mesh.make(xyz, structured_triangles(21, 13), "wing"), length_unit="mm")

    def read(places, unit="mm"):
        values = {"temperature": np.linspace(290.0, 300.0, len(places))}
        other = replace(mesh.moved(np.asarray(places, float)), length_unit=unit)
        write_nodes_netcdf(tmp_path / "T.nc", other, values, units={"temperature": "K", "length": unit}, history={})
        return read_map(tmp_path / "T.nc", SimpleNamespace(mesh=mesh), 0.2).value

    values = read(xyz)
    assert read(xyz / 1000, "m").tolist() == values.tolist()
    bent = xyz + np.c_[np.zeros((len(xyz), 2)), 6 * (y.ravel() / 120) ** 2] + [3.0, -2.0, 1.0]
    assert read(bent).tolist() == values.tolist()
    clustered = xyz.copy()
    clustered[:, 0] = 200 * (x.ravel() / 200 + 0.06 * np.sin(np.pi * x.ravel() / 100))
    with pytest.raises(FileError, match="of the grid's triangles are of another length between its nodes"):
        read(clustered)
    with pytest.raises(FileError, match="its nodes lie up to 233 mm from those of the project's grid"):
        read(xyz[::-1])
    with pytest.raises(FileError, match="its nodes lie up to"):
        read(xyz / 1000)


@pytest.mark.parametrize(("names", "words"), [
    (["../a"], "a point's results go into a folder of its name, and this one cannot: '../a'"),
    (["."], "this one cannot: '.'"),
    (["CON"], "Windows keeps 'CON' for a device"),
    (["p02", "P02"], "'p02' and 'P02' are one name on many disks"),
    (["report.html"], "'report.html' is the name of a file of the results themselves"),
    (["Loads.csv"], "'loads.csv' and 'Loads.csv' are one name"),
])  # fmt: skip
def test_names_of_points_that_no_folder_can_have_are_refused(tmp_path, names, words):
    """Results of a point called ../a would land beside the results, and be lost."""
    with pytest.raises(FileError, match=re.escape(words)):
        read_points_table(written(tmp_path, "t.csv", HEAD, *(ROW.replace("a,", f"{n},", 1) for n in names)))
    good = [ROW.replace("a,", f"{n},", 1) for n in ("R12P03", "alpha 2.5", "p-1", "12")]
    assert len(read_points_table(written(tmp_path, "t.csv", HEAD, *good))) == 4


@pytest.mark.parametrize(("cells", "words"), [
    ("1,65000,0,99000,293,on.tif,off.tif,0", r"q_inf is 0 Pa: nothing has a Cp without wind.*\(line 3 of the table"),
    ("1,65000,0,99000,293,on.tif,off.tif,0.8", "q_inf is 0 Pa: nothing has a Cp"),
    ("1,65000,29000,99000,293,on.tif,off.tif,0", "Mach is 0: nothing has a Cp without wind"),
    ("1,0,29000,99000,293,on.tif,off.tif,0.8", "p_inf is 0 Pa: expected an absolute pressure"),
])  # fmt: skip
def test_a_row_without_wind_is_refused_alone(tmp_path, cells, words):
    good = "a,1,65000,29120,99000,293,on.tif,off.tif,0.8"
    rows = read_points_table(written(tmp_path, "t.csv", f"{HEAD},mach", good, f"tare,{cells}"))
    assert rows[0].conditions().q_inf == 29120
    with pytest.raises(DataError, match=words):
        rows[1].conditions()


@pytest.mark.parametrize(("t_0", "t_off", "words"), [
    ("29.0", "293", r"^T0 is 29 K, expected above 50 K: is it in the unit of its name\? \(line 3 of the table"),
    ("302", "20", "^T_off is 20 K, expected above 50 K"),
])  # fmt: skip
def test_a_row_whose_temperature_is_in_another_unit_is_refused_alone(tmp_path, t_0, t_off, words):
    head, cells = f"{HEAD},T0_K", "1,65000,29000,99000,{},on.tif,off.tif,{}"
    given = {"a": ("293", "302"), "b": (t_off, t_0), "c": ("293", "")}
    lines = [f"{name},{cells.format(*of)}" for name, of in given.items()]
    rows = read_points_table(written(tmp_path, "t.csv", head, *lines))
    assert rows[0].conditions().t_0 == 302
    assert np.isnan(rows[2].conditions().t_0)
    with pytest.raises(DataError, match=words):
        rows[1].conditions()


def test_what_mach_and_pressures_contradict_each_other_by_is_in_the_sigma(tmp_path):
    row = "{},1,{},{},99000,293,on.tif,off.tif,0.8,{}"
    p, q = 66025.9, 29579.6  # 0.7 M^2 p to 0.1 Pa
    cells = [(p, q, ""), (1.045 * p, q, ""), (1.02 * p, q, ""), (1.005 * p, q, 300), (66000, 29600, "")]
    rows = read_points_table(written(tmp_path, "t.csv", f"{HEAD},mach,sigma_p_inf_Pa", *(
        row.format(name, *of) for name, of in zip("abcde", cells, strict=True)
    )))  # fmt: skip
    right, wrong, little, within, rounded = rows
    assert right.conditions().cov is None
    assert contradiction_words(right.contradiction, p, q) == []
    assert wrong.contradiction == pytest.approx(0.045, rel=1e-4)
    sigma_p, sigma_q = np.sqrt(np.diag(wrong.conditions().cov))
    assert (sigma_p / (1.045 * p), sigma_q / q) == pytest.approx((0.045 / np.sqrt(3),) * 2, rel=1e-4)
    (said,) = contradiction_words(wrong.contradiction, 1.045 * p, q)
    assert said.startswith("Mach, p_inf and q_inf contradict each other by 4.5 %")
    assert "makes 0.1 in Cp" in said
    assert np.sqrt(little.conditions().cov[0, 0]) / q < 0.03  # in proportion
    assert within.contradiction == 0
    assert np.sqrt(within.conditions().cov[0, 0]) == pytest.approx(300)
    assert rounded.conditions().cov is None


def test_a_mach_number_is_as_exact_as_its_digits():
    """0.20 for 0.2031 is 3 % of q_inf, and no barometer is 2 % off."""
    p = 99000.0
    for mach, digits in ((0.2031, (2, 3)), (0.3031, (2, 3)), (0.8031, (2, 3))):
        q = dynamic_pressure(mach, p)
        assert [contradiction(round(mach, n), p, q, np.nan, np.nan) for n in digits] == [0, 0]
        assert contradiction(mach, 1.045 * p, q, np.nan, np.nan) == pytest.approx(0.045)
    assert contradiction(0.8, 1.045 * p, dynamic_pressure(0.8, p), np.nan, np.nan) == pytest.approx(0.045)


def test_a_point_most_of_whose_sigma_is_that_contradiction_is_doubted():
    point = PointRecord("p1", 0.0, {}, "reduced", seen=0.9, median_sigma_cp=0.06, flicker=0.0, contradiction_cp=0.058)
    verdict = psp_verdict([point])
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "units")
    assert "Mach, p_inf and q_inf of the table contradict each other" in verdict.reason
    assert psp_verdict([replace(point, contradiction_cp=0.01)]).word == GOOD
