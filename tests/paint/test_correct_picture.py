"""One picture's light: its variance by the formula, and both sides of every flag and refusal."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.errors import DataError, UsageError
from windmark.paint import Linearity, SensorModel, Wall, correct_picture
from windmark.paint.flux_operator import flux_operator
from windmark.paint.radiometry import DARKER, MOST_DARKER, NO_FLAT, NOISY, NOT_FINITE, SATURATED

SENSOR = SensorModel(100.0, 4000.0, 0.5, 4.0, dark_variance=5.0)


def light(*levels, size=1000):
    """A lit picture with some pixels of other levels."""
    picture = np.full((1, size), 2000.0)
    picture[0, : len(levels)] = levels
    return picture


def test_darker_than_noise_of_reading_and_of_the_dark_picture_allow():
    edge = 100.0 - NOISY * np.sqrt(4.0 + 5.0)
    got = correct_picture(light(edge + 0.01, edge - 0.01), SENSOR)
    assert got.flags[0, :3].tolist() == [0, DARKER, 0]


def test_the_variance_is_that_of_light_reading_dark_and_flat_through_the_bend():
    flat = np.linspace(0.8, 1.2, 8)[None]
    bend = Linearity.polynomial([0.0, 1.0, 2e-5], 4200)
    sensor = replace(SENSOR, flat=flat, flat_variance=1e-4, linearity=bend)
    raw = np.linspace(500, 3000, 8)[None]
    got = correct_picture(raw, sensor)
    signal = raw - 100.0
    value, slope = (signal + 2e-5 * signal**2) / flat, 1 + 4e-5 * signal
    np.testing.assert_allclose(got.value, value, rtol=1e-6)
    lasting = (slope**2 * 5.0 + value**2 * 1e-4) / flat**2
    np.testing.assert_allclose(got.lasting, lasting, rtol=1e-4)
    np.testing.assert_allclose(got.variance, slope**2 * (0.5 * signal + 4.0) / flat**2 + lasting, rtol=1e-4)
    dark = correct_picture(light(95.0), SENSOR)  # below the dark level there is no light whose noise would be less
    assert dark.variance[0, 0] == 4.0 + 5.0


def test_pixels_that_say_nothing_are_flagged():
    picture = light(4000.0, 3999.0, np.nan)
    flat = np.ones((1, 1000))
    flat[0, 3:5] = 0.0, np.nan
    got = correct_picture(picture, replace(SENSOR, flat=flat))
    assert got.flags[0, :6].tolist() == [SATURATED, 0, NOT_FINITE, NO_FLAT, NO_FLAT, 0]
    assert np.isnan(got.value[0, 3:5]).all()


@pytest.mark.parametrize(("more", "refused"), [(-2, False), (2, True)])
def test_pictures_are_refused_beyond_the_parts_that_may_be_dark_or_saturated(more, refused):
    for part, level, words in ((MOST_DARKER, 0.0, "dark picture is brighter"), (0.25, 4050.0, "25 % may be")):
        picture = light(*[level] * (round(1000 * part) + more))
        if refused:
            with pytest.raises(DataError, match=words):
                correct_picture(picture, SENSOR)
        else:
            assert correct_picture(picture, SENSOR)


@pytest.mark.parametrize(("level", "refused"), [(1.02, False), (0.98, True)])
def test_a_picture_shows_light_where_a_hundredth_of_it_rises_out_of_the_noise(level, refused):
    variance = 9.0
    for _ in range(50):  # its own photons count in it
        signal = level * NOISY * np.sqrt(variance)
        variance = 0.5 * signal + 9.0
    picture = np.full((1, 1000), 100.0)
    picture[0, :30] += signal
    if refused:
        with pytest.raises(DataError, match="no light above the dark picture"):
            correct_picture(picture, SENSOR)
    else:
        assert correct_picture(picture, SENSOR)


@pytest.mark.parametrize("name", ["dark", "flat", "dead", "dark_variance", "flat_variance"])
def test_parts_of_another_size_are_named(name):
    with pytest.raises(DataError, match=rf"{name}: 7 x 2 pixels; expected 1000 x 1 pixels as the picture"):
        correct_picture(light(), replace(SENSOR, **{name: np.ones((2, 7), bool if name == "dead" else float)}))
    with pytest.raises(ValueError, match=r"must be \(H, W\), got \(5,\)"):
        correct_picture(np.ones(5), SENSOR)


@pytest.mark.parametrize("wrong", [{"gain": -0.1}, {"read_variance": -1.0}, {"saturation": 0.0}, {"gain": np.nan}])
def test_sensors_that_are_none(wrong):
    with pytest.raises(UsageError, match="gain and read_variance must be at least 0, saturation above 0"):
        replace(SENSOR, **wrong)
    assert replace(SENSOR, gain=0.0, read_variance=0.0).gain == 0.0


@pytest.mark.parametrize(
    ("times", "start", "words"),
    [
        ([[0.0, 1.0], [2.0, 3.0]], 0.5, r"must be \(F,\) numbers, got \(2, 2\)"), ([0.0, np.nan, 2.0], 0.5, "numbers"),
        ([0.0, 1.0, 1.0, 2.0], 0.5, "times must increase: 1 s comes after 1 s"),
        ([0.0, 2.0, 1.5], 0.5, "1.5 s comes after 2 s"), ([0.0, 1.0], 5.0, "the heating begins at 5 s"),
        ([1.0, 2.0], 0.5, "the heating begins at 0.5 s, the samples are from 1 to 2 s"),
    ],
)  # fmt: skip
def test_times_that_tell_no_flux(times, start, words):
    with pytest.raises((UsageError, DataError), match=words):
        flux_operator(times, Wall.semi_infinite(16.0, 4e6), start=start)


def test_a_dark_or_flat_picture_that_is_no_number_leaves_no_usable_pixel():
    sensor = SensorModel(dark=np.array([[np.nan, 100.0], [100.0, 100.0]]), saturation=4000.0, gain=0.5,
                         read_variance=4.0, flat=np.array([[1.0, np.inf], [np.nan, 1.0]]))  # fmt: skip
    got = correct_picture(np.full((2, 2), 1100.0), sensor)
    assert got.flags.tolist() == [[NOT_FINITE, NO_FLAT], [NO_FLAT, 0]]
    assert np.isnan(got.value).tolist() == [[True, True], [True, False]]
    assert got.value[1, 1] == 1000.0


def test_an_error_of_the_dark_picture_that_is_no_number_leaves_no_usable_pixel():
    sensor = SensorModel(dark=100.0, saturation=4000.0, gain=0.5, read_variance=4.0,
                         dark_variance=np.array([[np.inf, 1.0]]))  # fmt: skip
    assert correct_picture(np.full((1, 2), 1100.0), sensor).flags.tolist() == [[NOT_FINITE, 0]]
