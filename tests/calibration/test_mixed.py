"""Pictures of two cameras under one name: which they are, and with what, instead of what follows from it."""

import re
from dataclasses import replace

import numpy as np
import pytest

from windmark.calibration import Calibration, Free, NotCalibrated, self_calibrate
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Observations, View

ONE = Camera((1600, 1200), 1500.0, cx=805.0, cy=590.0, k1=-0.1)
FREE = ("focal_px", "cx", "cy", "k1")


def seen_by(cameras, seed=1):
    """Marks of 40 markers in a picture by each camera, from all sides."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-1, 1, (40, 3)) * [200, 150, 60]
    xy = []
    for k, camera in enumerate(cameras):
        turn = 2.4 * k
        eye = [320 * np.cos(turn), 320 * np.sin(turn), 700 + 30 * (k % 3)]
        pose = Pose.look_at(eye, [0, 0, 0], [np.cos(1.3 * k), np.sin(1.3 * k), 0])
        xy.append(camera.project(pose.apply(xyz))[0])
    view, point = np.divmod(np.arange(40 * len(cameras)), 40)
    marks = np.concatenate(xy) + rng.normal(0, 0.05, (40 * len(cameras), 2))
    observations = Observations(view, point, marks, np.tile(0.0025 * np.eye(2), (len(marks), 1, 1)))
    return observations, MarkerSet.make([f"m{k:02d}" for k in range(40)], xyz + rng.normal(0, 1.0, xyz.shape))


def calibrated(cameras, **options):
    observations, markers = seen_by(cameras)
    views = [View(f"v{k}") for k in range(len(cameras))]
    start = {"camera": Camera((1600, 1200), 1480.0)}
    return self_calibrate(observations, markers, start, views, datum=Free(), free=FREE, **options)


def causes(result):
    assert isinstance(result, Calibration)
    return [d.cause for d in result.doubts]


@pytest.mark.parametrize(
    "second", [(0, 3, 4, 6), *(pytest.param(who, marks=pytest.mark.slow) for who in (range(5, 10), (1, 4, 8)))]
)
def test_two_cameras_are_told_apart(second):
    other = replace(ONE, focal_px=1540.0, cx=788.0)
    result = calibrated([other if k in second else ONE for k in range(10)])
    assert causes(result) == ["mixed"]
    (doubt,) = result.doubts
    fewer = {f"v{k}" for k in second}
    assert set(doubt.names) in (fewer, {f"v{k}" for k in range(10)} - fewer if len(fewer) == 5 else fewer)
    assert "look like pictures of another camera" in str(doubt)
    focal = sorted(float(n) for n in re.findall("focal length ([0-9.]+)", str(doubt)))
    np.testing.assert_allclose(focal, [1500, 1540], atol=2.0)


@pytest.mark.parametrize(
    "change", [{"cx": 797.0}, pytest.param({"cx": 795.0, "cy": 610.0}, marks=pytest.mark.slow), {"k1": -0.2}]
)
def test_cameras_that_differ_by_less_than_one_that_focuses_anew(change):
    """Two groups, and nothing within them: no lens that scatters from picture to picture makes such (turned pictures,
    another lens of the same make).
    """
    result = calibrated([replace(ONE, **change) if k % 2 else ONE for k in range(12)])
    assert causes(result) == ["mixed"]
    assert set(result.doubts[0].names) in ({f"v{k}" for k in range(0, 12, 2)}, {f"v{k}" for k in range(1, 12, 2)})


@pytest.mark.slow
def test_cameras_so_different_that_nothing_fits():
    """A refusal says why, too."""
    other = replace(ONE, focal_px=2100.0, cx=760.0)
    result = calibrated([other if k % 2 else ONE for k in range(10)], max_sigma0=5.0)
    assert not result
    assert isinstance(result, NotCalibrated)
    assert "look like pictures of another camera" in result.reason


def test_one_camera_is_not_doubted():
    assert "mixed" not in causes(calibrated([ONE] * 10))


@pytest.mark.parametrize(("seed", "size"), [(4, 0.004), (100, 0.002), (115, 0.002)])
def test_a_lens_that_focuses_by_itself_is_no_two_cameras(seed, size):
    """Every picture has a focal length of its own: no division explains that; small ones fall into two by chance."""
    change = np.random.default_rng(seed).normal(0, size, 10)
    result = calibrated([replace(ONE, focal_px=1500.0 * (1 + c)) for c in change])
    assert "mixed" not in causes(result)
    assert {"focal", "principal"} & set(causes(result))


@pytest.mark.slow
@pytest.mark.parametrize("size", [1.0, 2.0, 5.0])
def test_a_stabilised_lens_is_no_two_cameras(size):
    """Every picture has a principal point of its own."""
    shift = np.random.default_rng(7).normal(0, size, (12, 2))
    result = calibrated([replace(ONE, cx=ONE.cx + x, cy=ONE.cy + y) for x, y in shift])
    assert "mixed" not in causes(result)
    assert {"focal", "principal", "sheared", "picture"} & set(causes(result))


def test_one_foreign_picture_is_foreign():
    result = calibrated([replace(ONE, focal_px=1560.0) if k == 3 else ONE for k in range(10)])
    assert "mixed" not in causes(result)
    assert any("v3" in d.names for d in result.doubts)


@pytest.mark.slow
@pytest.mark.parametrize("second", [(1, 3, 5, 7), (4, 5, 6, 7)])
def test_two_zooms_of_a_flat_board_are_no_shear_and_no_change_of_the_board(second):
    """Of a board a focal length and a principal point are mostly taken by the poses: what is left looks like shear."""
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(np.arange(12.0), np.arange(9.0)), axis=-1).reshape(-1, 2) - [5.5, 4.0]
    xyz = np.column_stack([20.0 * grid, np.zeros(len(grid))])
    xy = []
    for k in range(8):
        pose = Pose.look_at([230 * np.cos(2.4 * k), 230 * np.sin(2.4 * k), 330.0], [0, 0, 0], [np.cos(k), np.sin(k), 0])
        seen = ONE.project(pose.apply(xyz))[0]
        xy.append(1.015 * (seen - [800.0, 600.0]) + [800.0, 600.0] if k in second else seen)
    view, point = np.divmod(np.arange(8 * len(xyz)), len(xyz))
    marks = np.concatenate(xy) + rng.normal(0, 0.01, (len(view), 2))
    observations = Observations(view, point, marks, np.tile(0.0001 * np.eye(2), (len(view), 1, 1)))
    markers = MarkerSet.make([f"m{k:03d}" for k in range(len(xyz))], xyz + rng.normal(0, 0.05, xyz.shape))
    start, views = {"camera": Camera((1600, 1200), 1480.0)}, [View(f"v{k}") for k in range(8)]
    result = self_calibrate(observations, markers, start, views, datum=Free(), free=FREE)
    said = result.reason if isinstance(result, NotCalibrated) else str(result.doubts[0])
    assert "look like pictures at another zoom or focus" in said
    names = set(said.split(" look")[0].split(", "))
    assert names in ({f"v{k}" for k in second}, {f"v{k}" for k in range(8) if k not in second})
