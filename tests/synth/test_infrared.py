"""The virtual infrared test: temperatures, warm markers, and that it is the same every time."""

import numpy as np
import pytest

import windmark as wm
from windmark.synth.infrared import KELVIN_PER_COUNT, infrared_test


@pytest.fixture(scope="module")
def made():
    return infrared_test(3, rises_K=(("low", 1.0), ("high", 10.0)))


def test_grey_levels_are_temperatures_with_the_cameras_noise(made):
    shot = made.shot
    inner = shot.perfect.triangle >= 0
    for name, frame in made.frames.items():
        kelvin = frame * KELVIN_PER_COUNT
        off = kelvin - made.temperature(name, shot.perfect.image)
        assert abs(np.median(off[inner])) < 0.003
        # Where nothing is blurred away only noise and the rounding to counts are left.
        spread = 1.4826 * np.median(np.abs(off[inner]))
        assert 0.029 < spread < 0.035
    assert made.frames["high"].max() > made.frames["low"].max() + 900


def test_markers_are_warm_and_where_the_truth_says(made):
    truth = made.shot.perfect.markers
    on_model = truth.visible & (made.test.markers.role == "model")
    found = wm.detect(made.frames["high"], radius_px=(1.5, 2, 2.5), polarity="bright")
    off = np.linalg.norm(found.xy[:, None] - truth.ellipse_xy[None, truth.visible], axis=2)
    assert (off.min(axis=1) < 0.3).all()  # those of the wall are nearly cold, and seldom found
    assert (off.min(axis=0) < 0.3)[on_model[truth.visible]].mean() > 0.95
    assert not len(wm.detect(made.frames["high"], radius_px=(1.5, 2, 2.5), polarity="dark"))


@pytest.mark.slow
def test_same_seed_same_picture(made):
    again = infrared_test(3, rises_K=(("low", 1.0), ("high", 10.0)))
    for name, frame in made.frames.items():
        np.testing.assert_array_equal(frame, again.frames[name])
    assert (infrared_test(4, rises_K=(("low", 1.0),)).frames["low"] != made.frames["low"]).any()
