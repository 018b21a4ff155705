"""What known markers do not tell of each other's errors, and that it is said of a good network."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.calibration import Calibration, Fixed, Free, Weighted, self_calibrate
from windmark.calibration.hardly_checked import hardly_checked_words
from windmark.pipeline.verdict.network import _unchecked

SIGMA = 0.2
SQUARE = [(-270, -210), (270, -210), (270, 210), (-270, 210)]
SIX = [*SQUARE, (0, -230), (0, 230)]
LINE = [(-280, -60), (0, -60), (280, -60), (60, 220)]


@pytest.fixture(scope="module")
def case():
    return networks.make(3, points=60, views=8)


def nearest(case, places):
    """The markers that are nearest to some places in the plane."""
    at = [int(np.linalg.norm(case.truth.points[:, :2] - p, axis=1).argmin()) for p in places]
    assert len(set(at)) == len(at)
    return at


def run(case, index, off=None, datum=Weighted, reject=True):
    """With markers known exactly, ``off`` (marker, vector) moves one of them in the table."""
    xyz = case.start.points.copy()
    xyz[index] = case.truth.points[index]
    if off is not None:
        xyz[off[0]] += off[1]
    observations, markers, cameras, views, _ = networks.nouns(case, start=xyz, camera=networks.CAMERA)
    sigma = np.full((len(xyz), 3), np.nan)
    sigma[index] = SIGMA
    names = markers.name[index].tolist()
    return self_calibrate(
        observations, replace(markers, length_unit="mm", sigma=sigma), cameras, views, datum=datum(names), free=(),
        reject=reject,
    )  # fmt: skip


def along(hardly):
    return hardly.error * np.eye(3)["xyz".index(hardly.axis)]


@pytest.mark.parametrize("places", [SQUARE, LINE])
def test_an_error_of_one_of_four_that_goes_unnoticed_does_what_was_told(case, places):
    index = nearest(case, places)
    right = run(case, index)
    assert right.doubts == ()
    worst = right.hardly_checked[0]
    assert worst.point in index
    assert worst.marker != worst.point
    part = 0.5 if worst.share > 0.01 else 3 * SIGMA / worst.error
    wrong = run(case, index, (worst.point, part * along(worst)))
    assert isinstance(wrong, Calibration)
    assert wrong.doubts == ()  # nothing shows
    moved = np.abs(wrong.markers.xyz - right.markers.xyz)
    at = "xyz".index(worst.axis)
    assert moved[worst.marker, at] == pytest.approx(part * worst.moved, rel=0.1)
    assert wrong.unchecked
    assert str(wrong.markers.name[worst.point]) in wrong.unchecked


def test_an_error_that_is_half_as_large_again_is_noticed(case):
    index = nearest(case, SQUARE)
    worst = run(case, index).hardly_checked[0]
    wrong = run(case, index, (worst.point, 1.5 * along(worst)))
    assert not isinstance(wrong, Calibration) or any(d.cause == "control" for d in wrong.doubts)


def test_it_is_said_of_a_good_network_and_is_no_doubt(case):
    result = run(case, nearest(case, LINE))
    assert result.doubts == ()
    assert result.hardly_checked[0].point == nearest(case, LINE)[3]  # it alone is off the line of the others
    said, step = _unchecked(result)
    assert said == f"; {result.unchecked}"
    assert f"a further known marker near m{nearest(case, LINE)[3]:02d} would check it" in step


def test_six_that_are_far_apart_check_each_other(case):
    result = run(case, nearest(case, SIX))
    assert result.hardly_checked == ()
    assert result.unchecked == ""
    assert _unchecked(result) == ("", "")


@pytest.mark.parametrize("datum", [Free, Fixed])
def test_what_has_no_sigma_is_not_asked(case, datum):
    assert run(case, nearest(case, SQUARE), datum=datum).hardly_checked == ()


def test_words_name_marker_numbers_and_axis(case):
    result = run(case, nearest(case, LINE))
    worst = replace(result.hardly_checked[0], point=0, marker=1, axis="z", share=0.1, error=0.9, sigmas=9.0, moved=2.0,
                    times=12.0)  # fmt: skip
    words = hardly_checked_words([worst, replace(worst, point=2, share=1e-3)], (), result.markers)
    assert "hardly check m00: an error of up to 0.9 mm of it (9 of its sigmas, along z mostly)" in words
    assert "moves m01 by up to 2 mm, 12 of its sigmas; hardly checked as well: m02 (along z, by nothing)" in words
    words = hardly_checked_words([worst, replace(worst, point=2, axis="x")], (), result.markers)
    assert words.endswith("hardly checked as well: m02 (up to 0.9 mm along x, which moves m01 by 2 mm)")
    none = hardly_checked_words([replace(worst, share=1e-3)], (), result.markers)
    assert none.startswith("nothing checks the known marker m00 along z: an error there moves m01 2.2 times as far")
