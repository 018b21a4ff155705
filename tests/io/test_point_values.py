"""Tables of values at points: numbers that are none, whole numbers and texts in each of the formats."""

import h5py
import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.io.point_tables import FILL, write_point_values

COLUMNS = {
    "name": np.array(["P1", "", "P3"]),
    "x": np.array([1.5, -2.25, 3.0]),
    "count": np.array([4, 0, 7]),
    "cp": np.array([0.125, np.nan, -np.inf]),
}
UNITS = {"length": "mm", "x": "mm", "cp": "1"}


def test_tecplot_has_the_fill_value_it_names_where_there_is_no_number_and_texts_beside(tmp_path):
    write_point_values(tmp_path / "a.dat", COLUMNS, units=UNITS, title='taps "A"', about={"p inf": "98 kPa"})
    lines = (tmp_path / "a.dat").read_text().splitlines()
    assert f'DATASETAUXDATA NanValue = "{FILL:.9g}"' in lines
    assert 'DATASETAUXDATA PInf = "98 kPa"' in lines
    assert "TITLE = \"taps 'A'\"" in lines
    assert 'AUXDATA name_1 = "P1"' in lines
    assert 'AUXDATA name_3 = "P3"' in lines
    assert not [line for line in lines if "name_2" in line]
    rows = [[float(v) for v in line.split()] for line in lines[-3:]]
    assert rows == [[1.5, 4, 0.125], [-2.25, 0, pytest.approx(FILL)], [3.0, 7, pytest.approx(FILL)]]
    assert lines[-1].split()[1] == "7"  # a whole number is written as one


def test_netcdf_has_all_columns_as_they_are(tmp_path):
    write_point_values(tmp_path / "a.nc", COLUMNS, units=UNITS)
    with h5py.File(tmp_path / "a.nc") as found:
        for name in ("x", "count", "cp"):
            np.testing.assert_array_equal(found[name][:], COLUMNS[name])
        assert [text.decode() for text in found["name"][:]] == COLUMNS["name"].tolist()
        assert found["x"].attrs["units"] == "mm"


def test_another_ending_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"must end in \.csv, \.dat or \.nc"):
        write_point_values(tmp_path / "a.xls", COLUMNS, units=UNITS)
    assert not list(tmp_path.iterdir())
