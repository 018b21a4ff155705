"""Poses of essential matrices and of plane homographies."""

import numpy as np
import pytest

from windmark.geometry import DegenerateGeometry, Pose
from windmark.geometry.two_view import (
    cheirality,
    decompose_essential,
    decompose_homography,
    essential_from_poses,
    homography_from_plane,
    pose_from_essential,
    ray_depths,
)


def plane_pairs(pose, normal, distance, n=30, seed=0):
    """Rays (z = 1) of points of a plane; frame a, baseline 1."""
    rays_a = np.column_stack([np.random.default_rng(seed).uniform(-0.3, 0.3, (n, 2)), np.ones(n)])
    xyz = rays_a * (distance / (rays_a @ normal))[:, None]
    b = pose.apply(xyz)
    return rays_a, b / b[:, 2:]


@pytest.mark.parametrize("seed", range(5))
def test_the_four_poses(scene, seed):
    s = scene(seed=seed)
    e = essential_from_poses(s.b_from_a)
    poses = decompose_essential(-2.5 * e)
    for p in poses:
        again = essential_from_poses(p)
        assert min(np.abs(again - e).max(), np.abs(again + e).max()) < 1e-12
    assert (
        sum(np.allclose(p.rotation, s.unit.rotation) and np.allclose(p.translation, s.unit.translation) for p in poses)
        == 1
    )
    a, b = s.camera_a.unproject(s.xy_a), s.camera_b.unproject(s.xy_b)
    pose, front = pose_from_essential(e, a, b)
    np.testing.assert_allclose(pose.translation, s.unit.translation, atol=1e-12)
    assert front.all()
    assert sum(cheirality(p, a, b).any() for p in poses) == 1


def test_depths_along_the_rays(scene):
    s = scene()
    a, b = s.camera_a.unproject(s.xy_a), s.camera_b.unproject(s.xy_b)
    depth_a, depth_b = ray_depths(s.b_from_a, a, b)
    np.testing.assert_allclose(depth_a, s.xyz_a[:, 2], rtol=1e-9)
    np.testing.assert_allclose(depth_b, s.b_from_a.apply(s.xyz_a)[:, 2], rtol=1e-9)


def test_weights_decide(scene):
    """Pairs without parallax have signs of their own: they are given no weight."""
    s = scene(n=30)
    a, b = s.camera_a.unproject(s.xy_a), s.camera_b.unproject(s.xy_b)
    b[5:] = 2 * b[5:].mean(axis=0) - b[5:]
    weights = np.r_[np.ones(5), np.zeros(25)]
    pose, _ = pose_from_essential(essential_from_poses(s.b_from_a), a, b, weights)
    np.testing.assert_allclose(pose.translation, s.unit.translation, atol=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_a_plane_gives_one_or_two_poses(seed):
    rng = np.random.default_rng(seed)
    t, normal = rng.normal(size=3), rng.normal(size=3) * 0.3 + [0, 0, 1]
    pose = Pose.from_rotvec(rng.normal(size=3) * 0.2, t / np.linalg.norm(t))
    normal /= np.linalg.norm(normal)
    a, b = plane_pairs(pose, normal, 5.0)
    found = decompose_homography(-3 * homography_from_plane(pose, normal, 5.0), a, b)
    assert len(found) in (1, 2)
    true = min(found, key=lambda p: float(np.linalg.norm(p.b_from_a.translation - pose.translation)))
    np.testing.assert_allclose(true.b_from_a.rotation, pose.rotation, atol=1e-9)
    np.testing.assert_allclose(true.b_from_a.translation, pose.translation, atol=1e-8)
    np.testing.assert_allclose(true.normal, normal, atol=1e-8)
    assert true.distance == pytest.approx(5.0)
    h = homography_from_plane(pose, normal, 5.0)
    for p in found:  # both explain the pairs, with the plane in front
        np.testing.assert_allclose(
            homography_from_plane(p.b_from_a, p.normal, p.distance), h / np.linalg.svd(h)[1][1], atol=1e-9
        )
        assert (a @ p.normal > 0).all()
        assert cheirality(p.b_from_a, a, b).all()


def test_along_the_normal_both_poses_are_one():
    normal = np.array([0.1, 0.2, 1.0]) / np.linalg.norm([0.1, 0.2, 1.0])
    pose = Pose(np.eye(3), -normal)
    for p in decompose_homography(homography_from_plane(pose, normal, 5.0), *plane_pairs(pose, normal, 5.0)):
        np.testing.assert_allclose(p.b_from_a.translation, pose.translation, atol=1e-6)


def test_against_opencv():
    cv2 = pytest.importorskip("cv2")
    pose = Pose.from_rotvec([0.1, -0.2, 0.05], np.array([0.8, -0.6, 0.0]))
    normal = np.array([0.2, -0.3, 0.93]) / np.linalg.norm([0.2, -0.3, 0.93])
    h = homography_from_plane(pose, normal, 5.0)
    _, rotations, translations, normals = cv2.decomposeHomographyMat(h, np.eye(3))
    a, b = plane_pairs(pose, normal, 5.0)
    for p in decompose_homography(h, a, b):
        assert any(
            np.allclose(p.b_from_a.rotation, r, atol=1e-7)
            and np.allclose(p.b_from_a.translation / p.distance, t[:, 0], atol=1e-7)
            and np.allclose(p.normal, n[:, 0], atol=1e-6)
            for r, t, n in zip(rotations, translations, normals, strict=True)
        )


def test_what_has_no_pose():
    a = b = np.ones((4, 3))
    with pytest.raises(DegenerateGeometry, match="rotation"):
        decompose_homography(Pose.from_rotvec([0.1, 0.2, 0.3], [0, 0, 0]).rotation, a, b)
    with pytest.raises(ValueError, match="singular"):
        decompose_homography(np.diag([1.0, 1, 0]), a, b)
    with pytest.raises(ValueError, match="decompose_essential"):
        decompose_essential(np.zeros((3, 3)))
    with pytest.raises(ValueError, match="distance"):
        homography_from_plane(Pose.identity(), [0, 0, 1.0], -1.0)
