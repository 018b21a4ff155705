"""Pose from labelled spots without a start."""

import numpy as np
import pytest
import registration_scenes as scenes

from windmark.geometry import Camera, DegenerateGeometry, Pose
from windmark.registration import pose_from_labels


def labelled(seed, kind="B", noise_px=0.2, **options):
    scene = scenes.scene(seed, kind, noise_px=noise_px, **options)
    true = scene.label >= 0
    return scene, scene.detections.xy[true], scene.markers.xyz[scene.label[true]]


@pytest.mark.parametrize("kind", ["A", "B"])
@pytest.mark.parametrize("seed", range(6))
def test_any_view_without_a_start(seed, kind):
    scene, xy, xyz = labelled(seed, kind)
    estimate = pose_from_labels(xy, xyz, scene.camera)
    assert scenes.pose_error_px(estimate.cam_from_model, scene) < 1.0
    assert 0.15 < estimate.rms_px < 0.4


def test_exact_spots_give_the_exact_pose():
    scene, xy, xyz = labelled(3, noise_px=0.0)
    for count in (4, 6, 50):
        estimate = pose_from_labels(xy[:count], xyz[:count], scene.camera)
        np.testing.assert_allclose(estimate.cam_from_model.translation, scene.cam_from_model.translation, rtol=1e-6)


def test_order_and_seed_do_not_matter():
    scene, xy, xyz = labelled(5)
    reference = pose_from_labels(xy, xyz, scene.camera).cam_from_model
    order = np.random.default_rng(0).permutation(len(xy))
    for other in (
        pose_from_labels(xy[order], xyz[order], scene.camera),
        pose_from_labels(xy, xyz, scene.camera, seed=9),
    ):
        np.testing.assert_allclose(other.cam_from_model.translation, reference.translation, rtol=1e-6)


def test_wrong_labels_with_a_robust_loss():
    scene, xy, xyz = labelled(6)
    wrong = np.random.default_rng(0).choice(len(xy), len(xy) // 4, replace=False)
    xyz = xyz.copy()
    xyz[wrong] = xyz[np.roll(wrong, 1)]
    estimate = pose_from_labels(xy, xyz, scene.camera, loss="tukey", cov=np.tile(0.04 * np.eye(2), (len(xy), 1, 1)))
    assert scenes.pose_error_px(estimate.cam_from_model, scene) < 1.0
    assert (estimate.weights[wrong] < 0.01).all()
    assert pose_from_labels(xy, xyz, scene.camera).rms_px > 20


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_focal_length_wrong_by_a_factor_of_two(factor):
    scene, xy, xyz = labelled(8)
    guess = Camera(scene.camera.size_px, factor * scene.camera.focal_px)
    estimate = pose_from_labels(xy, xyz, guess, free=("focal_px",))
    assert estimate.camera.focal_px == pytest.approx(scene.camera.focal_px, rel=0.05)
    assert estimate.rms_px < 0.4


def test_two_equal_poses_are_refused():
    rng = np.random.default_rng(2)
    xyz = rng.uniform(-1, 1, (12, 3)) * [1, 1, 0]
    camera = Camera((1000, 1000), 50_000.0)
    pose = Pose.look_at([120, 80, 250], [0, 0, 0], [0, 1, 0])
    xy, _ = camera.project(pose.apply(xyz))
    with pytest.raises(DegenerateGeometry, match="equally well") as caught:
        pose_from_labels(xy + rng.normal(0, 0.5, xy.shape), xyz, camera, cov=np.tile(0.25 * np.eye(2), (12, 1, 1)))
    assert caught.value.weak == ("rotation_x", "rotation_y")
    near = Camera((1000, 1000), 800.0)
    pose = Pose.look_at([1.5, 1.0, 3.0], [0, 0, 0], [0, 1, 0])
    xy, _ = near.project(pose.apply(xyz))
    found = pose_from_labels(xy + rng.normal(0, 0.5, xy.shape), xyz, near).cam_from_model
    assert np.degrees(found.angle_to(pose)) < 1


def test_degenerate_input():
    scene, xy, xyz = labelled(1)
    with pytest.raises(DegenerateGeometry, match="3 pairs"):
        pose_from_labels(xy[:3], xyz[:3], scene.camera)
    with pytest.raises(DegenerateGeometry, match="one line"):
        pose_from_labels(xy, np.arange(len(xy))[:, None] * [1.0, 2.0, 3.0], scene.camera)
    flat = np.random.default_rng(0).uniform(-1, 1, (20, 3)) * [1, 1, 0]
    frontal = Pose.look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])
    camera = Camera((1000, 1000), 1000.0)
    seen, _ = camera.project(frontal.apply(flat))
    with pytest.raises(DegenerateGeometry):
        pose_from_labels(seen, flat, camera, free=("focal_px",))


def test_wrong_input_names_the_parameter():
    scene, xy, xyz = labelled(1)
    with pytest.raises(ValueError, match="xyz"):
        pose_from_labels(xy, xyz[:-1], scene.camera)
    with pytest.raises(ValueError, match="xy must be"):
        pose_from_labels(xyz, xyz, scene.camera)
    bad = xy.copy()
    bad[2, 0] = np.nan
    with pytest.raises(ValueError, match="row 2"):
        pose_from_labels(bad, xyz, scene.camera)
    curved = Camera(scene.camera.size_px, 400.0, k1=-0.4)
    with pytest.raises(ValueError, match="no inverse"):
        pose_from_labels(xy + 3000, xyz, curved)
