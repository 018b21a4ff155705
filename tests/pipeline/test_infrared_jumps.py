"""A camera's level that jumps, and pictures in each other's place, are told from what heats a model."""

import numpy as np
import pytest

from windmark.pipeline.infrared.jumps import jumps_of
from windmark.pipeline.infrared.order import exchanged_of


def heated(*, jump=0.0, at=12, start=4.5, even=0.3, seed=0, noise=0.04, frames=24):
    """Histories of 800 nodes whose heating differs by a part of itself; a jump of the camera."""
    rng, t = np.random.default_rng(seed), np.arange(frames) / 20
    rise = 2.0 * np.sqrt(np.maximum(t - start / 20, 0))
    level = 300 + (1 + even * rng.standard_normal(800)) * rise[:, None] + noise * rng.standard_normal((frames, 800))
    level[at:] += jump
    return list(level), t


@pytest.mark.parametrize("jump", [0.8, -0.8, 2.0])
def test_a_jump_is_found_where_it_is(jump):
    found = jumps_of(*heated(jump=jump))
    assert [k for k, _ in found if abs(k - 4) > 1] == [11]
    assert found[-1][1] == pytest.approx(jump, abs=0.05)


@pytest.mark.parametrize("seed", range(10))
def test_a_run_without_one_says_nothing(seed):
    assert jumps_of(*heated(seed=seed)) == []


def test_heat_that_comes_suddenly_and_unevenly_and_what_ends_is_no_jump():
    values, t = heated(noise=0.01)
    more = 1 + 0.4 * np.random.default_rng(2).standard_normal(800)
    assert jumps_of([v + (k > 15) * more for k, v in enumerate(values)], t) == []
    slope = np.minimum(np.arange(24), 14) * 0.3
    assert jumps_of([300 + s + 0 * values[0] for s in slope], t) == []


def test_gaps_are_not_asked():
    values, t = heated(jump=3.0)
    values[12] = None
    assert jumps_of(values, t) == []
    values, t = heated(jump=3.0)
    t[12:] += 0.5
    assert jumps_of(values, t) == []
    values[12] = np.full(800, np.nan)
    assert jumps_of(values, t) == []


@pytest.mark.parametrize("pairs", [[(8, 16)], [(8, 16), (10, 20)], [(7, 9)]])
def test_pictures_in_each_others_place_are_named(pairs):
    values, _ = heated(noise=0.01)
    for a, b in pairs:
        values[a], values[b] = values[b], values[a]
    assert exchanged_of(values) == pairs
    values[3] = None
    assert exchanged_of(values) == pairs


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("noise", [0.0, 0.01, 0.04])
def test_a_run_in_order_has_none_exchanged(seed, noise):
    assert exchanged_of(heated(seed=seed, noise=noise)[0]) == []
    assert exchanged_of(heated(seed=seed, noise=noise, jump=2.0)[0]) == []


def test_heat_that_comes_and_goes_and_single_odd_frames_are_no_exchange():
    rng = np.random.default_rng(4)
    even, frames = 1 + 0.3 * rng.standard_normal(800), np.arange(40)
    for history in (np.sin(frames * 0.9), np.sin(frames * 2.2), np.abs(frames - 20), (frames > 12) / (frames - 11.5)):
        level = 300 + 2 * even * history[:, None] + 0.03 * rng.standard_normal((40, 800))
        assert exchanged_of(list(level)) == []
    values = heated()[0]
    values[9] = values[9] + 3
    values[15] = values[15] - 2
    assert exchanged_of(values) == []
    assert exchanged_of(values[:2]) == []
    assert exchanged_of([None] * 5) == []
