"""Tables of a paint test are read before it is run: what is wrong with each in a sentence, with its key."""

import pytest

from windmark.errors import WindmarkError
from windmark.pipeline.check.paint import paint_tables

HEAD = "point,alpha_deg,mach,p_inf_Pa,q_inf_Pa,p_off_Pa,T_off_K,on,off\n"
ROW = "{0},0,0.8,65900,29523,99500,293,on-{{camera}}.tif,off-{{camera}}.tif\n"


@pytest.fixture
def look(tmp_path):
    (tmp_path / "on-cam1.tif").write_bytes(b"")
    (tmp_path / "off-cam1.tif").write_bytes(b"")

    def read(points, more=None, **data):
        (tmp_path / "points.csv").write_text(points)
        for name, text in (more or {}).items():
            (tmp_path / name).write_text(text)
        settings = {"camera": [{"name": "cam1"}], "points": {"table": "points.csv"}, **data}
        out = {}
        for key, reader in paint_tables(tmp_path / "psp.toml", settings):
            try:
                out[key] = reader()
            except WindmarkError as error:
                out[key] = f"wrong: {error}"
        return out

    return read


def test_sound_tables_are_told_by_what_they_hold(look):
    taps = "point,name,pressure_kPa\na,t1,60\na,t2,61\nb,t1,60\n"
    found = look(HEAD + ROW.format("a") + ROW.format("b"), {"p.csv": taps}, taps={"pressures": "p.csv"})
    assert found == {"points.table": "2 points", "taps.pressures": "pressure readings of 2 points"}


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (HEAD.replace(",q_inf_Pa", "") + ROW.replace(",29523", "").format("a"), "has no column q_inf_..."),
        (HEAD.replace("q_inf_Pa", "q_inf_torr") + ROW.format("a"), "its unit is not known"),
        (HEAD + ROW.format("a").replace("65900", "much"), "expected a finite number"),
        (HEAD + ROW.format("a") + ROW.format("b").replace("29523", "295"), "1 of 2 points cannot be reduced: b: q_inf"),
        (HEAD + ROW.format("a").replace("off-", "of-"), "no wind-off picture matches 'of-{camera}.tif' (line 2)"),
        (HEAD + ROW.format("a").replace("off-{camera}.tif", ""), "names no wind-off pictures (line 2)"),
    ],
)
def test_what_is_wrong_with_points_is_said(look, points, words):
    found = look(points)["points.table"]
    assert found.startswith("wrong: ")
    assert words in found


def test_many_points_are_counted_and_some_named(look):
    found = look(HEAD + "".join(ROW.format(n).replace("29523", "295") for n in "abcdef"))["points.table"]
    assert "6 of 6 points cannot be reduced: a: " in found
    assert found.endswith("; and 3 more")


def test_a_tap_twice_is_said_at_its_table(look):
    found = look(HEAD + ROW.format("a"), {"p.csv": "point,name,pressure_Pa\na,t1,60000\na,t1,61000\n"},
                 taps={"pressures": "p.csv"})  # fmt: skip
    assert "'t1' is there more than once" in found["taps.pressures"]
    assert found["points.table"] == "1 point"
