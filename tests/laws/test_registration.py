"""Laws of registration: what must not change the answer, and how the answer must change."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes
from hypothesis import given, settings
from hypothesis import strategies as st

from windmark.geometry import Camera, Pose
from windmark.registration import register
from windmark.scene import Detections

LAW = settings(max_examples=6, deadline=None, derandomize=True)
SEEDS = st.integers(0, 2**31)


def scene_of(seed, **options):
    return scenes.scene(seed, "AB"[seed % 2], **{"hidden": 0.25, "false": 0.5, **options})


def reference(scene):
    result = register(scene.detections, scene.markers, scene.camera)
    assert result, result.reason
    return result


def pairs(result):
    return set(zip(result.matching.detection.tolist(), result.matching.marker.tolist(), strict=True))


def markers_like(markers, xyz, normal):
    return replace(markers, xyz=xyz, normal=normal)


def assert_same_view(result, expected, scene, tolerance_px=0.02):
    """Both poses see the markers at the same pixels."""
    seen = [scene.camera.project(pose.apply(scene.markers.xyz))[0] for pose in (result, expected)]
    np.testing.assert_allclose(*seen, atol=tolerance_px)


@LAW
@given(SEEDS)
def test_order_of_spots_and_markers_does_not_matter(seed):
    scene = scene_of(seed)
    first = reference(scene)
    rng = np.random.default_rng(seed)
    spots, rows = rng.permutation(len(scene.detections)), rng.permutation(len(scene.markers))
    other = register(scene.detections.take(spots), scene.markers.take(rows), scene.camera)
    assert other
    assert {(int(spots[d]), int(rows[m])) for d, m in pairs(other)} == pairs(first)
    assert_same_view(other.cam_from_model, first.cam_from_model, scene)


@LAW
@given(SEEDS, st.sampled_from([25.4, 1e-3, 0.0254]))
def test_length_unit_only_scales_the_translation(seed, unit):
    scene = scene_of(seed)
    first = reference(scene)
    scaled = markers_like(scene.markers, unit * scene.markers.xyz, scene.markers.normal)
    other = register(scene.detections, scaled, scene.camera)
    assert other
    assert pairs(other) == pairs(first)
    back = Pose(other.cam_from_model.rotation, other.cam_from_model.translation / unit)
    assert_same_view(back, first.cam_from_model, scene)
    scale = np.diag([1, 1, 1, unit, unit, unit])
    np.testing.assert_allclose(other.cov, scale @ first.cov @ scale, rtol=0.02, atol=1e-3 * np.abs(other.cov).max())


@LAW
@given(SEEDS)
def test_model_frame_is_free(seed):
    scene = scene_of(seed)
    first = reference(scene)
    rng = np.random.default_rng(seed)
    moved_from_model = Pose.exp(rng.normal(size=6) * [2, 2, 2, 5, 5, 5])
    moved = markers_like(
        scene.markers, moved_from_model.apply(scene.markers.xyz), moved_from_model.rotate(scene.markers.normal)
    )
    other = register(scene.detections, moved, scene.camera)
    assert other
    assert pairs(other) == pairs(first)
    assert_same_view(other.cam_from_model @ moved_from_model, first.cam_from_model, scene)


@LAW
@given(SEEDS)
def test_flip_of_image_and_model_flips_the_pose(seed):
    scene = scene_of(seed)
    first = reference(scene)
    flip = np.diag([-1.0, 1.0, 1.0])
    width = scene.camera.size_px[0]
    spots = Detections.make(scene.detections.xy * [-1, 1] + [width - 1, 0], cov=scene.detections.cov)
    mirrored = markers_like(scene.markers, scene.markers.xyz @ flip, scene.markers.normal @ flip)
    other = register(spots, mirrored, scene.camera)
    assert other
    assert pairs(other) == pairs(first)
    pose = other.cam_from_model
    back = Pose(flip @ pose.rotation @ flip, flip @ pose.translation)
    assert_same_view(back, first.cam_from_model, scene)


@LAW
@given(SEEDS)
def test_quarter_turn_of_the_camera_turns_the_pose(seed):
    scene = scene_of(seed)
    first = reference(scene)
    width, height = scene.camera.size_px
    # (x, y) -> (h - 1 - y, x): the image turned clockwise by 90 degrees.
    xy = scene.detections.xy
    spots = Detections.make(np.column_stack([height - 1 - xy[:, 1], xy[:, 0]]), cov=scene.detections.cov)
    camera = Camera((height, width), scene.camera.focal_px)
    other = register(spots, scene.markers, camera)
    assert other
    assert pairs(other) == pairs(first)
    quarter = Pose.from_rotvec([0, 0, np.pi / 2], [0, 0, 0])
    assert_same_view(quarter.inverse() @ other.cam_from_model, first.cam_from_model, scene)


@LAW
@given(SEEDS)
def test_crop_of_the_sensor_changes_nothing(seed):
    scene = scene_of(seed)
    first = reference(scene)
    w, h = scene.camera.size_px
    grown = Camera((w + 300, h + 200), scene.camera.focal_px, cx=scene.camera.cx + 120, cy=scene.camera.cy + 90)
    spots = Detections.make(scene.detections.xy + np.array([120, 90]), cov=scene.detections.cov)
    other = register(spots, scene.markers, grown, tolerance_px=first.options["tolerance_px"])
    # On the larger sensor more markers are in view, and missing.
    assert other
    assert len(pairs(other) ^ pairs(first)) <= 1
    assert_same_view(other.cam_from_model, first.cam_from_model, scene, 0.5)


@LAW
@given(SEEDS)
def test_prior_at_the_solution_changes_nothing(seed):
    scene = scene_of(seed)
    first = reference(scene)
    other = register(scene.detections, scene.markers, scene.camera, prior=first.cam_from_model)
    assert other
    assert pairs(other) == pairs(first)
    assert_same_view(other.cam_from_model, first.cam_from_model, scene)
    assert other.log10_nfa < first.log10_nfa


@LAW
@given(SEEDS)
def test_accepted_is_right(seed):
    scene = scene_of(seed, hidden=[0.0, 0.5, 0.7][seed % 3], false=[0.0, 1.0, 2.0][seed // 3 % 3])
    result = register(scene.detections, scene.markers, scene.camera, max_hypotheses=200_000)
    if result:
        assert scenes.pose_error_px(result.cam_from_model, scene) < 3.0
        assert scenes.wrong_labels(result.matching.detection, result.matching.marker, scene) <= 1


@LAW
@given(SEEDS)
def test_covariance_of_spots_scales_the_covariance_of_the_pose(seed):
    scene = scene_of(seed, noise_px=1.0, false=0.0)
    results = [
        register(Detections.make(scene.detections.xy, sigma_px=sigma), scene.markers, scene.camera, tolerance_px=12.0)
        for sigma in (1.0, 3.0)
    ]
    assert all(results)
    # Told three times the noise, the pose is three times as uncertain; the fitted pixels stay.
    ratio = np.sqrt(np.diag(results[1].cov) / np.diag(results[0].cov))
    assert ratio == pytest.approx(3.0, rel=0.25)
