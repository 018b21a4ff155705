"""Lost frames, and a camera's pattern that changes, are told from what heats a model and from its level."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.paint import Wall
from windmark.pipeline.infrared.jumps import jumps
from windmark.pipeline.infrared.store import Store
from windmark.tasks.infrared.breaks import breaks_of

NODES, FRAMES = 800, 30


def rise(since):
    """By heat that comes within 0.15 s, over the root of time."""
    t = np.maximum(since, 0.0)
    return t**1.5 - np.maximum(t - 0.15, 0.0) ** 1.5


def heated(*, lost=0, at=16, noise=0.02, seed=0, start=0.28, second=0.0, even=0.3, begins=0.9):
    """Histories of nodes whose heating differs by a part of itself; frames that are lost from frame ``at`` on."""
    rng = np.random.default_rng(seed)
    t = np.arange(FRAMES + lost) / 20
    one, two = 1 + even * rng.standard_normal((2, NODES))
    level = 300 + 10 * one * rise(t - start)[:, None] + second * two * rise(t - begins)[:, None]
    level += noise * rng.standard_normal(level.shape)
    keep = np.r_[0:at, at + lost : FRAMES + lost]
    return level[keep], t[:FRAMES]


def pattern(kelvin, values, at=16):
    """The histories with new offsets of no mean from a frame on."""
    own = kelvin * np.sin(np.arange(NODES) / 7.0)
    return values + np.where(np.arange(len(values)) >= at, 1.0, 0.0)[:, None] * own


@pytest.mark.parametrize("lost", [1, 2, 3, 5])
@pytest.mark.parametrize("at", [13, 16, 22])
def test_lost_frames_are_found_and_counted(lost, at):
    values, t = heated(lost=lost, at=at)
    (found,) = breaks_of(list(values), t)
    assert found.after == at - 1
    assert found.lost is not None
    assert found.lost[0] - 1 <= lost <= found.lost[1] + 1


@pytest.mark.parametrize("kelvin", [0.3, 1.0])
def test_a_pattern_that_changes_is_found(kelvin):
    values, t = heated()
    (found,) = breaks_of(list(pattern(kelvin, values)), t)
    assert (found.after, found.lost) == (15, None)
    assert found.kelvin == pytest.approx(1.05 * kelvin, rel=0.15)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("noise", [0.0, 0.02, 0.2])
@pytest.mark.parametrize("second", [0.0, 10.0])
def test_a_clean_run_has_no_break(seed, noise, second):
    values, t = heated(seed=seed, noise=noise, second=second)
    assert breaks_of(list(values), t) == []


@pytest.mark.parametrize("lasts", [0.01, 0.025, 0.05, 0.075, 0.2])
@pytest.mark.parametrize("begins", [0.85, 0.86, 0.875, 0.89])
def test_more_heat_that_sets_in_at_once_and_a_pulse_are_no_break(begins, lasts):
    values, t = heated()
    more = 1 + 0.4 * np.random.default_rng(2).standard_normal(NODES)
    sets_in, ends = (np.sqrt(np.maximum(t - b, 0.0))[:, None] for b in (begins, begins + lasts))
    for course in (sets_in, -sets_in, sets_in - ends):
        assert breaks_of(list(values + 5 * course * more), t) == []


def test_a_level_that_jumps_is_neither():
    values, t = heated()
    values[16:] += 0.8
    assert breaks_of(list(values), t) == []


def test_single_odd_frames_and_gaps_are_no_break():
    values, t = heated()
    for odd in ([15], [15, 16], [5]):
        there = values.copy()
        there[odd] = pattern(1.0, values, 0)[odd]
        assert breaks_of(list(there), t) == []
    there = list(pattern(1.0, values))
    there[16] = None
    assert breaks_of(there, t) == []
    assert breaks_of(list(pattern(1.0, values)), t + 0.5 * (np.arange(FRAMES) > 15)) == []
    assert breaks_of(list(values[:5]), t[:5]) == []
    assert breaks_of([np.full(NODES, np.nan)] * FRAMES, t) == []


def said_of(tmp_path, cameras, times, start=0.28):
    """What a run of these cameras' histories says."""
    store = Store(tmp_path, tuple(cameras))
    store.place.mkdir(parents=True)
    for name, values in cameras.items():
        for k, row in enumerate(values):
            np.save(store.temperature_file(k, name), row[None].astype(np.float32))
    run = SimpleNamespace(
        times=times, walls=(Wall.semi_infinite(0.25, 1.7e6),), wall_of=np.zeros(NODES, int),
        project=SimpleNamespace(heat=SimpleNamespace(start_s=start)),
        timeline=SimpleNamespace(frames=[SimpleNamespace(key=str(k)) for k in range(len(times))]),
    )  # fmt: skip
    return jumps(run, store, range(len(times)))


