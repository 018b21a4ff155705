"""The mean of frames that are of one state, and of frames in which the model warms up."""

import numpy as np
import pytest

from windmark.paint import NodeField
from windmark.pipeline.infrared.steady import COURSE, steady_map
from windmark.pipeline.infrared.store import Store
from windmark.tasks.infrared import CameraTemperature

NODES, NOISE, KNOWN = 500, 0.02, 0.1


def mean_of(folder, course, *, level=0.0, seed=0):
    """Of frames (F,) whose temperature differs by so many kelvin; ``level``: jitter of a frame as a whole."""
    store, rng = Store(folder, ("cam",)), np.random.default_rng(seed)
    even = 1 + 0.3 * rng.standard_normal(NODES)
    for k, kelvin in enumerate(course):
        value = 300 + even * kelvin + level * rng.standard_normal() + NOISE * rng.standard_normal(NODES)
        field = NodeField(value, np.full(NODES, NOISE**2), np.full((NODES, 1), KNOWN), ("emissivity",), "K")
        store.put(k, np.zeros((NODES, 3)),
                  {"cam": CameraTemperature(field, np.ones(NODES), np.zeros(NODES, np.uint16))})
    return steady_map(store, range(len(course)), 0.0)


@pytest.mark.parametrize("course", [
    np.linspace(0, 2.7, 30), np.linspace(0, 2.7, 4), [0.0, 2.0], np.sqrt(np.linspace(0, 4, 12)),
    np.sin(np.linspace(0, 6.3, 30)), -np.linspace(0, 2.7, 30), np.r_[np.zeros(15), np.ones(15)],
])  # fmt: skip
def test_a_mean_of_what_changes_is_said_and_its_sigma_holds_the_frames(tmp_path, course):
    done = mean_of(tmp_path, np.asarray(course))
    assert done.course is not None
    assert done.course.in_all == pytest.approx(course[-1] - course[0], abs=0.1)
    assert "temperatures that are not steady" in done.course.words
    assert COURSE in done.field.names
    rms = float(np.std(course))
    assert done.course.kelvin == pytest.approx(rms, rel=0.1)
    assert float(np.median(done.field.sigma)) > 0.9 * rms


@pytest.mark.parametrize("frames", [2, 3, 5, 30])
@pytest.mark.parametrize("seed", range(4))
def test_a_steady_state_a_jitter_and_a_drift_within_the_sigma_are_left_as_they_are(tmp_path, frames, seed):
    for name, course, level in (("still", np.zeros(frames), 0.0), ("drift", np.linspace(0, 0.15, frames), 0.0)):
        done = mean_of(tmp_path / name, course, level=level, seed=seed)
        assert done.course is None
        assert done.field.names == ("emissivity",)
    assert mean_of(tmp_path / "level", np.zeros(30), level=0.5, seed=seed).course is None
