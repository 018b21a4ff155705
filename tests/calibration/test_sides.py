"""A mirrored table, or mirrored pictures, of markers in a plane: said where normals or relief tell, else unchecked."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.calibration import Free, self_calibrate
from windmark.calibration.sides import relief, side_unseen
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Observations, View

EYES = ((-200, -150, 620), (220, -100, 560), (150, 230, 600), (-180, 200, 580), (0, -260, 540))


def sheet(height=0.0, normal=None):
    """49 markers, some higher than others, and the marks of five pictures of them."""
    i, j = np.divmod(np.arange(49), 7)
    rise = height * np.random.default_rng(1).uniform(-1, 1, 49)
    xyz = np.stack([i * 50.0 - 150, j * 55.0 - 165, rise], axis=1)
    given = {} if normal is None else {"normal": np.tile(np.asarray(normal, float), (49, 1))}
    markers = MarkerSet.make([f"m{k}" for k in range(49)], xyz, **given)
    camera = Camera((1600, 1200), 1500.0)
    xy = []
    for k, eye in enumerate(EYES):
        pose = Pose.look_at(eye, [0, 0, 0], [np.cos(k), np.sin(k), 0])
        xy.append(camera.project(pose.apply(xyz))[0])
    xy = np.concatenate(xy) + np.random.default_rng(2).normal(0, 0.03, (49 * len(EYES), 2))
    view, point = np.divmod(np.arange(len(xy)), 49)
    return markers, Observations(view, point, xy, np.tile(0.0009 * np.eye(2), (len(xy), 1, 1)))


def mirrored(markers):
    return replace(markers, xyz=markers.xyz * [-1, 1, 1])


def calibrated(markers, marks):
    views = [View(f"v{k}") for k in range(len(EYES))]
    return self_calibrate(marks, markers, {"camera": Camera((1600, 1200), 1500.0)}, views, datum=Free(),
                          free=("focal_px", "cx", "cy"))  # fmt: skip


def causes(result):
    assert result
    return {d.cause for d in result.doubts}


def test_normals_tell_a_mirrored_table():
    markers, marks = sheet(normal=(0, 0, 1))
    right = calibrated(markers, marks)
    assert "mirrored" not in causes(right)
    assert side_unseen(markers, right) == ""
    wrong = calibrated(mirrored(markers), marks)
    assert wrong.sigma0 == pytest.approx(right.sigma0, rel=1e-3)  # residuals do not
    assert "mirrored" in causes(wrong)
    assert "245 of 245 marks are on the back of their markers" in "; ".join(wrong.warnings)


def test_one_wrong_normal_is_no_mirror():
    markers, marks = sheet(normal=(0, 0, 1))
    normal = markers.normal.copy()
    normal[7] *= -1
    assert "mirrored" not in causes(calibrated(replace(markers, normal=normal), marks))


def test_mirrored_pictures():
    """Flipped left to right about the principal point: the same as a mirrored table."""
    markers, marks = sheet(normal=(0, 0, 1))
    flipped = replace(marks, xy=np.column_stack([1599 - marks.xy[:, 0], marks.xy[:, 1]]))
    assert "mirrored" in causes(calibrated(markers, flipped))


def test_relief_that_is_turned_over():
    markers, marks = sheet(height=1.0)
    right = calibrated(markers, marks)
    assert "mirrored" not in causes(right)
    assert side_unseen(markers, right) == ""
    assert any("turned over" in w for w in calibrated(mirrored(markers), marks).warnings)


def test_what_nothing_tells_is_unchecked():
    """With the side on which the cameras came out, which the user knows."""
    markers, marks = sheet()
    right, wrong = calibrated(markers, marks), calibrated(mirrored(markers), marks)
    assert "mirrored" not in causes(right) | causes(wrong)
    assert "came out on the +z side" in side_unseen(markers, right)
    assert "came out on the -z side" in side_unseen(mirrored(markers), wrong)


def test_relief_of_a_rough_table():
    """Heights that are off by as much as they are high are still no mirror, nor is noise about a plane relief."""
    rng = np.random.default_rng(3)
    flat = np.column_stack([rng.uniform(-100, 100, (60, 2)), np.zeros(60)])
    high = np.column_stack([flat[:, :2], rng.normal(0, 3, 60)])
    rough = high + rng.normal(0, 3, high.shape) * [0, 0, 1]
    assert relief(rough, high) > 5
    assert relief(rough, high * [1, 1, -1]) < -5
    assert relief(flat, high) == 0
    assert abs(relief(flat + rng.normal(0, 0.1, flat.shape) * [0, 0, 1], flat + rng.normal(0, 0.1, flat.shape))) < 5
