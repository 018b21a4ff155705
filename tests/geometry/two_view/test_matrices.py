"""Essential and fundamental matrices of known poses."""

import numpy as np
import pytest

from windmark.geometry import DegenerateGeometry, Pose
from windmark.geometry.two_view import (
    epipoles,
    essential_from_fundamental,
    essential_from_poses,
    fundamental_from_essential,
    fundamental_from_poses,
    ideal_pixels,
    sampson_distance,
)


def test_they_annihilate_true_pairs(scene, other_camera):
    s = scene(camera_b=other_camera)
    a, b = s.camera_a.unproject(s.xy_a), s.camera_b.unproject(s.xy_b)
    assert np.abs(np.sum(b * (a @ essential_from_poses(s.b_from_a).T), axis=1)).max() < 1e-13
    f = fundamental_from_poses(s.camera_a, Pose.identity(), s.camera_b, s.b_from_a)
    distance = sampson_distance(f, ideal_pixels(s.camera_a, s.xy_a), ideal_pixels(s.camera_b, s.xy_b))
    assert np.abs(distance).max() < 1e-9
    assert np.abs(sampson_distance(f, s.xy_a, s.xy_b)).max() > 1.0  # the lens is no small thing here


def test_swapping_the_pictures_transposes(scene, other_camera):
    s = scene(camera_b=other_camera)
    a_from_model = Pose.from_rotvec([0.3, -0.2, 0.1], [1.0, 2, 3])
    f = fundamental_from_poses(s.camera_a, a_from_model, s.camera_b, s.b_from_a @ a_from_model)
    back = fundamental_from_poses(s.camera_b, s.b_from_a @ a_from_model, s.camera_a, a_from_model)
    assert min(np.abs(f.T - back).max(), np.abs(f.T + back).max()) < 1e-15
    np.testing.assert_allclose(
        essential_from_poses(s.b_from_a.inverse()), essential_from_poses(s.b_from_a).T, atol=1e-15
    )


def test_singular_values_and_length_of_the_baseline(scene):
    s = scene()
    e = essential_from_poses(s.b_from_a)
    np.testing.assert_allclose(np.linalg.svd(e, compute_uv=False), [1, 1, 0], atol=1e-15)
    np.testing.assert_allclose(essential_from_poses(s.unit), e, atol=1e-15)


def test_there_and_back(scene, other_camera):
    e = essential_from_poses(scene().b_from_a)
    back = essential_from_fundamental(
        fundamental_from_essential(e, other_camera, other_camera), other_camera, other_camera
    )
    np.testing.assert_allclose(back, e, atol=1e-12)


def test_epipoles_are_the_images_of_the_other_station(scene):
    s = scene()
    in_a, in_b = epipoles(essential_from_poses(s.b_from_a))
    for found, station in ((in_a, s.b_from_a.center), (in_b, s.b_from_a.translation)):
        assert np.abs(np.cross(found, station)).max() < 1e-14


def test_batches():
    poses = Pose.from_rotvec(np.random.default_rng(0).normal(size=(5, 3)), np.random.default_rng(1).normal(size=(5, 3)))
    e = essential_from_poses(poses)
    for k in range(5):
        np.testing.assert_allclose(
            e[k], essential_from_poses(Pose(poses.rotation[k], poses.translation[k])), atol=1e-15
        )
    assert epipoles(e)[0].shape == (5, 3)


def test_one_place_has_no_essential_matrix():
    with pytest.raises(DegenerateGeometry, match="baseline"):
        essential_from_poses(Pose.identity())
