"""Small files of a paint project that are read alone: linearity, polygons, colours of the table of points."""

import pytest

from windmark.io import FileError
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.psp.load import read_polygons
from windmark.pipeline.psp.sensors import read_linearity
from windmark.pipeline.psp.table import read_points_table

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
