"""Lists of places are read before a run, whichever project names them."""

import pytest

from windmark.errors import WindmarkError
from windmark.pipeline.check_places import places_tables

GOOD, BAD = "name,x,y,z\na,1,2,3\nb,1,2,4\n", "name,x,y\na,1,2\n"


@pytest.mark.parametrize(("settings", "key"), [
    ({"points": [{"file": "p.csv"}]}, "points[0].file"),
    ({"place": [{"file": "none.csv"}, {"file": "p.csv"}], "points": {"table": "points.csv"}}, "place[1].file"),
    ({"taps": {"file": "p.csv", "pressures": "q.csv"}}, "taps.file"),
    ({"temperature": {"thermocouples": "p.csv"}}, "temperature.thermocouples"),
])  # fmt: skip
def test_each_list_is_read_and_named_by_its_key(tmp_path, settings, key):
    (tmp_path / "p.csv").write_text(GOOD)
    found = list(places_tables(tmp_path / "psp.toml", settings))
    assert [k for k, _ in found] == [key]
    assert found[0][1]() == "2 places of p.csv"
    (tmp_path / "p.csv").write_text(BAD)
    with pytest.raises(WindmarkError, match="no column 'z'"):
        found[0][1]()


def test_what_is_no_list_is_left_to_the_project(tmp_path):
    assert not list(places_tables(tmp_path / "p.toml", {"points": [3], "taps": "x", "place": {"file": 1}}))
