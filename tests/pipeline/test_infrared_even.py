"""Markers are looked for in pictures whose pixels were made equal, where even pictures say how."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.paint import PlanckBand
from windmark.pipeline.infrared import run as infrared_run
from windmark.pipeline.infrared.project import CameraEntry
from windmark.pipeline.infrared.sensors import ThermalSensor, even_reader
from windmark.pipeline.psp.bits import Bits

SIZE = (40, 50)
RNG = np.random.default_rng(3)
GAIN, OFFSET = 1 + 0.02 * RNG.standard_normal(SIZE), 60 * RNG.standard_normal(SIZE)
ENTRY = CameraEntry(name="c", file="c.json", images="*.tif", quantity="radiance", band_um=(8, 12), netd_K=0.03)


def seen(level, rng, noise=3.0):
    return np.rint(GAIN * level + OFFSET + noise * rng.standard_normal(SIZE)).astype(np.uint16)


def made(levels, dead=None):
    """A sensor with even pictures of these levels."""
    own = [np.stack([seen(level, RNG) for _ in range(16)]) for level in levels]
    patterns = tuple(o.mean(axis=0) for o in own)
    cold, hot = (*patterns, None, None)[:2]
    bits, level = (Bits.of(own[0]), float(np.median(own[0]))) if own else (Bits(), float("nan"))
    return ThermalSensor(PlanckBand(8.0, 12.0), ENTRY, cold, hot, 16, 9.0, dead, bits, level, patterns)


@pytest.mark.parametrize(("levels", "left"), [((28000, 33000), 4.0), ((28000,), 70.0), ((), 900.0)])
def test_the_pattern_of_unequal_pixels_is_gone(levels, left):
    picture = seen(31000, RNG)
    done = made(levels).evened(picture)
    assert done.dtype == picture.dtype
    assert np.std(done.astype(float)) < left
    assert abs(np.median(done) - np.median(picture)) < 50
    if not levels:
        assert done is picture


def test_dead_and_saturated_pixels_and_other_bits_stay_as_they_are():
    dead = np.zeros(SIZE, bool)
    dead[3, 4] = True
    picture = seen(31000, RNG)
    picture[3, 4], picture[10:12, 20] = 7, 65535
    done = made((28000, 33000), dead).evened(picture)
    assert done[3, 4] == 7
    assert (done[10:12, 20] == 65535).all()
    shifted = picture // 4 * 4
    other = made((2800, 3300))
    np.testing.assert_array_equal(other.evened(shifted), shifted)


def test_frames_are_followed_in_even_pictures(monkeypatch):
    used = []
    monkeypatch.setattr(infrared_run, "follow_deformation", lambda frames, test, *, read, **_: used.append(read) or [])
    sensor = made((28000, 33000))
    run = SimpleNamespace(sensors={"c": sensor}, deforming=SimpleNamespace(test=None))
    assert list(infrared_run._follow(run, None, [], [], {})) == []
    picture, station = seen(31000, RNG), SimpleNamespace(name="c", camera=SimpleNamespace(size_px=SIZE[::-1]))
    np.testing.assert_array_equal(used[0](picture, station), sensor.evened(picture))
    np.testing.assert_array_equal(even_reader(run.sensors)(picture, station), sensor.evened(picture))
