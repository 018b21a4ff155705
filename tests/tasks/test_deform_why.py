"""Why a camera shows few markers: both sides of every cause, and which of them is said."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import windmark as wm
from windmark.tasks.clicked_pair.lines import relabelled
from windmark.tasks.deform.why import Levels, _edges_words, _in_sight, _levels_words, few, levels_of
from windmark.tasks.reconstruct.pair import _distance

GOOD = Levels(120.0, 200.0, 0.05, 30.0, 12.0, 12.0)


@pytest.mark.parametrize(
    ("found", "expected", "before", "is_few"),
    [(0, 0, 0, True), (6, 10, 10, False), (5, 10, 10, True), (6, 6, 10, False), (5, 5, 10, True), (1, 1, 0, False)],
)
def test_few_are_less_than_three_fifths_of_what_should_or_did_show(found, expected, before, is_few):
    assert few(found, expected, before) == is_few


@pytest.mark.parametrize(
    ("change", "good", "words"),
    [
        ({"middle": np.nan}, None, "no pixel can be used"),
        ({"span": 0.0}, None, "an empty picture: all pixels are 120"),
        ({"clipped": 0.19}, None, ""), ({"clipped": 0.21}, None, "saturated: 21 % of the pixels"),
        ({"clipped": 0.24}, GOOD, ""), ({"clipped": 0.26}, GOOD, "saturated: 26 %"),  # some were before, too
        ({"span": 71.0}, GOOD, ""),
        ({"span": 69.0}, GOOD, "dark: its grey levels span 69 (median 120), those of the last"),
        ({"span": 69.0, "middle": 121.0}, GOOD, "pale: its grey levels span 69"),
        ({"span": 69.0}, None, ""), ({}, GOOD, ""),
    ],
)  # fmt: skip
def test_levels_say_what_is_wrong_with_them(change, good, words):
    said = _levels_words(replace(GOOD, **change), good)
    assert said.startswith(words) if words else said == ""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, ""), ({"fine": 6.1}, ""), ({"fine": 5.9}, "the picture is sharp, but its markers are not where"),
        ({"fine": 5.9, "sharp": 5.9}, "blurred (motion or focus): 49 %"),
        ({"fine": 5.9, "sharp": 11.9}, "the picture is sharp"),
        ({"fine": 5.9, "sharp": 11.7}, "blurred"),
        ({"fine": 5.9, "sharp": 5.9, "coarse": 14.0}, "the contrast dropped to 49 %"),
        ({"fine": 5.9, "sharp": 5.9, "coarse": 60.0}, "blurred"),  # more light is no reason to expect more edges
    ],
)  # fmt: skip
def test_edges_tell_blur_from_lost_contrast_and_from_markers_that_are_elsewhere(change, words):
    said = _edges_words(replace(GOOD, **change), GOOD)
    assert said.startswith(words) if words else said == ""
    for none in ("fine", "coarse", "sharp"):
        assert _edges_words(replace(GOOD, **change), replace(GOOD, **{none: 0.0})) == ""


def test_who_should_be_in_sight_and_why_the_others_are_not():
    camera, pose = wm.Camera((200, 100), 100.0), wm.Pose.look_at([0.0, 0, 10.0], [0, 0, 0], [0, 1.0, 0])
    x = np.array([-5.0, -3.0, 0.0, 3.0, 5.0, 30.0, -30.0, 2.0])
    normal = np.tile([0.0, 0, 1.0], (8, 1))
    normal[[1, 6]] = [0, 0, -1.0]  # of the second one of these nobody says that it is out of the picture
    normal[0] = np.nan
    markers = wm.MarkerSet.make(list("abcdefgh"), np.column_stack([x, 0 * x, 0 * x]), normal=normal)
    hidden = np.array([False, False, False, True, False, True, False, False])
    xy, words = _in_sight(markers, camera, pose, hidden, 10)
    assert len(xy) == 4  # a, c, e, h
    assert words == "4 of 8 markers should be in sight (1 out of the picture, 1 hidden by the grid, 1 turned away)"
    assert _in_sight(markers, camera, pose, hidden, 6)[1] == ""  # about as many as before
    assert _in_sight(markers, camera, pose, hidden, 7)[1] != ""
    assert len(_in_sight(markers, camera, pose, None, 1)[0]) == 5


def test_levels_are_those_of_the_pixels_that_count():
    picture = np.tile(np.arange(200.0), (100, 1))
    picture[:, 150:] = np.nan
    mask = np.ones(picture.shape, bool)
    mask[:, :50] = False
    got = levels_of(picture, mask, np.zeros((0, 2)), np.nan)
    assert got.middle == pytest.approx(99.5)
    assert got.span == pytest.approx(99, abs=1)
    assert np.isnan(levels_of(np.full((5, 5), np.nan), None, np.zeros((0, 2)), np.nan).middle)
    full = levels_of(
        np.where(np.arange(100) < 30, 255, 10).astype(np.uint8)[None].repeat(50, 0), None, np.zeros((0, 2)), np.nan
    )
    assert full.clipped == pytest.approx(0.3)


def test_matches_keep_the_users_names_and_the_others_get_free_ones():
    class Result:
        click = np.array([1, -1, 0, -1])
        spot_a, spot_b = np.array([3, 0, 1, 2]), np.array([0, 1, 2, 3])

    class Clicks:
        name, named = ("m001", "left"), True

    spots = tuple(wm.Detections.make(np.arange(8.0).reshape(4, 2) + k) for k in (0, 100))
    table = relabelled(Result, Clicks, ("a.tif", "b.tif"), spots)
    assert table["name"].tolist() == ["left", "m002", "m001", "m003"] * 2
    assert table["image"].tolist() == ["a.tif"] * 4 + ["b.tif"] * 4
    np.testing.assert_array_equal(table["x"][:4], spots[0].xy[Result.spot_a, 0])
    np.testing.assert_array_equal(table["y"][4:], spots[1].xy[Result.spot_b, 1])
    Clicks.named = False
    assert relabelled(Result, Clicks, ("a", "b"), spots)["name"].tolist() == ["m001", "m002", "m003", "m004"] * 2


def test_distance_from_a_line_of_parts_is_the_least_over_its_points():
    rng = np.random.default_rng(2)
    line = rng.uniform(0, 10, (9, 2))
    line[4] = np.nan
    for p in rng.uniform(-3, 13, (20, 2)):
        t = np.linspace(0, 1, 2001)[:, None]
        parts = [(1 - t) * a + t * b for a, b in pairwise(line) if np.isfinite([a, b]).all()]
        assert _distance(p, line) == pytest.approx(min(np.hypot(*(q - p).T).min() for q in parts), abs=1e-4)
    assert np.isnan(_distance(np.zeros(2), np.full((3, 2), np.nan)))
