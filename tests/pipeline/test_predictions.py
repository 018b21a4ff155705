"""Where markers are expected: ellipses from camera and pose, or from a frame before."""

import numpy as np
import pytest

from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.pipeline.predictions import from_camera, from_detections
from windmark.scene import Detections, MarkerSet

CAMERA = Camera((400, 300), 500.0, k1=-0.1)
POSE = Pose(np.eye(3), np.array([0.0, 0.0, 50.0]))


def markers(**columns):
    return MarkerSet.make(
        ["a", "away", "round", "outside", "behind"],
        [[2, 1, 0], [0, 0, 0], [-3, 2, 1], [60, 0, 0], [0, 0, -80.0]],
        normal=[[0.5, 0, -0.8660254], [0, 0, 1], [np.nan] * 3, [0, 0, -1], [0, 0, -1]],
        **columns,
    )


def test_ellipses_of_those_that_face_the_camera():
    known = markers(radius=np.full(5, 0.4))
    got = from_camera(CAMERA, POSE, known)
    assert got.name == ("a", "round")
    exact = imaged_ellipse(CAMERA, POSE.apply(known.xyz[:1]), known.normal[:1], 0.4)
    np.testing.assert_allclose(got.xy[0], exact.xy[0])
    np.testing.assert_allclose(got.axes_px[0], exact.axes_px[0])
    assert got.axes_px[1, 1] / got.axes_px[1, 0] > 0.98


def test_without_a_radius_discs_are_round_and_as_given():
    got = from_camera(CAMERA, POSE, markers(), 3.5)
    np.testing.assert_allclose(got.axes_px, 3.5)
    with pytest.raises(ValueError, match="no radius"):
        from_camera(CAMERA, POSE, markers())


def test_from_a_frame_before():
    spots = Detections.make(
        [[10, 20], [30, 40.0]], radius_px=[3.0, 4.0], axes_px=[[3.5, 2.5], [np.nan, np.nan]], angle=[0.3, np.nan]
    )
    got = from_detections(spots, ["a", ""])
    np.testing.assert_allclose(got.axes_px, [[3.5, 2.5], [4.0, 4.0]])
    np.testing.assert_allclose(got.angle, [0.3, 0.0])
    bare = Detections.make([[10, 20.0]])
    np.testing.assert_allclose(from_detections(bare, [""], 2.0).axes_px, 2.0)
    with pytest.raises(ValueError, match="neither"):
        from_detections(bare, [""])
