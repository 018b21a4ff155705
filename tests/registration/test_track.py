"""Tracking: labels stay, jumps and losses are survived, regular rows do not slip, the motion is learnt."""

import numpy as np
import pytest
import registration_scenes as scenes
import track_scenes as sequences

from windmark.geometry import Pose
from windmark.registration import Motion, predict, prepare, register, track
from windmark.scene import Detections, MarkerSet


def followed(images, **options):
    """Answers and states of a sequence."""
    state, answers, states = None, [], []
    for scene in images:
        answer, state = track(state, scene.detections, scene.markers, scene.camera, **options)
        answers.append(answer)
        states.append(state)
    return answers, states


def check_labels(answer, scene):
    assert scenes.wrong_labels(answer.matching.detection, answer.matching.marker, scene) == 0
    assert scenes.pose_error_px(answer.cam_from_model, scene) < 5


@pytest.mark.parametrize("kind", ["A", "B"])
def test_markers_that_come_and_go_keep_their_labels(kind):
    images = sequences.sequence(1, kind, sequences.MEDIUM, frames=10, hidden=0.4, false=0.8)
    answers, states = followed(images)
    assert [s.status for s in states] == ["cold"] + ["tracked"] * 9
    for answer, scene in zip(answers, images, strict=True):
        check_labels(answer, scene)
        assert len(answer.matching) == (scene.label >= 0).sum()


def test_pose_and_covariance_are_those_of_register():
    images = sequences.sequence(2, "B", sequences.SLOW, frames=3, hidden=0.2, false=0.2, k1=-0.1)
    answers, states = followed(images)
    assert states[-1].status == "tracked"
    cold = register(images[-1].detections, images[-1].markers, images[-1].camera)
    delta = (answers[-1].cam_from_model @ cold.cam_from_model.inverse()).log()
    sigma = np.sqrt(np.diag(cold.cov))
    assert (np.abs(delta) < 1e-3 * sigma).all()
    np.testing.assert_allclose(answers[-1].cov, cold.cov, rtol=1e-3, atol=1e-6 * np.outer(sigma, sigma).max())
    np.testing.assert_array_equal(answers[-1].matching.marker, cold.matching.marker)
    np.testing.assert_allclose(answers[-1].residuals, cold.residuals, atol=1e-4)
    assert answers[-1].excess_px == pytest.approx(cold.excess_px, rel=1e-3)


def test_a_jump_is_found_again_and_said():
    images = sequences.sequence(3, "A", sequences.SLOW, frames=12, false=0.3, jumps=(6,))
    answers, states = followed(images)
    assert states[6].status == "reacquired"
    assert states[6].reason
    assert [s.status for s in states[7:]] == ["tracked"] * 5
    for answer, scene in zip(answers, images, strict=True):
        check_labels(answer, scene)


def test_empty_frames_are_lost_and_do_not_poison_the_motion():
    images = sequences.sequence(4, "B", sequences.MEDIUM, frames=12, false=0.5, empty=(6, 7))
    answers, states = followed(images)
    assert not answers[6]
    assert [s.status for s in states[6:]] == ["lost", "lost", *["tracked"] * 4]
    assert "searched for" in states[6].reason
    assert states[7].missed == 2
    np.testing.assert_array_equal(states[7].velocity, states[5].velocity)
    np.testing.assert_array_equal(states[7].cam_from_model.rotation, states[5].cam_from_model.rotation)
    check_labels(answers[8], images[8])


def test_dropped_frames_are_bridged_by_their_time():
    images = sequences.sequence(5, "A", sequences.MEDIUM, frames=12)
    state = None
    for k in range(8):
        _, state = track(state, images[k].detections, images[k].markers, images[k].camera)
    answer, later = track(state, images[10].detections, images[10].markers, images[10].camera, dt=3)
    assert later.status == "tracked"
    check_labels(answer, images[10])
    (near, _), (far, _) = predict(state, 3), predict(state, 1)
    truth = images[10].cam_from_model
    assert np.linalg.norm((near @ truth.inverse()).log()) < np.linalg.norm((far @ truth.inverse()).log())


