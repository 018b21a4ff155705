"""Readings of points that the table does not have: told as a fault where they are meant for one that it has."""

from pathlib import Path

import numpy as np
import pytest

from windmark import io
from windmark.pipeline.psp.strangers import strangers
from windmark.pipeline.psp.table import SensorTable
from windmark.pipeline.verdict.paint import stranger_findings

PLACES = io.PointList(np.array(["T1"]), np.zeros((1, 3)), np.full((1, 3), np.nan), np.array([""]), np.array([""]))


def said(points, *readings, sensor="T1"):
    table = SensorTable(Path("readings.csv"), {p: {sensor: (1e5, 50.0)} for p in readings})
    return strangers(table, PLACES, points)


@pytest.mark.parametrize("name", ["P02", "p-02", "p2", "P 002", "p_2"])
def test_a_point_that_is_written_in_another_way_is_told(name):
    (words,) = said(["p01", "p02"], "p01", name)
    assert words == f"readings.csv: no reading of point p02; those of {name} are of no point of the table of points"
    (found,) = stranger_findings(["no [[lamp]] is given", words])
    assert (found.word, found.cause, found.reason) == ("doubtful", "file", words)


def test_readings_of_another_test_are_told():
    (words,) = said(["p01", "p02"], "q1", "q2")
    assert words.startswith("readings.csv: no reading of any point; all of them, as those of q1, are of no point")
    assert len(stranger_findings([words])) == 1


def test_readings_of_more_points_than_are_reduced_and_points_without_any_are_no_fault():
    assert said(["p01", "p02"], "p01", "p02", "p03", "P01") == []
    assert said(["p01", "p02"], "p01") == []
    (words,) = said(["p01", "p12"], "p01", "p02", "p20")
    assert words.startswith("readings.csv: no reading of point p12, but of points p02, p20, which the table of points")
    assert stranger_findings([words]) == []
    (words,) = said(["p01"], "p01", sensor="T9")
    assert words == "readings.csv: 1 sensors have readings but no place: T9"