def test_a_run_names_frames_cameras_and_the_cause(tmp_path):
    (one, t), (two, _) = heated(lost=3), heated(lost=3, seed=1)
    (said,) = said_of(tmp_path / "lost", {"cam1": one, "cam2": two}, t)
    assert "cam1, cam2: between frames 15 and 16" in said
    assert "are lost" in said
    one, two = heated()[0], heated(seed=1)[0]
    assert said_of(tmp_path / "clean", {"cam1": one, "cam2": two}, t) == []
    (said,) = said_of(tmp_path / "pattern", {"cam1": one, "cam2": pattern(0.4, two)}, t)
    assert said.startswith("cam2: between frames 15 and 16 the nodes' temperatures go apart by 0.4")
    one[16:] += 0.85
    (said,) = said_of(tmp_path / "level", {"cam1": one, "cam2": two}, t)
    assert said.startswith("cam1: its temperatures jump by 0.8")
    assert "K at all nodes between frames 15 and 16: its shutter (NUC)" in said
    two[16:] += 0.85
    (said,) = said_of(tmp_path / "both", {"cam1": one, "cam2": two}, t)
    assert "frames that are lost there, or a shutter (NUC)" in said


@pytest.mark.parametrize("at", [5, 6, 7])
@pytest.mark.parametrize("seed", range(2))
def test_what_jumps_where_the_heating_begins_is_said_where_it_is_no_heat(tmp_path, at, seed):
    values, t = heated(seed=seed)
    level = values + 0.6 * (np.arange(FRAMES) >= at)[:, None]
    (said,) = said_of(tmp_path / "level", {"cam1": level, "cam2": level}, t)
    assert f"K at all nodes between frames {at - 1} and {at}: its shutter" in said
    assert "lost" not in said
    (said,) = said_of(tmp_path / "pattern", {"cam": pattern(0.6, values, at)}, t)
    assert f"between frames {at - 1} and {at} the nodes' temperatures go apart" in said


@pytest.mark.parametrize("begins", [0.205, 0.22, 0.235, 0.25, 0.27, 0.28])
@pytest.mark.parametrize("lasts", [0.02, 0.05, 0.1, 9.0])
def test_heat_that_sets_in_at_once_or_as_a_pulse_where_it_begins_is_no_jump(tmp_path, begins, lasts):
    rng, t = np.random.default_rng(4), np.arange(FRAMES) / 20
    one, two = 1 + 0.3 * rng.standard_normal((2, NODES))
    first = np.sqrt(np.maximum(t - begins, 0.0)) - np.sqrt(np.maximum(t - begins - lasts, 0.0))
    later = np.sqrt(np.maximum(t - begins, 0.0))
    values = 300 + 5 * (one + 0.2 * two) * first[:, None] + 2 * one * later[:, None]
    values += 0.02 * rng.standard_normal(values.shape)
    assert said_of(tmp_path, {"cam": values}, t) == []


def test_a_level_that_evenly_heated_nodes_do_not_tell_from_heat_is_not_said(tmp_path):
    values, t = heated(even=0.0)
    assert said_of(tmp_path, {"cam": values + 0.6 * (np.arange(FRAMES) >= 6)[:, None]}, t) == []