def test_velocity_is_that_of_the_motion():
    """A model that turns by 1 degree and moves by 0.01 per frame."""
    rng = np.random.default_rng(6)
    markers = scenes.wing(rng)
    camera, pose = scenes.random_view(rng, markers)
    centre, turn = markers.xyz.mean(axis=0), np.radians([0.0, 0.6, 0.8])
    state = None
    for k in range(12):
        r = Pose.from_rotvec(k * turn, np.zeros(3)).rotation @ pose.rotation
        moved = Pose(r, pose.apply(centre) + k * np.array([0.01, 0.0, 0.0]) - r @ centre)
        scene = scenes.image_of(rng, markers, camera, moved, noise_px=0.1)
        _, state = track(state, scene.detections, markers, camera)
    sigma = np.sqrt(np.diag(state.cov)[6:])
    error = state.velocity - [*turn, 0.01, 0.0, 0.0]
    assert (np.abs(error) < 4 * sigma).all()
    assert (sigma[:3] < 0.3 * np.linalg.norm(turn)).all()
    assert (state.change < Motion().change).all()


def test_tracked_poses_name_their_weak_directions():
    """A small field of view: the distance is known badly, in every frame."""
    rng = np.random.default_rng(8)
    markers = scenes.wing_and_body(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(8, 8))
    state, named = None, []
    for _ in range(3):
        scene = scenes.image_of(rng, markers, camera, pose, noise_px=0.1)
        answer, state = track(state, scene.detections, markers, camera)
        named.append([weak.motions[0] for weak in answer.weak])
    assert state.status == "tracked"
    assert all("along the viewing direction" in names for names in named)


def test_a_rough_table_is_followed_as_it_is_registered():
    """Every marker off by a twentieth of the spacing, as its sigma says."""
    rng = np.random.default_rng(103)
    markers = scenes.wing_and_body(rng)
    near = np.linalg.norm(markers.xyz[:, None] - markers.xyz, axis=2)
    off = 0.05 * float(np.median(np.sort(near, axis=1)[:, 1]))
    camera, pose = scenes.random_view(rng, markers)
    xyz, sigma = markers.xyz + rng.normal(0, off, markers.xyz.shape), np.full((len(markers), 3), off)
    table = MarkerSet.make(list(markers.name), xyz, normal=markers.normal, sigma=sigma)
    state, statuses = None, []
    for k in range(6):
        moved = Pose(pose.rotation, pose.translation + k * np.array([0.01, 0.0, 0.0]))
        scene = scenes.image_of(rng, markers, camera, moved, noise_px=0.2, hidden=0.2, false=0.3)
        answer, state = track(state, scene.detections, table, camera)
        check_labels(answer, scene)
        statuses.append(state.status)
    assert statuses == ["cold", *["tracked"] * 5]


@pytest.mark.parametrize("part", [0.45, 0.55, 0.9, 1.0])
def test_a_regular_grid_does_not_slip(part):
    """The grid stands still and is then shifted along a row by nearly half a spacing or a whole one."""
    rng = np.random.default_rng(7)
    markers = sequences.markers_of(rng, "G")
    camera, pose = scenes.random_view(rng, markers, fov_deg=(30, 30), tilt_max_deg=20)
    state = None
    for _ in range(8):
        scene = scenes.image_of(rng, markers, camera, pose, noise_px=0.1, hidden=0.1)
        answer, state = track(state, scene.detections, markers, camera, prior=pose)
        check_labels(answer, scene)
    moved = Pose(pose.rotation, pose.translation + pose.rotation @ np.array([0.2 * part, 0.0, 0.0]))
    for _ in range(3):
        scene = scenes.image_of(rng, markers, camera, moved, noise_px=0.1, hidden=0.1)
        answer, state = track(state, scene.detections, markers, camera)
        if answer:
            check_labels(answer, scene)
        else:
            assert answer.cause in ("ambiguous", "time")


