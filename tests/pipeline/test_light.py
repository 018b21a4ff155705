"""The light of a picture of a paint or thermal camera: pixels that do not measure have none."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import windmark as wm
from windmark import io
from windmark.paint import PlanckBand
from windmark.pipeline import light
from windmark.pipeline.infrared import sensors
from windmark.pipeline.infrared.sensors import ThermalSensor
from windmark.pipeline.psp import pictures
from windmark.synth.degrade import gaussian_blur

H, W = 160, 192
DEFECTS = [(slice(60, 63), slice(80, 83)), (slice(None), 100), (40, 30)]


def scene(seed: int = 1, noise: float = 8.0) -> np.ndarray:
    """Shaded, with dots that tell the blur."""
    y, x = np.indices((H, W))
    levels = 1000 + 200 * np.sin(x / 50) * np.cos(y / 40)
    levels[np.hypot(x % 32 - 16, y % 32 - 16) < 4] *= 0.3
    return np.random.default_rng(seed).normal(gaussian_blur(levels, 0.7), noise)


def spoilt(levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A group, a column and a single pixel that do not measure, and which these are."""
    out, dead = levels.copy(), np.zeros((H, W), bool)
    for at in DEFECTS:
        dead[at], out[at] = True, 120.0
    return out, dead


def test_a_paint_camera_without_dark_pictures_has_no_value_where_its_sensor_has_none(monkeypatch):
    """Only dark and flat pictures told them: without these a group and a column were light as any other."""
    image, dead = spoilt(scene())
    model = wm.SensorModel(dark=0.0, saturation=np.inf, gain=0.05, read_variance=4.0)
    test = SimpleNamespace(
        project=SimpleNamespace(radiometry=SimpleNamespace(max_saturated=0.02)),
        deforming=SimpleNamespace(test=SimpleNamespace(station=lambda name: None)),
        sensors={"a": SimpleNamespace(dark=None, model=model)},
    )
    monkeypatch.setattr(pictures, "read_levels", lambda *_: (np.rint(image).astype(np.uint16), None, 1))
    taken = pictures._taken(test, "a", "on.tif", Path("on-1.tif"))
    np.testing.assert_array_equal(np.isnan(taken.light), dead)
    np.testing.assert_array_equal(np.isnan(taken.variance), dead)


def thermal(**kind) -> ThermalSensor:
    entry = SimpleNamespace(offset=0.0, scale=1.0, quantity="radiance", unit="", saturation=None)
    return ThermalSensor(PlanckBand(8.0, 12.0), entry, kind.get("cold"), kind.get("hot"), 8, 64.0, kind.get("dead"))


def test_a_thermal_camera_has_no_signal_there_and_what_even_pictures_correct_is_no_defect():
    image, dead = spoilt(scene())
    value, variance, full = thermal().signal(image)
    np.testing.assert_array_equal(np.isnan(value), dead)
    np.testing.assert_array_equal(np.isnan(variance), dead)
    assert not full.any()
    # An uncooled camera's columns have offsets, which its even pictures say.
    offset = np.zeros((H, W))
    offset[:, 40::30] = 150.0
    value, _, _ = thermal(cold=500 + offset, hot=1500 + offset).signal(scene() + offset)
    assert np.isfinite(value).all()


@pytest.mark.parametrize("seed", range(4))
def test_a_good_sensor_loses_nothing(seed):
    levels = scene(seed)
    assert light.without_dead(levels) is levels


def test_pixels_that_are_clipped_in_an_even_picture_do_not_count(monkeypatch):
    """They respond by less than they seem to: by up to a half, and nothing of a corrected number shows that."""
    rng = np.random.default_rng(2)
    cold, warm = (np.rint(rng.normal(level, 5, (6, H, W))).astype(np.uint16) for level in (3000, 8000))
    gain = np.ones((H, W))
    gain[20:30, 50:60] = 1.3
    warm = np.minimum(np.rint(warm * gain), 9000).astype(np.uint16)
    full = np.minimum(warm, 8002)
    entry = SimpleNamespace(offset=0.0, scale=1.0, quantity="radiance", unit="", saturation=None, even=("c", "w"),
                            netd_K=None)  # fmt: skip
    project = SimpleNamespace(camera=[entry], path="p.toml")
    monkeypatch.setattr(sensors, "_radiance", lambda _: PlanckBand(8.0, 12.0))
    monkeypatch.setattr(sensors, "_even", lambda p, k, pattern, s: list(cold if pattern == "c" else warm))
    sensor = sensors.read_sensor(project, 0, None)
    assert sensor.dead is not None
    assert sensor.dead[20:30, 50:60].all()
    assert sensor.dead.sum() == 100
    monkeypatch.setattr(sensors, "_even", lambda p, k, pattern, s: list(cold if pattern == "c" else full))
    with pytest.raises(io.FileError, match="of an even picture's pixels are saturated"):
        sensors.read_sensor(project, 0, None)


def test_a_picture_is_asked_once_as_long_as_it_is_there(monkeypatch):
    image, dead = spoilt(scene())
    image, asked, find = np.rint(image).astype(np.uint16), [], light.detection.dead_pixels
    monkeypatch.setattr(light.detection, "dead_pixels", lambda picture: asked.append(1) or find(picture))
    for _ in range(3):
        np.testing.assert_array_equal(np.isnan(light.light_of(image)), dead)
    assert len(asked) == 1
    held = len(light._DEAD)
    light.light_of(image.copy())  # it is gone, and what was known of it
    assert (len(asked), len(light._DEAD)) == (2, held)
