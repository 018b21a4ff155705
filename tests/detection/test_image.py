"""What the detector makes of an image's type, levels and dead pixels."""

import numpy as np
import pytest

from windmark.detection.image import check_image, prepare


@pytest.mark.parametrize(
    "dtype", [np.uint8, np.int16, np.uint16, np.int32, np.uint32, np.uint64, np.float32, np.float64]
)
def test_grey_levels_survive(dtype):
    image = np.random.default_rng(0).integers(0, 120, (30, 40)).astype(dtype)
    for sign in (1.0, -1.0):
        got = prepare(image, sign)
        assert got.g.dtype == np.float32
        assert got.filled is got.g
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


def test_dead_pixels_are_nan_and_filled_along_the_row():
    image = np.tile(np.arange(20.0), (10, 1))
    image[3, 5], image[4, 7], image[5, 9] = np.nan, np.inf, -np.inf
    got = prepare(image, 1.0)
    assert np.isnan(got.g[[3, 4, 5], [5, 7, 9]]).all()
    assert np.isfinite(got.filled).all()
    np.testing.assert_allclose(got.filled - got.filled[0], 0, atol=1e-5)


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
    ],
)
def test_wrong_images_are_named(image, word):
    with pytest.raises(ValueError, match=word):
        check_image(image)
