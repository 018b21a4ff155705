"""Cameras of a rig registered together: as each camera has it, and without the one that contradicts the others."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes

from windmark.geometry import Pose
from windmark.registration import RigRegistration, register
from windmark.scene import Detections
from windmark.tasks.together import RigView, of_camera, register_together, with_names

NAMES = ("left", "right", "top")


def views_of(rig):
    return [
        RigView(name, view.detections, view.camera, pose)
        for name, view, pose in zip(NAMES, rig.views, rig.cam_from_rig, strict=False)
    ]


def moved(view, shift):
    """The camera said to be elsewhere."""
    return replace(view, cam_from_rig=Pose(view.cam_from_rig.rotation, view.cam_from_rig.translation + shift))


def without_spots(view):
    return replace(view, spots=Detections.make(np.zeros((0, 2))))


def right(done, rig, name):
    """All labels of a camera are right, and its pose is near to the true one."""
    answer, view = done.of(name), rig.views[NAMES.index(name)]
    wrong = scenes.wrong_labels(answer.matching.detection, answer.matching.marker, view)
    return wrong == 0 and len(answer.matching) > 10 and scenes.pose_error_px(answer.cam_from_model, view) < 1


def test_each_camera_has_its_part():
    rig = scenes.rig_scene(520, "A", 3, hidden=0.25, false=0.5)
    done = register_together(views_of(rig), rig.views[0].markers)
    assert done.names == NAMES
    assert not done.left_out
    assert done.of("bottom") is None
    for c, name in enumerate(NAMES):
        one = done.of(name)
        assert right(done, rig, name)
        seen, _ = one.camera.project(one.cam_from_model.apply(one.xyz[one.matching.marker]))
        np.testing.assert_allclose(one.residuals, seen - rig.views[c].detections.xy[one.matching.detection], atol=1e-9)
        assert one.rms_px == pytest.approx(np.sqrt((one.residuals**2).sum(axis=1).mean()))
        assert one.n_expected == done.answer.n_expected[c]
        assert one.log10_nfa == done.answer.log10_nfa
        # Three cameras know the pose better than the one.
        alone = register(rig.views[c].detections, rig.views[c].markers, rig.views[c].camera)
        assert np.trace(np.linalg.solve(alone.cov, one.cov)) < 6


def test_the_covariance_is_that_of_the_camera_s_pose():
    """By finite differences of the pose in the rig."""
    rig = scenes.rig_scene(521, "A", 2)
    found = register_together(views_of(rig), rig.views[0].markers).answer
    one, step = of_camera(found, 1), 1e-6
    change = np.zeros((6, 6))
    for k in range(6):
        delta = step * np.eye(6)[k]
        there = found.cam_from_rig[1] @ Pose.exp(delta) @ found.rig_from_model
        change[:, k] = (there @ one.cam_from_model.inverse()).log() / step
    np.testing.assert_allclose(one.cov, change @ found.cov @ change.T, rtol=1e-4, atol=1e-9 * np.abs(one.cov).max())


@pytest.mark.parametrize("part", [0.3, 0.05, 0.01])
def test_the_camera_that_contradicts_the_others_is_left_out_and_named(part):
    """Off by this part of its distance; by little, any two of the three would do, but two fit much better."""
    rig = scenes.rig_scene(520, "A", 3)
    views = views_of(rig)
    away = part * np.linalg.norm(rig.views[1].cam_from_model.translation) * np.array([1.0, 0, 0])
    views[1] = moved(views[1], away)
    done = register_together(views, rig.views[0].markers)
    assert list(done.left_out) == ["right"]
    assert "camera " in done.left_out["right"]
    assert done.of("right") is None
    assert right(done, rig, "left")
    assert right(done, rig, "top")


def test_of_two_that_contradict_each_other_neither_is_believed():
    rig = scenes.rig_scene(522, "A", 2)
    views = views_of(rig)
    views[1] = moved(views[1], 0.05 * np.linalg.norm(views[1].cam_from_rig.translation) * np.array([1.0, 0, 0]))
    done = register_together(views, rig.views[0].markers)
    assert not done.answer
    assert not done.left_out
    assert done.of("left") is None
    assert "without left or right the rest is registered" in done.answer.reason


@pytest.mark.slow
def test_a_camera_that_shows_something_else_stops_no_other():
    rig, other = scenes.rig_scene(523, "A", 2), scenes.rig_scene(999, "B", 1, false=1.0)
    views = views_of(rig)
    views[0] = replace(views[0], spots=other.views[0].detections)
    done = register_together(views, rig.views[0].markers)
    assert list(done.left_out) == ["left"]
    assert right(done, rig, "right")


def test_a_camera_without_spots_has_its_place_from_the_others_and_nothing_checks_it():
    rig = scenes.rig_scene(520, "A", 3)
    views = views_of(rig)
    views[0] = without_spots(views[0])
    done = register_together(views, rig.views[0].markers)
    assert isinstance(done.answer, RigRegistration)
    one = done.of("left")
    assert scenes.pose_error_px(one.cam_from_model, rig.views[0]) < 1
    assert (len(one.matching), one.weak) == (0, ())
    assert np.isnan(one.rms_px)
    assert one.unchecked[0].what == "place in the rig"
    for name in ("right", "top"):
        said = [u.words for u in done.of(name).unchecked if u.what == "place in the rig"]
        assert all("taken as exact" in words for words in said)


def test_nothing_anywhere_is_refused():
    rig = scenes.rig_scene(520, "A", 2)
    done = register_together([without_spots(v) for v in views_of(rig)], rig.views[0].markers)
    assert done.answer.cause == "too_few"


def test_reasons_have_names():
    assert with_names("but camera 1 shows 3; in camera 0 more", ["a", "b"]) == "but camera b shows 3; in camera a more"
