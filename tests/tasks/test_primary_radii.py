"""Radii of primaries beside what their discs are by their places: a table in two units."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.scene import Detections, MarkerSet, Tracks, View
from windmark.tasks.reconstruct.doubts import radii_differ

XYZ = np.array([[-100.0, 0.0, 0.0], [100.0, 0.0, 0.0], [0.0, 80.0, 30.0], [0.0, -80.0, 0.0]])
CAMERA, POSE = Camera((800, 600), 1000.0), Pose(np.eye(3), np.array([0.0, 0.0, 1000.0]))


def doubts(table_radius, spot_radius):
    """Four discs of radius 2.5 at the camera's focal length away."""
    spots = Detections.make(CAMERA.project(POSE.apply(XYZ))[0], radius_px=spot_radius)
    markers = MarkerSet.make(["a", "b", "c", "d"], XYZ, radius=table_radius)
    task = SimpleNamespace(primary=markers, detections=[spots], camera=lambda _: CAMERA)
    tracks = Tracks(np.arange(4), np.zeros(4, np.int64), np.arange(4))
    return radii_differ(task, markers, tracks, [View("v", "c", "v", POSE)])


@pytest.mark.parametrize(("radius", "words"), [(2500.0, "times smaller"), (0.0025, "times larger")])
def test_radii_in_another_unit_are_doubted(radius, words):
    (doubt,) = doubts(radius, 2.5)
    assert doubt.cause == "units"
    assert words in str(doubt)
    assert "e+" not in str(doubt)


@pytest.mark.parametrize("radius", [2.5, 5.0, 1.4, np.nan])
def test_radii_diameters_and_tables_without_are_no_doubt(radius):
    assert doubts(radius, 2.5) == []


def test_spots_without_a_radius_say_nothing():
    assert doubts(2500.0, np.nan) == []
