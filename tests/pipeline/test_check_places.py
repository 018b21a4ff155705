"""Lists of places are read before a run, whichever project names them."""

import pytest

from windmark.pipeline.check.places import place_lists


@pytest.mark.parametrize(("settings", "key", "roles"), [
    ({"points": [{"file": "p.csv", "roles": ["tap"]}]}, "points[0].file", ["tap"]),
    ({"place": [{"file": "none.csv"}, {"file": "p.csv"}], "points": {"table": "points.csv"}}, "place[1].file", None),
    ({"taps": {"file": "p.csv", "pressures": "q.csv", "roles": "tap"}}, "taps.file", None),
    ({"temperature": {"thermocouples": "p.csv"}}, "temperature.thermocouples", None),
])  # fmt: skip
def test_each_list_is_named_by_its_key(tmp_path, settings, key, roles):
    (tmp_path / "p.csv").write_text("")
    assert list(place_lists(tmp_path / "psp.toml", settings)) == [(key, tmp_path / "p.csv", roles)]


def test_what_is_no_list_is_left_to_the_project(tmp_path):
    assert not list(place_lists(tmp_path / "p.toml", {"points": [3], "taps": "x", "place": {"file": 1}}))
