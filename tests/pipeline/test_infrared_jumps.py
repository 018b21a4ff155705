"""A camera's level that jumps is told from what heats a model."""

import numpy as np
import pytest

from windmark.pipeline.infrared.jumps import jumps_of


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
