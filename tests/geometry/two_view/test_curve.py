"""The epipolar line of a spot in the other picture, through the lens."""

import numpy as np
import pytest

from windmark.geometry import Camera, Pose, epipolar_curve, epipolar_distance


def test_the_spot_is_on_its_curve(scene, other_camera):
    s = scene(camera_b=other_camera, n=30)
    for xy_a, xy_b, xyz in zip(s.xy_a, s.xy_b, s.xyz_a, strict=True):
        curve = epipolar_curve(xy_a, s.camera_a, s.camera_b, s.b_from_a)
        assert s.camera_b.in_image(curve).all()
        steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
        assert steps.max() < 6.0
        every = np.broadcast_to(xy_a, curve.shape)
        assert np.abs(epipolar_distance(every, curve, s.camera_a, s.camera_b, s.b_from_a).in_b_px).max() < 1e-6
        assert np.linalg.norm(curve - xy_b, axis=1).min() < 4.0
        near = epipolar_curve(xy_a, s.camera_a, s.camera_b, s.b_from_a, depth=(0.99 * xyz[2], 1.01 * xyz[2]))
        assert 2 <= len(near) < len(curve)
        assert np.linalg.norm(near - xy_b, axis=1).min() < 4.0


def test_a_distorted_line_is_bent(scene):
    def bend(camera_b):
        curve = epipolar_curve(s.xy_a[0], s.camera_a, camera_b, s.b_from_a)
        chord = (curve[-1] - curve[0]) / np.linalg.norm(curve[-1] - curve[0])
        return np.abs((curve - curve[0]) @ np.array([-chord[1], chord[0]])).max()

    s = scene()
    assert bend(s.camera_b) > 1.0
    assert bend(Camera(s.camera_b.size_px, s.camera_b.focal_px)) < 1e-9


def test_from_near_to_far():
    camera = Camera((1000, 800), 1000.0)
    side = Pose(np.eye(3), np.array([-1.0, 0.0, 0.0]))
    curve = epipolar_curve([600.0, 300.0], camera, camera, side, depth=(2.0, 10.0))
    np.testing.assert_allclose(curve[[0, -1]], [[100, 300], [500, 300]], atol=1e-9)
    infinite = epipolar_curve([600.0, 300.0], camera, camera, side)
    np.testing.assert_allclose(infinite[-1], [600, 300], atol=1e-9)
    assert infinite[0, 0] < 4.0  # to the border of the picture


def test_nothing_in_the_picture():
    camera = Camera((1000, 800), 1000.0)
    back = Pose.from_rotvec([0, np.pi, 0], [0, 0, -1.0])
    assert epipolar_curve([500.0, 400.0], camera, camera, back).shape == (0, 2)
    aside = Pose(np.eye(3), np.array([0.0, -1.0, 0.0]))
    assert epipolar_curve([500.0, 400.0], camera, camera, aside, depth=(0.1, 0.2)).shape == (0, 2)


def test_behind_camera_b_is_cut_off():
    """A station ahead: the near part of the ray is behind it."""
    camera = Camera((1000, 800), 1000.0)
    ahead = Pose(np.eye(3), np.array([0.0, 0.0, -5.0]))
    curve = epipolar_curve([600.0, 500.0], camera, camera, ahead)
    np.testing.assert_allclose(curve[-1], [600.0, 500.0], atol=1e-9)
    outwards = curve - [499.5, 399.5]
    assert (np.diff(np.linalg.norm(outwards, axis=1)) < 0).all()  # towards the image of infinity


@pytest.mark.parametrize("options", [{"depth": (2.0, 1.0)}, {"depth": (-1.0, 1.0)}])
def test_bad_input(options):
    camera = Camera((1000, 800), 1000.0)
    with pytest.raises(ValueError, match="depth"):
        epipolar_curve([1.0, 2.0], camera, camera, Pose.identity(), **options)
    with pytest.raises(ValueError, match="xy_a"):
        epipolar_curve([[1.0, 2.0]], camera, camera, Pose.identity())
