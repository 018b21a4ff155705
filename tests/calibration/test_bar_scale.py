"""A scale bar in another unit than the rough table, and one that gives another scale than it."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.calibration import Calibration, Distance, Free, NotCalibrated, self_calibrate
from windmark.errors import UsageError
from windmark.scene import MarkerSet
from windmark.tasks.calibrate.run import CalibrateSettings, check_asked


@pytest.fixture(scope="module")
def case():
    return networks.make(35, points=20, views=6)


def run(case, times, rough=1.0, ends=((4, 9),)):
    observations, markers, cameras, views, _ = networks.nouns(case, start=case.start.points * rough)
    lengths = [float(np.linalg.norm(case.truth.points[a] - case.truth.points[b])) * times for a, b in ends]
    bars = [
        Distance(f"m{a:02d}", f"m{b:02d}", length, length * 1e-4) for (a, b), length in zip(ends, lengths, strict=True)
    ]
    markers = replace(markers, length_unit="mm")
    return self_calibrate(observations, markers, cameras, views, datum=Free(), distances=bars)


@pytest.mark.parametrize(("times", "unit"), [(1e-3, "m"), (1 / 25.4, "inch"), (0.1, "cm")])
def test_a_bar_in_another_unit_than_the_table_is_refused_with_the_unit(case, times, unit):
    result = run(case, times)
    assert isinstance(result, NotCalibrated)
    assert result.cause == "units"
    assert f"the distance is in {unit}, the places in mm" in result.reason


def test_it_is_said_before_a_picture_is_looked_at():
    markers = replace(MarkerSet.make(["a", "b", "c"], 300 * np.eye(3)), length_unit="mm")
    with pytest.raises(UsageError, match="the distance is in m, the places in mm"):
        check_asked(markers, CalibrateSettings(Free(), distances=(Distance("a", "b", 0.424, 1e-4),)))
    check_asked(markers, CalibrateSettings(Free(), distances=(Distance("a", "b", 424.0, 0.1),)))
    check_asked(markers, CalibrateSettings(Free(), distances=(Distance("a", "b", 500.0, 0.1),)))


def test_a_bar_that_makes_everything_half_as_large_is_doubted_and_a_rough_table_is_not(case):
    half = run(case, 0.5)
    assert isinstance(half, Calibration)
    said = [str(d) for d in half.doubts if d.cause == "control"]
    assert len(said) == 1
    assert "m04 to m09 makes the markers 2 times smaller than their table" in said[0]
    assert "a second known distance would tell" in said[0]
    assert [d for d in run(case, 1.0).doubts if d.cause == "control"] == []
    guessed = run(case, 1.0, rough=1.3, ends=((4, 9), (3, 12)))  # two that agree are right against a guessed table
    assert [d for d in guessed.doubts if d.cause == "control"] == []
    assert [d for d in run(case, 1.0, rough=1.008).doubts if d.cause == "control"] == []
