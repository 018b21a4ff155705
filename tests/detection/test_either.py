"""Dark markers, or bright ones where dark ones are not there."""

from dataclasses import fields

import numpy as np
import pytest

import windmark as wm
from windmark import detection
from windmark.detection import find_markers
from windmark.synth.scenes import marker_scene


def sheet(seed, dark=(), bright=(), level=1000.0, depth=200.0, noise=6.0, radius=4.0, shape=(220, 300)):
    """Discs on a sheet with noise, at (x, y)."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    image = np.full(shape, level)
    for sign, places in ((-1, dark), (1, bright)):
        for px, py in places:
            image += sign * depth * 0.5 * (1 - np.tanh(1.5 * (np.hypot(x - px, y - py) - radius)))
    return np.round(image + np.random.default_rng(seed).normal(0, noise, shape)).astype(np.uint16)


GRID = [(40.3 + 50 * i, 35.7 + 45 * j) for i in range(5) for j in range(4)]


def same(a, b):
    for field in fields(a):
        np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))


@pytest.mark.parametrize("kind", ["clean", "cluttered"])
@pytest.mark.parametrize("radius_px", [None, (3, 4, 5)])
def test_pictures_with_dark_markers_are_as_before(kind, radius_px):
    image = marker_scene(4, kind, size_px=(700, 500)).image
    look = find_markers(image, radius_px=radius_px)
    assert look.polarity == "dark"
    assert look.words == ""
    same(look.detections, wm.detect(image, radius_px=radius_px, polarity="dark"))
    same(wm.detect(image, radius_px=radius_px, polarity="auto"), look.detections)


@pytest.mark.parametrize("radius_px", [None, (3, 4, 5)])
def test_warm_markers_are_found_and_said(radius_px):
    scene = marker_scene(5, "infrared")
    look = find_markers(scene.image, radius_px=radius_px)
    assert look.polarity == "bright"
    assert look.words == f"bright markers: {len(look.detections)} found (no dark ones)"
    assert len(look.detections) > 50
    same(look.detections, wm.detect(scene.image, radius_px=radius_px, polarity="bright"))
    found, rejected = detection.explain(scene.image, radius_px=radius_px, polarity="auto")
    same(found, look.detections)
    assert len(rejected) >= 0
    assert detection.why_none(scene.image, radius_px=radius_px, polarity="auto") == ""
    assert len(wm.detect(scene.image, radius_px=radius_px)) == 0  # the default has its meaning still


def test_cold_plugs_of_infrared_are_dark():
    scene = marker_scene(5, "infrared")
    look = find_markers(scene.image.max() - scene.image)
    assert look.polarity == "dark"
    assert len(look.detections) > 50


@pytest.mark.parametrize("radius_px", [None, 4.0])
def test_where_both_are_there_dark_ones_are_taken(radius_px):
    image = sheet(1, dark=GRID[:5], bright=GRID[5:])
    look = find_markers(image, radius_px=radius_px)
    assert (look.polarity, len(look.detections), look.words) == ("dark", 5, "")


def test_highlights_never_pass_for_markers_silently():
    three = sheet(2, dark=GRID[:3], bright=GRID[3:], depth=200.0)
    assert find_markers(three, radius_px=4.0).polarity == "dark"
    one = find_markers(sheet(3, dark=GRID[:1], bright=GRID[1:3]), radius_px=4.0)
    assert one.polarity == "dark"
    assert len(one.detections) == 1
    assert one.words == "2 bright spots beside 1 dark: say the polarity if they are the markers"
    none = find_markers(sheet(4, bright=GRID[:2]), radius_px=4.0)
    assert len(none.detections) == 0
    assert "2 bright spots beside 0 dark" in none.words
    many = find_markers(sheet(5, dark=GRID[:2], bright=GRID[2:]), radius_px=4.0)
    assert many.polarity == "bright"
    assert many.words == "bright markers: 18 found (2 dark ones)"
    even = find_markers(sheet(6, dark=GRID[:2], bright=GRID[2:5]), radius_px=4.0)  # not four times the evidence
    assert (even.polarity, len(even.detections)) == ("dark", 2)


@pytest.mark.parametrize("radius_px", [None, 4.0])
@pytest.mark.parametrize("image", [np.full((60, 80), 9, np.uint8), sheet(7), np.full((60, 80), np.nan)])
def test_nothing_is_an_answer(image, radius_px):
    look = find_markers(image, radius_px=radius_px)
    assert len(look.detections) == 0
    assert detection.why_none(image, radius_px=radius_px, polarity="auto")


def test_only_the_best_where_few_are_wanted():
    image = sheet(8, bright=GRID)
    look = find_markers(image, radius_px=4.0, max_spots=1)
    assert (look.polarity, len(look.detections)) == ("bright", 1)
    same(look.detections, wm.detect(image, radius_px=4.0, polarity="bright", max_spots=1))
    image = sheet(8, dark=GRID)
    assert len(find_markers(image, radius_px=4.0, max_spots=2).detections) == 2


def test_wrong_words():
    with pytest.raises(ValueError, match="polarity must be one of auto, dark, bright, got 'light'"):
        find_markers(sheet(1), polarity="light")
    with pytest.raises(ValueError, match="refine must be one of"):
        find_markers(sheet(1), refine="disc")
