"""A picture that two points have was taken once: rows that say otherwise of that instant are told, others are not."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.pipeline.psp import REDUCED, PointRecord
from windmark.pipeline.psp.shared import shared_pictures
from windmark.pipeline.psp.table import PointRow
from windmark.pipeline.verdict import DOUBTFUL
from windmark.pipeline.verdict.paint import psp_verdict, shared_findings

NAN = float("nan")
ROW = PointRow("p1", 4.0, NAN, 0.8, 66e3, 29.6e3, 302.0, 99.6e3, 293.0, "on-*.tif", "off-*.tif", NAN, NAN, 2)


def record(name, **taken):
    """A point with pictures: content=(kind, name, camera)."""
    return PointRecord(name, 4.0, {}, REDUCED, seen=0.9, median_sigma_cp=0.01, flicker=0.0,
                       taken={key.encode(): of for key, of in taken.items()})  # fmt: skip


def told(second, first=None, *, kinds=("wind-on", "wind-on"), cameras=("cam1", "cam1")):
    """What is told of two points with one picture in common, by the row of the second one."""
    pair = [
        record(f"p{k + 1}", x=(kinds[k], f"{k}.tif", cameras[k]), **{f"own{k}": ("wind-on", "own.tif", "cam1")})
        for k in (0, 1)
    ]
    return shared_pictures(pair, [ROW if first is None else first, replace(second, name="p2")])


def test_wind_on_pictures_of_two_points_with_other_conditions_are_doubted():
    pair = [record(f"p{k}", **{f"x{c}": ("wind-on", f"on-{c}.tif", f"cam{c}") for c in "12"}) for k in (1, 2)]
    other = replace(ROW, name="p2", mach=0.7, p_inf=72e3, q_inf=24696.0)
    found = shared_findings(pair, [ROW, other])
    verdict = psp_verdict(pair, further=found)
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "picture")
    assert verdict.reason == (
        "p2: points p1 and p2 have the same wind-on pictures, 2 of them (first on-1.tif), but their rows say Mach 0.8 "
        "and 0.7, p_inf 66000 Pa and 72000 Pa, q_inf 29600 Pa and 24696 Pa"
    )
    assert psp_verdict(pair).word != DOUBTFUL


@pytest.mark.parametrize("key", ["mach", "p_inf", "q_inf", "t_0"])
def test_each_quantity_of_the_stream_is_compared_and_rounding_is_none(key):
    assert len(told(replace(ROW, **{key: 1.02 * getattr(ROW, key)}))) == 1
    assert told(replace(ROW, **{key: 1.0005 * getattr(ROW, key)})) == []
    assert told(replace(ROW, **{key: np.nan})) == []
    assert told(replace(ROW, p_off=90e3)) == []  # of the wind-off pictures


def test_wind_off_pictures_may_be_those_of_several_rows_that_say_the_same_of_them():
    off = ("wind-off", "wind-off")
    assert told(replace(ROW, mach=0.7, p_inf=72e3, p_off=99.9e3, t_off=294.0), kinds=off) == []
    ((point, words),) = told(replace(ROW, p_off=90e3), kinds=off)
    assert point == "p2"
    assert words.endswith("same wind-off picture 1.tif, but their rows say p_off 99600 Pa and 90000 Pa")
    parts = ("wind-off (at 0 degrees)", "wind-off (at 0 degrees)")
    assert told(replace(ROW, p_off=90e3), kinds=parts) == []


def test_a_point_that_others_are_compared_with_is_their_reference_at_its_own_pressure():
    ((_, words),) = told(ROW, kinds=("wind-on", "wind-off"))
    assert words.endswith("but p1 has it as wind-on at p_inf 66000 Pa, p2 as wind-off at p_off 99600 Pa")
    slow = replace(ROW, mach=0.1, p_inf=99.5e3, q_inf=700.0)
    assert told(ROW, slow, kinds=("wind-on", "wind-off")) == []


def test_a_picture_of_two_cameras_is_told():
    ((_, words),) = told(ROW, cameras=("cam1", "cam2"))
    assert words.endswith("but it is of cam1 and of cam2")


def test_other_pictures_under_the_same_names_are_no_matter():
    names = {"a": ("wind-on", "on-1.tif", "cam1")}, {"b": ("wind-on", "on-1.tif", "cam1")}
    rows = [ROW, replace(ROW, name="p2", mach=0.7)]
    assert shared_pictures([record("p1", **names[0]), record("p2", **names[1])], rows) == []
