"""A film that begins after the heating did is told from one that shows its beginning."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.paint import Layer, NodeField, Wall
from windmark.pipeline.infrared.start import goes_on, odd_start
from windmark.pipeline.infrared.store import Store
from windmark.tasks.infrared import CameraTemperature

RESIN = Wall.semi_infinite(0.25, 1.7e6)
SHEET = Wall.of([Layer(2e-4, 15.0, 3.7e6)])
NODES = 2000


def flux(since, comes="at once"):
    """Of the root of time since: what makes a thick wall's surface rise by it, from heat that comes in some way."""
    t = np.maximum(since, 0.0)
    if comes == "at once":
        return np.sqrt(t)
    return t**1.5 - np.maximum(t - 0.3, 0) ** 1.5  # over 0.3 s; what is steady from then on


def film(first, *, comes="at once", noise=0.02, seed=0, more=0.0, steps=20):
    """Histories from so many seconds after the heating began on, the first frame taken for the last one before it."""
    rng, t = np.random.default_rng(seed), np.arange(steps) / 20
    rise = (2 + 0.5 * rng.standard_normal(NODES)) * flux(t + first, comes)[:, None]
    late = np.where(np.arange(NODES) > NODES // 2, more, 0.0) * np.maximum(t - 0.1, 0.0)[:, None] ** 1.5
    return list(300 + rise + late + noise * rng.standard_normal((steps, NODES))), t


def asked(values, times, walls=(RESIN,)):
    return goes_on(values, times, walls, np.zeros(NODES, int))


@pytest.mark.parametrize("first", [0.1, 0.3, 1.0, 2.0])
@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
def test_a_rise_that_goes_straight_on_was_there_before(first, noise):
    step, rises = asked(*film(first, noise=noise))
    assert step >= 1
    assert all(r > 0 for r in rises)


def test_it_is_told_where_half_of_the_nodes_are_heated_more_soon_after():
    assert asked(*film(0.3, more=4.0)) is not None


def test_a_wall_that_cools_is_asked_as_well():
    values, t = film(0.3)
    assert asked([600 - v for v in values], t) is not None


@pytest.mark.parametrize("first", [-0.2, -0.05, -0.045, -0.04, -0.035, -0.03, -0.025, -0.02, -0.015, -0.01, 0.0])
@pytest.mark.parametrize("comes", ["at once", "slowly"])
def test_a_beginning_between_the_first_frames_is_one(first, comes):
    for seed in range(3):
        assert asked(*film(first, comes=comes, seed=seed)) is None


def test_what_cannot_be_known_is_not_said():
    values, t = film(0.3)
    assert asked(*film(0.3, noise=30.0)) is None
    assert asked(values[:3], t[:3]) is None
    assert asked([None, *values[1:]], t) is None
    assert asked([np.full(NODES, np.nan)] * 20, t) is None
    # A thin sheet rises steadily under steady heat from its beginning on.
    assert asked(values, t, (SHEET,)) is None


def run_of(tmp_path, values, times, start):
    """As much of a run as is asked."""
    store = Store(tmp_path, ("cam",))
    for k, v in enumerate(values):
        field = NodeField(v, np.full(NODES, 4e-4), np.zeros((NODES, 0)), (), "K")
        store.put(k, np.zeros((NODES, 3)),
                  {"cam": CameraTemperature(field, np.ones(NODES), np.zeros(NODES, np.uint16))})
    run = SimpleNamespace(
        times=times, walls=(RESIN,), wall_of=np.zeros(NODES, int), mesh=SimpleNamespace(vertices=np.zeros((NODES, 3))),
        project=SimpleNamespace(heat=SimpleNamespace(start_s=start)),
        timeline=SimpleNamespace(frames=[SimpleNamespace(key=str(k)) for k in range(len(values))]),
    )  # fmt: skip
    return odd_start(run, store, range(len(values)))


def test_a_run_says_it_and_one_with_frames_before_the_heating_does_not(tmp_path):
    values, t = film(0.3)
    said = run_of(tmp_path, values, t, 0.01)
    assert "only frame 0 is from before heat.start_s" in said
    assert "Either the heating began before the film did, and heat flux is too low, or it grew" in said
    values, t = film(-0.3)
    assert run_of(tmp_path, values, t, 0.3) == ""
    assert run_of(tmp_path, values[6:], t[6:], 0.3) == ""
    assert "before heat.start_s" in run_of(tmp_path, values, t, 0.5)


def drifting(rate, seed, jitter=0.0, steps=40):
    """A film of which the first quarter is from before the heating, by a camera that drifts."""
    values, t = film(-0.5, seed=seed, steps=steps)
    level = rate * t + jitter * np.random.default_rng(seed).standard_normal(steps)
    return [v + of for v, of in zip(values, level, strict=True)], t


def test_a_camera_that_drifts_is_said_with_what_it_comes_to_by_the_end(tmp_path):
    """0.2 K before the heating is a small part of the whole rise; four times that is in the heat flux."""
    for k, rate in enumerate((0.4, 0.06, -0.06)):
        values, t = drifting(rate, k)
        said = run_of(tmp_path / str(k), values, t, 0.5)
        words = said.split("At that rate it is ")[1]
        assert float(words.split(" K")[0]) == pytest.approx(rate * t[-1], rel=0.1)


@pytest.mark.parametrize("jitter", [0.0, 0.01])
def test_a_camera_that_does_not_drift_is_not_said_to(tmp_path, jitter):
    said = [run_of(tmp_path / str(k), *drifting(0.0, k, jitter), 0.5) for k in range(20)]
    assert said == [""] * 20
