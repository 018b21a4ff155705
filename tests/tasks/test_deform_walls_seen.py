"""What a camera that moves sees of the markers on walls which should hold it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from windmark.deformation import Volumes
from windmark.geometry import Camera, Pose
from windmark.pipeline.deform import DeformationTest, Station
from windmark.scene import MarkerSet
from windmark.tasks.deform.sights import _walls
from windmark.tasks.deform.spots import Labelled

CAMERA, AWAY = Camera((400, 300), 800.0), Pose(np.eye(3), np.array([0.0, 0.0, 800.0]))
XYZ = np.array([[0, 0, 0], [50, 20, 0], [-150, -100, 50], [150, -100, 50], [900, 0, 50]], float)
MARKERS = MarkerSet.make(
    ["a", "b", "T1", "T2", "T3"], XYZ, radius=5.0, normal=np.tile([0.0, 0.0, -1.0], (5, 1)),
    role=["model", "model", "wall", "wall", "wall"],
)  # fmt: skip


def walls(marker, **station):
    own = Station("cam", CAMERA, AWAY, **{"moves": True, **station})
    spots = replace(Labelled.none(""), marker=np.array(marker))
    state = SimpleNamespace(cameras={}, cam_from_tunnel={})
    return _walls(DeformationTest((own,), MARKERS, Volumes.of([])), own, spots, state)


def test_those_in_the_picture_are_missed_where_none_is_seen_by_a_camera_that_moves():
    assert walls([0, 1]) == (0, 2)  # the third one is out of the picture
    assert walls([0, 1, 3]) == (1, 0)
    assert walls([0, 1], moves=False) == (0, 0)


@pytest.mark.parametrize(("left", "missed"), [(200, 1), (0, 0)])
def test_what_a_mask_covers_is_not_missed(left, missed):
    mask = np.zeros((300, 400), bool)
    mask[:, :left] = True
    assert walls([0, 1], mask=mask) == (0, missed)
