"""Marks of mirrored pictures are named as that, and labels that are wrong are not called mirrored."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.calibration import Free, NotCalibrated, self_calibrate
from windmark.pipeline.verdict.network import calibrate_verdict


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
