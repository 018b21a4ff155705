"""Pictures of a camera that are stored in other bits of their numbers than its dark pictures, or than each other."""

import numpy as np
import pytest

from windmark.errors import DataError
from windmark.pipeline.psp.bits import Bits, DarkLevel, SameBits
from windmark.pipeline.psp.taken import Taken

SHAPE = (60, 80)


def drawn(level, seed, times=1, sigma=6.0):
    """Levels of a camera, ``level`` over its dark ones, in the darker half of the picture a little."""
    rng = np.random.default_rng(seed)
    light = np.where(np.arange(SHAPE[1]) < 40, 0.03 * level, level) * np.ones(SHAPE)
    return (np.rint(100 + light + rng.normal(0, sigma, SHAPE)).astype(np.uint16) * times).astype(np.uint16)


def dark(times=1):
    frames = np.stack([drawn(0, 50 + k, times) for k in range(3)])
    return DarkLevel(frames.mean(axis=0), Bits.of(frames))


@pytest.mark.parametrize(("own", "others"), [(16, 1), (4, 1), (1, 4)])
def test_a_picture_in_other_bits_than_its_dark_pictures_is_refused(own, others):
    with pytest.raises(DataError, match=f"are multiples of {max(own, others)}, those of .* are not: one of them"):
        dark(others).check(drawn(900, 1, own), "this picture")


@pytest.mark.parametrize("times", [1, 4, 16])
def test_what_is_stored_alike_is_no_matter(times):
    dark(times).check(drawn(900, 1, times), "this picture")


def test_the_rounded_mean_of_dark_pictures_is_as_bright_as_one_of_them():
    mean = np.rint(np.mean([drawn(0, k, 16) for k in range(30)], axis=0)).astype(np.uint16)
    assert Bits.of(mean) == Bits(0, 0)
    DarkLevel(mean.astype(float), Bits.of(mean)).check(drawn(900, 1, 16), "this picture")
    mean = np.rint(np.mean([drawn(900, k, 16) for k in range(30)], axis=0)).astype(np.uint16)
    dark(16).check(mean, "this picture")


def test_dark_pictures_of_few_levels_and_of_no_whole_numbers_say_nothing():
    even = np.full(SHAPE, 64, np.uint16)
    DarkLevel(even.astype(float), Bits.of(even)).check(drawn(900, 1), "this picture")
    mean = np.mean([drawn(0, k) for k in range(3)], axis=0)
    DarkLevel(mean, Bits.of(mean)).check(drawn(900, 1, 16), "this picture")


def taken(name, image):
    return Taken(name, image, light=image - 100.0)


def test_wind_on_and_wind_off_in_other_bits_are_named():
    same = SameBits()
    same.check("wind-on", {"cam1": [taken("on.tif", drawn(900, 1, 16))]})
    same.check("wind-off reference", {"cam1": [taken("red.tif", drawn(900, 1))]})  # of another colour
    same.check("wind-off", {"cam2": [taken("off.tif", drawn(900, 1))]})
    with pytest.raises(DataError) as error:
        same.check("wind-off (alpha 2)", {"cam1": [taken("off.tif", drawn(900, 2))]})
    assert str(error.value).startswith(
        "the grey levels of wind-on picture on.tif of cam1 are multiples of 16, those of wind-off (alpha 2) picture "
        "off.tif of cam1 are not"
    )


def test_a_mean_of_wind_on_pictures_beside_one_wind_off_picture_is_left():
    same = SameBits()
    same.check("wind-off", {"cam1": [taken("off.tif", drawn(900, 1, 16))]})
    mean = np.rint(np.mean([drawn(700, k, 16) for k in range(20)], axis=0)).astype(np.uint16)
    same.check("wind-on", {"cam1": [taken("on.tif", mean)]})
