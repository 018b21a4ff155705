"""Every picture of a point, and every row of a cell's table, is one measurement, however often it is there."""

import numpy as np
import pytest

from windmark import io
from windmark.errors import DataError
from windmark.pipeline.psp.cell import calibrate_paint, read_cell
from windmark.pipeline.psp.once import Once
from windmark.pipeline.psp.sensors import CameraSensor
from windmark.pipeline.psp.taken import Taken
from windmark.pipeline.same_picture import content_of, first_of


def pictures(*names, seed=0):
    out = []
    for name in names:
        image = np.random.default_rng(seed + len(out)).integers(0, 4000, (8, 9)).astype(np.uint16)
        out.append(Taken(name, image, content=content_of(image)))
    return out


def test_a_print_is_that_of_the_grey_levels():
    a = np.arange(12, dtype=np.uint16).reshape(3, 4)
    other = a.copy()
    other[2, 1] += 1
    prints = [content_of(x) for x in (a, np.asfortranarray(a), other, a.reshape(4, 3), a[:, ::-1][:, ::-1])]
    assert first_of(prints) == [0, 0, 2, 3, 0]


def test_other_pictures_of_all_kinds_are_left_as_they_are():
    once = Once({})
    on, off = {"a": pictures("1", "2"), "b": pictures("1", "2", seed=5)}, {"a": pictures("3", "4", seed=9)}
    assert once.of("wind-on", on) == on
    assert once.of("wind-off", off) == off
    assert once.remarks == []


def test_pictures_that_are_wind_on_and_wind_off_refuse_the_point_whatever_they_are_called():
    once = Once({})
    once.of("wind-on", {"cam1": pictures("on-0.tif", "on-1.tif"), "cam2": pictures("on-0.tif", seed=5)})
    with pytest.raises(DataError) as error:
        once.of("wind-off", {"cam1": [*pictures("off-0.tif"), *pictures("off-7.tif", seed=30)]})
    assert "wind-off picture off-0.tif of cam1 is wind-on picture on-0.tif of cam1" in str(error.value)
    assert "off-7" not in str(error.value)
    with pytest.raises(DataError, match="and 2 more"):
        Once.of(once, "wind-off", {"cam1": 5 * pictures("off-0.tif")})


def test_a_picture_of_two_cameras_and_a_dark_picture_that_is_a_points_are_refused():
    once = Once({})
    with pytest.raises(DataError, match=r"wind-on picture x\.tif of cam2 is wind-on picture x\.tif of cam1"):
        once.of("wind-on", {"cam1": pictures("x.tif"), "cam2": pictures("x.tif")})
    (dark,) = pictures("x.tif")
    sensor = CameraSensor(None, "", contents={dark.content: "dark picture d.tif"})  # type: ignore[arg-type]
    with pytest.raises(DataError, match=r"wind-off picture x\.tif of cam1 is dark picture d\.tif of cam1"):
        Once({"cam1": sensor}).of("wind-off", {"cam1": [dark]})


def test_a_copy_within_a_kind_counts_once_in_its_place_and_is_said():
    once = Once({})
    bad = Taken("c", None, why="damaged")
    found = once.of("wind-on", {"a": [*pictures("1"), *pictures("2"), bad, *pictures("3", seed=4)]})["a"]
    assert [p.image is None for p in found] == [False, True, True, False]
    assert [p.copy for p in found] == [False, True, False, False]
    assert once.remarks == ["wind-on picture 2 of a is the same picture as 1: it counts once"]


def cell(folder, times, *, temperature_only=False, first="run"):
    p, t = (a.ravel() for a in np.meshgrid(np.linspace(2e4, 1.2e5, 8), np.linspace(280, 310, 5)))
    noise = 0.001 * np.random.default_rng(2).normal(size=p.size)
    ratio = (0.1 + 0.9 * p / 1e5) * np.exp(0.01 * (t - 293)) * (1 + noise)
    columns = {first: np.arange(p.size), "temperature_K": t, "ratio": ratio if not temperature_only else t / 293}
    columns |= {} if temperature_only else {"pressure_Pa": p}
    columns = {k: np.tile(v, times) for k, v in columns.items()}
    io.write_table(folder / f"cell{times}.csv", columns)
    return read_cell(folder / f"cell{times}.csv", pressure=not temperature_only)


def test_rows_of_a_cell_that_are_there_again_count_once_and_are_said(tmp_path):
    one, many = (calibrate_paint(cell(tmp_path, n), p_ref_Pa=1e5, t_ref_K=293.15) for n in (1, 4))
    np.testing.assert_array_equal(one.law.cov, many.law.cov)
    words = "120 of 160 rows of cell4.csv are the same as earlier ones and count once; the first: line 42 is line 2"
    assert many.warnings == (*one.warnings, words)
    warm = cell(tmp_path, 2, temperature_only=True)
    assert len(warm.remarks) == 1


def test_measurements_that_agree_but_were_made_at_other_times_are_two(tmp_path):
    (tmp_path / "c.csv").write_text("time,pressure_Pa,temperature_K,ratio\n1,5e4,293,0.5\n2,5e4,293,0.5\n")
    found = read_cell(tmp_path / "c.csv")
    assert len(found.ratio) == 2
    assert found.remarks == ()
