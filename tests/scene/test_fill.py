"""Fill values of pictures of floats are found, and nothing that a picture has of itself is one."""

import numpy as np
import pytest

from windmark.scene.fill import fill_values, without_fill

RNG = np.random.default_rng(1)
GREY = np.rint(RNG.uniform(900.0, 30_000.0, (60, 80))).astype(np.float32)
RATIO = RNG.normal(1.0, 0.1, (60, 80))
CELSIUS = RNG.normal(3.0, 4.0, (60, 80))


def with_hole(picture, value, count=15):
    out = picture.copy()
    out[20, 30 : 30 + count] = value
    return out


@pytest.mark.parametrize(
    ("picture", "value"),
    [(GREY, -9999.0), (RATIO, -1.0), (RATIO, 9999.0), (CELSIUS, -999.0), (CELSIUS, 1e30), (RATIO, -1e30)],
)
def test_a_fill_value_is_taken_as_none(picture, value):
    holed = with_hole(picture, value)
    assert fill_values(holed) == [pytest.approx(value)]
    clean, words = without_fill(holed)
    assert clean.dtype == holed.dtype
    np.testing.assert_array_equal(np.isnan(clean), holed == holed.dtype.type(value))
    assert words.startswith(f"15 pixels are at {value:g}, far from all others")


def test_both_ends():
    assert fill_values(with_hole(with_hole(RATIO, -9999.0, 40), 9999.0)) == [-9999.0, 9999.0]


@pytest.mark.parametrize(
    "picture",
    [
        GREY, RATIO, CELSIUS,
        with_hole(GREY, 0.0),  # black
        with_hole(GREY, 65535.0),  # clipped
        with_hole(GREY - 900.0, -1.0),  # a dark picture taken off
        with_hole(RATIO, -9999.0, 2),  # two pixels that went wrong
        with_hole(GREY, -9999.0).astype(np.int32),
        with_hole(RATIO, np.nan), np.full((4, 5), -1.0), np.full((4, 5), np.nan), np.zeros((4, 5)),
        np.where(RATIO > 1.0, 0.0, RATIO),  # masked
    ],
)  # fmt: skip
def test_what_a_picture_has_of_itself_is_none(picture):
    same, words = without_fill(picture)
    assert same is picture
    assert words == ""
