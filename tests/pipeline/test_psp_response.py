"""The noise of a camera's pictures against their levels: dark pictures that are none, a response that is bent."""

import numpy as np
import pytest

from windmark.paint import SensorModel, photon_transfer
from windmark.pipeline.psp.response import QUIET, odd_response, soft_words
from windmark.pipeline.psp.taken import Taken
from windmark.pipeline.verdict.paint import response_findings

GAIN, READ, BLACK, FULL = 0.54, 3.0, 230.0, 16383.0


def shown(bent, *, dark=BLACK, seed=0, mean_of=1):
    """Photon transfer of four pictures of a scene of all levels, as the camera stores them."""
    rng = np.random.default_rng(seed)
    electrons = np.tile(np.linspace(400.0, 22_000.0, 300), (4 * mean_of, 160, 1))
    levels = BLACK + GAIN * rng.poisson(electrons) + rng.normal(0, READ, electrons.shape)
    stored = np.rint(bent(levels.reshape(4, mean_of, 160, 300).mean(axis=1))).astype(np.uint16)
    return photon_transfer(stored, dark=bent(dark))


def straight(levels):
    return levels


def gamma(levels):
    return FULL * (levels / FULL) ** 0.9


def soft(levels):
    return levels - 0.15 * np.asarray(levels) ** 2 / FULL


NOISE = READ**2 + 1 / 12


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("mean_of", [1, 4])
def test_a_straight_response_and_true_dark_pictures_say_nothing(seed, mean_of):
    assert odd_response(shown(straight, seed=seed, mean_of=mean_of), NOISE) is None
    assert odd_response(shown(straight, seed=seed, dark=BLACK - 40), NOISE) is None  # a few thousandths of the light


@pytest.mark.parametrize("low", [400, -400])
def test_dark_pictures_of_another_level_are_told_with_it(low):
    found = odd_response(shown(straight, dark=BLACK - low), NOISE)
    assert found is not None
    assert not found.bent
    # Of levels too low the pictures' own noise of reading is a part: it need not be that of the dark pictures.
    assert found.level == pytest.approx(low, abs=40)
    (said,) = response_findings({"cam1": found, "cam2": None})
    assert "wind-off pictures of cam1" in said.reason
    assert f"grey levels too {'low' if low > 0 else 'bright'}" in said.reason


@pytest.mark.parametrize("bent", [gamma, soft])
def test_a_bent_response_is_told(bent):
    slope = bent(BLACK + 1) - bent(BLACK)
    found = odd_response(shown(bent), slope**2 * READ**2)
    assert found is not None
    assert "the response is not straight" in response_findings({"cam1": found})[0].reason


def test_one_dark_picture_and_an_even_scene_say_nothing():
    assert odd_response(shown(gamma), float("nan")) is None
    rng = np.random.default_rng(3)
    even = np.rint(BLACK + GAIN * rng.poisson(np.linspace(9000.0, 10_000.0, 300) * np.ones((4, 160, 300))))
    found = photon_transfer(even.astype(np.uint16), dark=BLACK)
    assert not found or odd_response(found, NOISE) is None


def taken(limit, seed, saturation=np.inf):
    rng = np.random.default_rng(seed)
    level = BLACK + GAIN * rng.poisson(np.tile(np.linspace(300.0, 12_000.0, 300), (160, 1)))
    image = np.rint(np.minimum(level, limit + rng.normal(0, 15, level.shape))).astype(np.uint16)
    light = np.where(image < saturation, image - BLACK, np.nan)
    return Taken(f"{seed}.tif", image, light=light)


def test_levels_that_are_limited_below_the_saturation_are_said_of_a_kind_of_pictures():
    sensor = SensorModel(dark=BLACK, saturation=FULL, gain=GAIN, read_variance=NOISE)
    bad = Taken("bad.tif", None, why="damaged")
    said = soft_words("wind-on", "cam1", [taken(6000, 1), taken(6000, 2), bad], sensor)
    assert said.startswith(f"cam1: {QUIET}from grey level ")
    assert int(said.split("grey level ")[1].split()[0]) == pytest.approx(5990, abs=80)
    assert soft_words("wind-on", "cam1", [taken(np.inf, 1), taken(np.inf, 2)], sensor) == ""
    assert soft_words("wind-on", "cam1", [taken(6000, 1)], sensor) == ""
    known = SensorModel(dark=BLACK, saturation=5800.0, gain=GAIN, read_variance=NOISE)
    assert soft_words("wind-on", "cam1", [taken(6000, 1, 5800), taken(6000, 2, 5800)], known) == ""
