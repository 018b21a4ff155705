"""Cameras that nothing in sight watches."""

import numpy as np

from windmark.app.deform_verb import unwatched
from windmark.deformation import Volume, Volumes
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet
from windmark.tasks.deform.task import DeformationTest, Station


def made(role, moves=(False, False)):
    markers = MarkerSet.make(["a", "b"], np.eye(3)[:2], volume=["body", ""], role=["model", role])
    stations = [Station(f"cam{k}", Camera((640, 480), 800.0), Pose.identity(), moves=m) for k, m in enumerate(moves)]
    return DeformationTest(tuple(stations), markers, Volumes.of([Volume("body")]))


def test_without_markers_on_walls_nothing_tells_whether_the_cameras_stood_still():
    (words,) = unwatched(made("model"))
    assert words.startswith("whether the cameras kept their places and focal lengths")
    assert unwatched(made("model", (True, False))) == (words,)


def test_markers_on_walls_tell_it_and_a_camera_that_moves_is_found_anew():
    assert unwatched(made("wall")) == ()
    assert unwatched(made("model", (True, True))) == ()
