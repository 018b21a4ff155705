"""Markers of a table that no picture of a calibration has where the table says."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.scene import Detections, MarkerSet, View
from windmark.tasks.calibrate.beside import beside_their_place

CAMERA = Camera((1000, 800), 1500.0)
TABLE = MarkerSet.make(
    [f"m{k:02d}" for k in range(30)], np.random.default_rng(1).uniform([-200, -150, -20], [200, 150, 20], (30, 3)),
    normal=np.tile([0.0, 0.0, 1.0], (30, 1)),
)  # fmt: skip


def network(truth, clutter, gone=()):
    """Calibration and pictures of markers that are at (30, 3), of which ``gone`` cannot be seen; m07 is not matched."""
    rng = np.random.default_rng(3)
    views, pictures = [], []
    for k in range(10):
        eye = [60.0 * k - 300, 200 * np.sin(k), 900.0]
        pose = Pose.look_at(eye, [0, 0, 0], [0, 1, 0])
        xy = CAMERA.project(pose.apply(truth))[0]
        seen = np.setdiff1d(np.flatnonzero(CAMERA.in_image(xy)), gone)
        spots = np.vstack([xy[seen], rng.uniform(0, CAMERA.size_px, (clutter, 2))])
        matched = np.flatnonzero(np.append(seen, [7] * clutter) != 7)
        picture = SimpleNamespace(name=f"P{k}", detections=Detections.make(spots))
        pictures.append((picture, SimpleNamespace(matching=SimpleNamespace(detection=matched))))
        views.append(View(f"P{k}", "camera", "", pose))
    known = TABLE.take(np.setdiff1d(np.arange(30), [7]))
    return SimpleNamespace(markers=known, views=views, cameras={"camera": CAMERA}), pictures


@pytest.mark.parametrize("clutter", [0, 20])
def test_a_marker_beside_its_place_is_named_by_all_pictures_together(clutter):
    truth = TABLE.xyz.copy()
    truth[7, :2] += [6.0, -5.0]
    (doubt,) = beside_their_place(*network(truth, clutter), TABLE)
    assert doubt.cause == "marker"
    assert doubt.names == ("m07",)
    assert "m07 is not where its table says: 10 pictures have a spot without a marker" in str(doubt)


@pytest.mark.parametrize("clutter", [0, 20, 200])
def test_a_marker_that_is_gone_is_beside_nothing(clutter):
    assert not beside_their_place(*network(TABLE.xyz, clutter, gone=[7]), TABLE)


def test_what_was_matched_or_faces_away_is_not_asked():
    truth = TABLE.xyz.copy()
    truth[7, :2] += [6.0, -5.0]
    result, pictures = network(truth, 0)
    away = replace(TABLE, normal=-TABLE.normal)
    assert not beside_their_place(result, pictures, away)
    assert not beside_their_place(SimpleNamespace(**{**vars(result), "markers": TABLE}), pictures, TABLE)
