"""Marks of mirrored pictures are named as that, and labels that are wrong are not called mirrored."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.calibration import Free, NotCalibrated, mirrored_marks, self_calibrate
from windmark.calibration.setup import Job
from windmark.geometry import Camera, Pose
from windmark.pipeline.verdict.network import calibrate_verdict
from windmark.scene import MarkerSet, Observations, View


@pytest.fixture(scope="module")
def case():
    return networks.make(36, points=16, views=6)


def run(case, change):
    """With the marks (O, 2) of each view changed."""
    observations, markers, cameras, views, _ = networks.nouns(case)
    xy = observations.xy.copy()
    for v, view in enumerate(views):
        width, height = cameras[view.camera].size_px
        mine = observations.view == v
        xy[mine] = change(v, xy[mine], width, height)
    return self_calibrate(replace(observations, xy=xy), markers, cameras, views, datum=Free())


def left_right(v, xy, width, height):
    return np.column_stack([width - 1 - xy[:, 0], xy[:, 1]])


def upward(v, xy, width, height):
    return np.column_stack([xy[:, 0], height - 1 - xy[:, 1]])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "says"),
    [
        (left_right, "the marks of all pictures, or the table of markers, are mirrored"),
        (upward, "the marks of all pictures, or the table of markers, are mirrored"),
        (lambda v, *a: left_right(v, *a) if v % 2 else a[0], "the marks of v01, v03, v05 are mirrored"),
    ],
)
def test_mirrored_marks_are_named(case, change, says):
    found = run(case, change)
    assert isinstance(found, NotCalibrated)
    assert found.cause == "mirrored_marks"
    assert found.reason.startswith(says)
    verdict = calibrate_verdict(found, "mm")
    assert (verdict.word, verdict.cause) == ("bad", "mirrored")
    assert "y downward" in verdict.next_step


def test_wrong_labels_are_not_called_mirrored(case):
    def mixed(v, xy, width, height):
        return np.random.default_rng(v).permutation(xy)

    found = run(case, mixed)
    assert isinstance(found, NotCalibrated)
    assert "mirrored" not in found.reason


def test_a_flat_picture_is_not_called_mirrored_for_another_start(monkeypatch):
    """Flat markers have a pose as good when mirrored; what another start found with them mirrored says nothing."""
    camera, rng = Camera((1600, 1200), 1800.0, k1=-0.1), np.random.default_rng(2)
    xyz = np.column_stack([*(60.0 * np.indices((7, 5)).reshape(2, -1) - [[180.0], [120.0]]), np.zeros(35)])
    eyes = [[500 * np.cos(k), 500 * np.sin(k), 900.0] for k in 2.4 * np.arange(6)]
    poses = [Pose.look_at(eye, [0, 0, 0], [np.cos(k), np.sin(k), 0]) for k, eye in enumerate(eyes)]
    xy = np.concatenate([camera.project(pose.apply(xyz))[0] for pose in poses]) + rng.normal(0, 0.03, (210, 2))
    view, point = np.divmod(np.arange(210), 35)
    marks = Observations(view, point, xy, np.tile(0.0009 * np.eye(2), (210, 1, 1)))
    markers = MarkerSet.make([f"m{k}" for k in range(35)], xyz + rng.normal(0, 3.0, xyz.shape))
    views, free = tuple(View(f"v{k}", "camera") for k in range(6)), ("focal_px", "k1")
    right = self_calibrate(marks, markers, {"camera": camera}, views, datum=Free(), free=free)
    job = Job(marks, markers, views, {"camera": camera}, free, Free(), (), False, (), {})
    refusal = NotCalibrated("no minimum", "not_converged")
    monkeypatch.setattr(mirrored_marks, "_better_mirrored", lambda job, seed: {2})
    assert mirrored_marks.mirrored_refusal(job, refusal, lambda turned: right, 0) is refusal
