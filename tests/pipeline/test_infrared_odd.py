"""Single pictures that are off the course of those beside them are named, and heat is not."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.pipeline.infrared.odd import odd_frames, odd_of
from windmark.pipeline.infrared.store import Store

NODES, FRAMES, START = 800, 30, 0.28


def heated(seed=0, noise=0.02):
    """Histories of nodes whose heating differs, by the root of time behind a start that takes 0.15 s."""
    rng, t = np.random.default_rng(seed), np.arange(FRAMES) / 20
    since = np.maximum(t - START, 0.0)
    rise = since**1.5 - np.maximum(since - 0.15, 0.0) ** 1.5
    level = 300 + 10 * (1 + 0.3 * rng.standard_normal(NODES)) * rise[:, None]
    return level + noise * rng.standard_normal(level.shape), t


def spoilt(values, k, kelvin, *, pattern=False):
    """With frame k off by so much."""
    out = values.copy()
    out[k] += kelvin * np.sin(np.arange(NODES) / 7.0) * np.sqrt(2) if pattern else kelvin
    return out


@pytest.mark.parametrize("kelvin", [0.6, -0.6, 48.0])
@pytest.mark.parametrize("k", [2, 4, 12, 15, 27])
@pytest.mark.parametrize("pattern", [False, True])
def test_an_odd_frame_is_found(kelvin, k, pattern):
    values, t = heated()
    (found,) = odd_of(list(spoilt(values, k, kelvin, pattern=pattern)), t)
    assert found[0] == k
    assert found[1] == pytest.approx(abs(kelvin), rel=0.2)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("noise", [0.0, 0.02, 0.2])
def test_a_clean_run_has_none(seed, noise):
    values, t = heated(seed, noise)
    assert odd_of(list(values), t) == []


@pytest.mark.parametrize("begins", [0.851, 0.86, 0.875, 0.9])
@pytest.mark.parametrize("lasts", [0.03, 0.05, 0.1, 9.0])
def test_heat_that_sets_in_or_comes_and_goes_makes_none(begins, lasts):
    values, t = heated()
    more = np.sqrt(np.maximum(t - begins, 0.0)) - np.sqrt(np.maximum(t - begins - lasts, 0.0))
    more = 5 * (1 + 0.4 * np.random.default_rng(2).standard_normal(NODES)) * more[:, None]
    assert odd_of(list(values + more), t) == []
    assert odd_of(list(values - more), t) == []


def test_jumps_and_gaps_are_none():
    values, t = heated()
    stays = values.copy()
    stays[15:] += 0.8
    assert odd_of(list(stays), t) == []
    there = list(spoilt(values, 15, 2.0))
    there[14] = None
    assert odd_of(there, t) == []
    assert odd_of(list(values[:4]), t[:4]) == []
    assert odd_of([np.full(NODES, np.nan)] * FRAMES, t) == []


def said_of(folder, cameras, times):
    store = Store(folder, tuple(cameras))
    store.place.mkdir(parents=True)
    for name, values in cameras.items():
        for k, row in enumerate(values):
            np.save(store.temperature_file(k, name), row[None].astype(np.float32))
    run = SimpleNamespace(
        times=times, project=SimpleNamespace(heat=SimpleNamespace(start_s=START)),
        timeline=SimpleNamespace(frames=[SimpleNamespace(key=str(k)) for k in range(len(times))]),
    )  # fmt: skip
    return odd_frames(run, store, range(len(times)))


def test_a_run_names_camera_and_frame(tmp_path):
    (one, t), (two, _) = heated(), heated(1)
    assert said_of(tmp_path / "clean", {"cam1": one, "cam2": two}, t) == ""
    said = said_of(tmp_path / "odd", {"cam1": one, "cam2": spoilt(two, 15, 0.6)}, t)
    assert "cam2: frame 15 by 0.6" in said
    assert "cam1" not in said
    assert said_of(tmp_path / "first", {"cam1": spoilt(one, 6, 30.0)}, t) == ""
