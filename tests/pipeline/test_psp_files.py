"""Small files of a paint project that are read alone: linearity, polygons, colours of the table of points."""

import numpy as np
import pytest

from windmark.errors import DataError
from windmark.geometry import Camera, Pose
from windmark.io import FileError
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.psp.load import read_polygons
from windmark.pipeline.psp.outputs import on_pixels
from windmark.pipeline.psp.sensors import read_linearity
from windmark.pipeline.psp.table import read_points_table
from windmark.pipeline.psp.wtd import read_wtd
from windmark.resection import map_pixels
from windmark.scene import Mesh

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