@pytest.mark.slow
def test_a_swaying_tower_keeps_its_labels_and_is_said_to_be_bent():
    """Rows of one pitch, which a search without the motion could not tell apart, and a foot that stands still."""
    rng = np.random.default_rng(11)
    x, y = np.meshgrid(np.arange(7) * 0.1, np.arange(4) * 0.45)
    xyz = np.stack([x.ravel(), y.ravel(), np.zeros(28)], axis=1)
    names, normal = [f"m{k}" for k in range(28)], np.tile([0.0, 0.0, 1.0], (28, 1))
    markers = MarkerSet.make(names, xyz, normal=normal)
    camera, pose = scenes.random_view(rng, markers, tilt_max_deg=40)
    away = np.outer((xyz[:, 1] / 1.35) ** 1.5, [0.0, 0.0, 0.02 * 1.35])
    state, bent = None, 0
    for k in range(10):
        real = MarkerSet.make(names, xyz + np.sin(2 * np.pi * k / 12) * away, normal=normal)
        scene = scenes.image_of(rng, real, camera, pose, noise_px=0.1)
        answer, state = track(state, scene.detections, markers, camera, prior=pose if k == 0 else None, search=k == 0)
        if answer:
            np.testing.assert_array_equal(scene.label[answer.matching.detection], answer.matching.marker)
            bent += answer.deformation is not None
    assert bent >= 5


def test_clutter_alone_is_never_the_model():
    images = sequences.sequence(9, "A", sequences.SLOW, frames=5)
    _, states = followed(images)
    rng = np.random.default_rng(9)
    for _ in range(20):
        clutter = Detections.make(rng.uniform(0, 1, (80, 2)) * images[0].camera.size_px, sigma_px=0.2)
        answer, state = track(states[-1], clutter, images[0].markers, images[0].camera, search=False)
        assert not answer
        assert state.status == "lost"


def test_spots_that_were_looked_for_weigh_less():
    images = sequences.sequence(10, "A", sequences.SLOW, frames=4)
    _, states = followed(images[:3])
    last = images[3]
    free, _ = track(states[-1], last.detections, last.markers, last.camera)
    guided, _ = track(states[-1], last.detections, last.markers, last.camera, least_density=1 / 49)
    assert 0 < guided.score < free.score - 10


def test_nothing_is_changed_and_the_same_input_gives_the_same_answer():
    images = sequences.sequence(11, "A", sequences.MEDIUM, frames=5, false=0.5)
    _, states = followed(images[:4])
    before = [np.array(a) for a in states[-1].estimate]
    one, _ = track(states[-1], images[4].detections, images[4].markers, images[4].camera)
    two, _ = track(states[-1], images[4].detections, images[4].markers, images[4].camera)
    np.testing.assert_array_equal(one.cam_from_model.rotation, two.cam_from_model.rotation)
    for old, new in zip(before, states[-1].estimate, strict=True):
        np.testing.assert_array_equal(old, new)


def test_a_better_table_or_camera_may_come_in_between():
    images = sequences.sequence(12, "A", sequences.SLOW, frames=4)
    _, states = followed(images[:3])
    markers = images[0].markers.take(np.arange(20))
    answer, state = track(states[-1], images[3].detections, markers, images[3].camera, layout=prepare(markers))
    assert answer
    assert answer.matching.marker.max() < 20
    assert state.prepared.layout.markers is markers


@pytest.mark.parametrize(
    ("options", "word"),
    [({"dt": 0.0}, "dt"), ({"dt": np.nan}, "dt"), ({"least_density": -1.0}, "least_density")],
)
def test_options_out_of_range_are_refused(options, word):
    scene = sequences.sequence(13, "A", sequences.SLOW, frames=1)[0]
    with pytest.raises(ValueError, match=word):
        track(None, scene.detections, scene.markers, scene.camera, **options)


def test_motion_must_be_positive():
    with pytest.raises(ValueError, match="rotation_rad"):
        Motion(rotation_rad=0.0)


def test_no_pose_no_prediction():
    scene = sequences.sequence(14, "A", sequences.SLOW, frames=1)[0]
    answer, state = track(None, scene.detections.take(np.arange(3)), scene.markers, scene.camera)
    assert not answer
    assert state.cam_from_model is None
    assert np.isnan(state.cov).all()
    with pytest.raises(ValueError, match="no pose yet"):
        predict(state)
