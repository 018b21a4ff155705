"""What the detector makes of an image's type, levels and dead pixels."""

from pathlib import Path

import numpy as np
import pytest

from windmark.detection.dead import dead_pixels
from windmark.detection.image import check_image, grey_rows, levels_of, prepare, usable_sample


@pytest.mark.parametrize(
    "dtype", [np.uint8, np.int16, np.uint16, np.int32, np.uint32, np.uint64, np.float32, np.float64]
)
def test_grey_levels_survive(dtype):
    image = np.random.default_rng(0).integers(0, 120, (30, 40)).astype(dtype)
    for sign in (1.0, -1.0):
        got = prepare(image, sign)
        assert got.g.dtype == np.float32
        assert not got.missing
        np.testing.assert_array_equal(np.diff(got.g, axis=1), sign * np.diff(image.astype(float), axis=1))
        assert got.quantum == 1.0


def test_extremes_do_not_overflow():
    image = np.zeros((20, 20), np.uint8)
    image[::2] = 255
    assert np.ptp(prepare(image, 1.0).g) == 255
    wide = np.full((20, 20), 2**40, np.int64)
    wide[::2] += 3
    assert np.ptp(prepare(wide, -1.0).g) == 3
    assert np.ptp(prepare(wide.astype(np.float64), 1.0).g) == 3


def test_step_between_grey_levels():
    ramp = np.arange(400).reshape(20, 20)
    assert prepare((ramp * 16).astype(np.uint16), 1.0).quantum == 16
    assert prepare((ramp * 257.0), 1.0).quantum == 257
    assert prepare(ramp / 400, 1.0).quantum == pytest.approx(399 / 400 / 65536, rel=1e-3)


def test_saturation_level():
    image = np.full((20, 20), 1000, np.uint16)
    image[:5] = 4095
    assert prepare(image, 1.0).clip == 4095 - 1000
    image[:5] = 4094
    assert prepare(image, 1.0).clip == 65535 - 1000
    assert prepare((image // 16).astype(np.uint8), 1.0).clip == 255 - 62
    assert prepare(image.astype(float), 1.0).clip == np.inf


def test_missing_and_dead_pixels_are_nan():
    image = np.tile(np.arange(20.0), (10, 1))
    image[3, 5], image[4, 7], image[5, 9], image[7, 12] = np.nan, np.inf, -np.inf, 1e6
    got = prepare(image, 1.0)
    assert got.missing
    np.testing.assert_array_equal(np.argwhere(np.isnan(got.g)), [[3, 5], [4, 7], [5, 9], [7, 12]])
    assert got.quantum == 1.0


def test_dead_pixels_do_not_make_the_range_of_an_image_without_steps():
    image = np.random.default_rng(0).normal(size=(50, 50))
    image[20, 30] = 1e6
    assert prepare(image, 1.0).quantum < 1e-3


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32, np.float64])
def test_rows_are_the_same_whichever_are_asked_for(kind):
    rng = np.random.default_rng(1)
    image = rng.integers(100, 110, (90, 40)).astype(kind)
    image[rng.integers(0, 90, 30), rng.integers(0, 40, 30)] = 255
    use = np.ones(image.shape, dtype=bool)
    use[50:60, 5:9] = False
    levels = levels_of(image, -1.0, use, usable_sample(image, use))
    whole, missing = grey_rows(image, use, levels, 0, 90)
    assert missing
    assert 45 < np.isnan(whole).sum() <= 70
    for size in (1, 7, 33):
        parts = [grey_rows(image, use, levels, y, min(y + size, 90))[0] for y in range(0, 90, size)]
        np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_nothing_to_find():
    assert prepare(np.full((5, 5), np.nan), 1.0) is None
    assert prepare(np.full((5, 5), 3, np.uint8), 1.0) is None


@pytest.mark.parametrize(
    ("image", "word"),
    [
        (np.zeros((4, 4, 3)), "colour"),
        (np.zeros(7), "shape"),
        (np.zeros((0, 5)), "at least one pixel"),
        (np.zeros((4, 4), complex), "complex"),
        (np.array([["a", "b"]]), "real number type"),
        ("wind-off.tif", r"got the path wind-off\.tif: windmark\.read_image reads it"),
        (Path("wind-off.tif"), r"got the path wind-off\.tif"),
    ],
)
def test_wrong_images_are_named(image, word):
    with pytest.raises(ValueError, match=word):
        check_image(image)


def test_hot_and_dead_pixels_of_a_picture():
    image = np.random.default_rng(2).normal(800, 5, (40, 50)).astype(np.uint16)
    assert dead_pixels(image) is None
    assert dead_pixels(np.full((9, 9), np.nan)) is None
    image[7, 9], image[20, 30] = 5000, 3
    assert np.argwhere(dead_pixels(image)).tolist() == [[7, 9], [20, 30]]


@pytest.mark.parametrize("value", [5000, 3])
@pytest.mark.parametrize("beside", [(0, 1), (1, 0), (1, 1), (1, -1)])
def test_two_dead_pixels_that_touch(beside, value):
    """But not what an optic has imaged: a point of light of 0.5 px between two pixels."""
    image = np.random.default_rng(2).normal(800, 5, (40, 50)).astype(np.uint16)
    y, x = np.indices(image.shape)
    assert dead_pixels(image + (4000 * np.exp(-((x - 25.5) ** 2 + (y - 20) ** 2) / 0.5)).astype(np.uint16)) is None
    pair = [[12, 17], [12 + beside[0], 17 + beside[1]]]
    for row, column in pair:
        image[row, column] = value
    assert np.argwhere(dead_pixels(image)).tolist() == sorted(pair)
    assert dead_pixels(image[:2, :3]) is None


def test_a_picture_drawn_of_single_pixels_has_no_dead_ones():
    image = np.random.default_rng(3).normal(200, 2, (60, 60)).astype(np.uint8)
    drawn = image.copy()
    drawn[2::8, 2::8] = 20
    assert dead_pixels(drawn) is None
    drawn[2:50:8] = image[2:50:8]
    assert dead_pixels(drawn).sum() == (drawn == 20).sum() == 16
