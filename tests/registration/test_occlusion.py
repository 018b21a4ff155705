"""Markers that a body hides are neither expected nor matched."""

import numpy as np
import pytest
import registration_scenes as scenes

from windmark.geometry import Camera, Pose
from windmark.registration import register
from windmark.scene import Detections, MarkerSet

RADIUS = 0.66


def ball_before_a_wall(seed):
    """36 markers on a wall, 14 on the near half of a ball before it; no normals. A dirt spot lies close to the place
    of every second hidden marker.

    Returns the scene, which markers the ball hides, and the function that tells.
    """
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(-1, 1, 6), np.linspace(-1, 1, 6))
    wall = np.stack([x, y, np.full_like(x, -0.8)], axis=-1).reshape(-1, 3) + rng.normal(0, 0.04, (36, 3)) * [1, 1, 0]
    on_ball = rng.normal([0.0, 0.0, 2.0], 1.0, (14, 3))
    ball = RADIUS * on_ball / np.linalg.norm(on_ball, axis=1, keepdims=True)
    xyz = np.concatenate([wall, ball])
    markers = MarkerSet.make([f"m{k:02d}" for k in range(len(xyz))], xyz)
    camera = Camera((1280, 1000), 1500.0)
    pose = Pose.look_at([0.3, -0.2, 3.5], [0, 0, -0.4], rng.normal(size=3))

    def visible(cam_from_model, _camera):
        eye = cam_from_model.center
        along = markers.xyz - eye
        t = -(along @ eye) / (along**2).sum(axis=1)  # where the line of sight is nearest to the ball's centre
        nearest = np.linalg.norm(eye + t[:, None] * along, axis=1)
        return (nearest > RADIUS) | (np.linalg.norm(markers.xyz, axis=1) < RADIUS + 1e-9)

    seen = visible(pose, camera)
    xy, inside = camera.project(pose.apply(xyz))
    inside &= camera.in_image(xy)
    shown = np.flatnonzero(seen & inside)
    dirty = np.flatnonzero(~seen & inside)[::2]
    spots = np.concatenate(
        [xy[shown] + rng.normal(0, 0.1, (len(shown), 2)), xy[dirty] + rng.normal(0, 0.2, (len(dirty), 2))]
    )
    label = np.concatenate([shown, np.full(len(dirty), -1)])
    scene = scenes.Scene(Detections.make(spots, sigma_px=0.15), markers, camera, pose, label)
    return scene, ~seen & inside, visible


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_hidden_markers_are_neither_expected_nor_labelled(seed):
    scene, hidden, visible = ball_before_a_wall(seed)
    assert hidden.sum() >= 12  # a third of the wall
    plain = register(scene.detections, scene.markers, scene.camera)
    told = register(scene.detections, scene.markers, scene.camera, visible=visible)
    assert plain
    assert told
    assert hidden[plain.matching.marker].any()  # dirt passes for markers behind the ball
    assert not hidden[told.matching.marker].any()
    assert scenes.wrong_labels(told.matching.detection, told.matching.marker, scene) == 0
    assert len(told.matching) == (scene.label >= 0).sum() == told.n_expected
    assert plain.n_expected == told.n_expected + hidden.sum()


def test_evidence_rises_where_a_third_is_hidden():
    scene, _, visible = ball_before_a_wall(4)
    clean = scene.detections.take(np.flatnonzero(scene.label >= 0))
    plain = register(clean, scene.markers, scene.camera)
    told = register(clean, scene.markers, scene.camera, visible=visible)
    assert told.score > plain.score + 10
    assert told.log10_nfa < plain.log10_nfa
    np.testing.assert_array_equal(told.matching.marker, plain.matching.marker)


def test_a_body_that_hides_all_is_likely_the_wrong_one():
    scene, _, _ = ball_before_a_wall(5)
    none = register(scene.detections, scene.markers, scene.camera, visible=lambda pose, camera: np.zeros(50, bool))
    assert not none
    assert "try without occlusion" in none.reason


def test_a_wrong_answer_of_the_function_is_named():
    scene, _, _ = ball_before_a_wall(6)
    with pytest.raises(ValueError, match=r"visible must return \(50,\) bool, got bool \(3,\)"):
        register(scene.detections, scene.markers, scene.camera, visible=lambda pose, camera: np.zeros(3, bool))
