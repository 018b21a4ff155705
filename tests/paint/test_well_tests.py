"""Thermocouples that are wrong, or disagree: left out and named, or contained in the sigmas; good ones stay."""

import numpy as np
import pytest

from windmark.paint import thermocouple_temperature

SIGMA, SPREAD, LENGTH = 0.2, 1.0, 165.0
AT = np.array([[121, 120, 25], [238, 120, 19], [192, 270, 33], [291, 270, 29], [263, 420, 41], [345, 420, 39],
               [326, 552, 48], [392, 552, 47]], dtype=float)  # fmt: skip
NAMES = [f"T{k + 1}" for k in range(8)]


def readings(seed=5, count=8):
    """Truth and readings of a wall of the covariance that is stated."""
    rng = np.random.default_rng(seed)
    square = ((AT[:, None] - AT[None]) ** 2).sum(axis=2)
    k = SPREAD**2 * np.exp(-0.5 * square / LENGTH**2) + 1e-9 * np.eye(8)
    true = 299 + np.linalg.cholesky(k) @ rng.normal(size=8)
    return true[:count], (true + SIGMA * rng.normal(size=8))[:count]


def wall(t, at=AT, spread=SPREAD):
    words = []
    at = at[: len(t)]
    got = thermocouple_temperature(at, at, t, sigma=SIGMA, length=LENGTH, spread=spread, names=NAMES[: len(t)],
                                   remarks=words)  # fmt: skip
    return got, words


def by_hand(t, used):
    """What the readings that count alone say, of no test."""
    return thermocouple_temperature(AT, AT[used], t[used], sigma=SIGMA, length=LENGTH, spread=SPREAD)


def test_good_readings_all_count_and_nothing_is_said():
    true, t = readings()
    got, words = wall(t)
    assert not words
    assert (np.abs(got.value - true) < 3 * SIGMA).all()


def test_a_wrong_reading_is_left_out_and_named():
    true, t = readings()
    t[2] += 8.0
    got, words = wall(t)
    assert len(words) == 1
    assert words[0].startswith("thermocouples that do not count: T3 (it reads ")
    assert "K more than the others say there, by 1" in words[0]
    others = [0, 1, 3, 4, 5, 6, 7]
    np.testing.assert_array_equal(got.value, by_hand(t, others).value)
    np.testing.assert_array_equal(got.variance, by_hand(t, others).variance)
    assert (np.abs(got.value - true) < 3 * got.sigma).all()


def test_of_two_at_one_place_the_one_that_the_others_contradict_goes():
    _, t = readings()
    at = AT.copy()
    at[3], t[3] = at[2], t[2] + 6.0
    got, words = wall(t, at)
    assert words[0].startswith("thermocouples that do not count: T4 (")
    assert got.sigma[3] < 0.25


@pytest.mark.parametrize("count", [2, 3, 4])
def test_few_that_disagree_tell_not_which_is_wrong_and_the_sigmas_contain_either(count):
    true, t = readings(count=count)
    t[-1] += 10.0
    got, words = wall(t)
    assert len(words) == 1
    assert words[0].startswith("thermocouples contradict each other: ")
    assert f"T{count}" in words[0]
    assert "nothing tells which" in words[0]
    assert (np.abs(got.value - true) < 1.96 * got.sigma).all()  # the last one is wrong
    assert abs(got.value - t)[-1] < 1.96 * got.sigma[-1]  # or the wall is as it says


def test_two_at_one_place_alone_are_contained():
    got, words = wall(np.array([300.0, 310.0]), np.zeros((2, 3)))
    assert got.value[0] == pytest.approx(305.0)
    assert got.sigma[0] > 5.0
    assert "T1, T2 may be wrong" in words[0]


def test_two_that_agree_and_one_alone():
    assert not wall(readings(count=2)[1])[1]
    assert wall(readings(count=1)[1])[1] == ["T1 alone says the wall's temperature: nothing tests its reading"]


def test_a_wall_that_varies_by_more_than_was_said_gets_larger_sigmas_and_keeps_its_readings():
    true, t = readings()
    got, words = wall(299 + 6 * (true - 299) + (t - true))
    assert not any("do not count" in said for said in words)
    assert "contradict" in words[0]
    assert (np.abs(got.value - (299 + 6 * (true - 299))) < 2.5 * got.sigma).all()


def test_a_spread_that_is_not_stated_is_that_of_the_others():
    _, t = readings()
    t[5] -= 25.0
    got, words = wall(t, spread=None)
    assert words[0].startswith("thermocouples that do not count: T6 (it reads ")
    assert got.value[5] > 297


def test_good_readings_are_left_alone_but_once_in_a_hundred_points():
    said = [wall(readings(seed)[1])[1] for seed in range(300)]
    assert sum(bool(words) for words in said) < 10
    assert not any("contradict" in word for words in said for word in words)
