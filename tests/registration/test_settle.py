"""Settled solutions: labels that grow and heal, the pose of the adjustment, hiding, fixed labels, rigs, bent models."""

from dataclasses import replace

import bent_scenes
import numpy as np
import pytest
import registration_scenes as scenes
import settle_scenes as settling

from windmark.adjust import refine_pose
from windmark.geometry import Pose
from windmark.geometry.rotations import hat
from windmark.registration.settle._kernels.state import EXCESS
from windmark.registration.settle.settling import accepted, copied, with_freedom
from windmark.registration.task import with_focal


def assert_right(solution, *views):
    """Every label right, and all of them."""
    for c, view in enumerate(views):
        spot, marker = solution.pairs(c)
        assert (view.label[spot] == marker).all()
    assert solution.count == sum((view.label >= 0).sum() for view in views)


# --- one camera ------------------------------------------------------------------------------------


@pytest.mark.parametrize("free_focal", [False, True])
def test_fit_is_that_of_the_adjustment(free_focal):
    """Pose and covariance of `refine_pose` with the full camera, the same weights and the same labels."""
    scene = settling.curved_scene(2)
    more = {"focal_factors": settling.FREE} if free_focal else {}
    solution = settling.settled(settling.views_of(scene, **more), scene)
    assert_right(solution, scene)
    spot, marker = solution.pairs()
    cov = scene.detections.cov[spot] + solution.state.numbers[0, EXCESS] * np.eye(2)
    expected = refine_pose(
        scene.camera, scene.cam_from_model, scene.markers.xyz[marker], scene.detections.xy[spot], cov,
        free=("focal_px",) if free_focal else (),
    )  # fmt: skip
    delta = (expected.cam_from_model @ solution.cam_from_model().inverse()).log()
    sigma = np.sqrt(np.diag(expected.cov))
    # The focal length's prior of 47 % moves nothing noticeable; the excess is of the round before.
    assert (np.abs(delta) < 0.03 * sigma[:6]).all()
    np.testing.assert_allclose(
        solution.cov / np.outer(sigma[:6], sigma[:6]),
        expected.cov[:6, :6] / np.outer(sigma[:6], sigma[:6]),
        atol=0.05,
    )


def test_covariance_in_the_models_frame_is_that_of_moved_poses():
    """Of the unit model turned about its centre, brought to ``exp(delta) @ pose``: by the difference quotient."""
    _, solution = settling.solution_of(8)
    frame, state, step = solution.views.layout.frame, solution.state, 1e-7
    change = np.zeros((6, 6))
    for k in range(6):
        delta = step * np.eye(6)[k]
        turned = Pose.from_rotvec(delta[:3], np.zeros(3)).rotation @ state.rotation
        moved = frame.pose(turned, state.translation + delta[3:])
        change[:, k] = (moved @ solution.rig_from_model.inverse()).log() / step
    expected = change @ solution.unit_cov[:6, :6] @ change.T
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(solution.cov / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-5)
    assert solution.to_model()[3:, :3] == pytest.approx(frame.scale * hat(state.translation))


def test_labels_grow_from_a_few_and_shrink_from_wrong_ones():
    scene = settling.curved_scene(3, hidden=0.25, false=0.5)
    views = settling.views_of(scene)
    few = settling.settled(views, scene, settling.labels_of(scene, keep=lambda c, m: m % 4 == 0))
    assert_right(few, scene)
    wrong = settling.labels_of(scene)
    a, b = np.flatnonzero(wrong[0] >= 0)[[3, 4]]
    wrong[0, [a, b]] = wrong[0, [b, a]]
    assert_right(settling.settled(views, scene, wrong), scene)


def test_accepted_excess_is_by_the_residuals_alone():
    scene = scenes.scene(6, "B", noise_px=0.2)
    solution = settling.settled(settling.views_of(scene), scene)
    final = accepted(solution)
    assert final.excess_px[0] < solution.excess_px[0]
    assert (np.diag(final.cov) <= np.diag(solution.cov) * (1 + 1e-9)).all()
    np.testing.assert_array_equal(final.state.match, solution.state.match)


def test_freed_focal_length_is_the_true_one():
    rng = np.random.default_rng(8)
    markers = scenes.wing_and_body(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(50, 50), tilt_max_deg=30)
    scene = scenes.image_of(rng, markers, camera, pose, noise_px=0.2)
    true = camera.focal_px
    moved = Pose(pose.rotation, pose.translation + 0.15 * pose.apply(markers.xyz.mean(axis=0)))
    wrong = scenes.Scene(scene.detections, markers, with_focal(camera, 1.15 * true), moved, scene.label)
    held = settling.settled(settling.views_of(wrong), wrong)
    freed = with_freedom(settling.views_of(wrong, focal_factors=settling.FREE), held)
    sigma = 0.5 * np.log(settling.FREE[-1]) * np.sqrt(freed.unit_cov[6, 6])
    assert freed.camera().focal_px == pytest.approx(true, abs=4 * sigma * true)
    assert sigma < 0.02
    assert freed.evidence > held.evidence + 20


def test_a_start_with_its_own_focal_length_settles_to_the_same():
    scene = settling.curved_scene(21, hidden=0.2)
    views = settling.views_of(scene, focal_factors=settling.FREE)
    found = [settling.settled(views, scene, focal_px=f * scene.camera.focal_px) for f in (0.9, 1.0, 1.1)]
    for other in found[1:]:
        assert other.camera().focal_px == pytest.approx(found[0].camera().focal_px, rel=1e-4)
        np.testing.assert_array_equal(other.state.match, found[0].state.match)


def test_a_solution_off_the_prior_is_none():
    scene = settling.curved_scene(22)
    turned = Pose.from_rotvec([0, 0, np.radians(30)], np.zeros(3)) @ scene.cam_from_model
    for angle, kept in ((0.6, True), (0.4, False)):
        views = settling.views_of(scene, prior=turned, prior_max_angle_rad=angle, prior_max_scale=1.3)
        assert (settling.settled(views, scene) is not None) == kept


def test_hidden_markers_are_neither_matched_nor_expected():
    scene = scenes.scene(23, "B", noise_px=0.2)
    gone = np.arange(60) % 5 == 0
    asked = []

    def visible(pose, camera):
        asked.append(scenes.pose_error_px(pose, scene))
        return ~gone

    plain = settling.settled(settling.views_of(scene), scene)
    told = settling.settled(settling.views_of(scene, visible=visible), scene)
    assert plain.count == (scene.label >= 0).sum()
    assert not gone[told.pairs()[1]].any()
    assert told.count == plain.count - gone[plain.pairs()[1]].sum()
    assert plain.expected - told.expected == (gone & plain.state.must[0]).sum() > 0
    assert 0 < len(asked) <= 3
    assert max(asked) < 2.0  # it is asked of settled poses


def test_binding_labels_are_not_left_and_others_are():
    """A spot that is 20 px off its marker is dropped; where its label is a fact, it stays with all its weight."""
    scene = scenes.scene(24, "B", noise_px=0.2)
    spot = int(np.flatnonzero(scene.label >= 0)[4])
    marker, xy = int(scene.label[spot]), scene.detections.xy.copy()
    xy[spot] += [20.0, 0.0]
    off = scenes.Scene(
        settling.Detections.make(xy, sigma_px=0.2), scene.markers, scene.camera, scene.cam_from_model, scene.label
    )
    plain = settling.settled(settling.views_of(off, fixed=((spot, marker),)), off)
    bound = settling.settled(settling.views_of(off, fixed=((spot, marker),), binding=True), off)
    assert plain.state.match[0, marker] == -1
    assert bound.state.match[0, marker] == spot
    assert np.linalg.norm(bound.state.residual[0, marker]) > 5


def test_two_solutions_are_one_by_pairs_and_pose():
    scene = settling.curved_scene(25, hidden=0.1)
    views = settling.views_of(scene)
    best = settling.settled(views, scene)
    again = settling.settled(views, scene, settling.labels_of(scene, keep=lambda c, m: m % 3 == 0))
    assert best.same_as(again)
    assert best.shared(again) == 1.0
    other = replace(best, state=copied(views, best.state))
    other.state.match[:] = np.roll(best.state.match, 1, axis=1)
    assert not best.same_as(other)
    turned = replace(best, state=copied(views, best.state))
    for name in ("factor", "camera", "numbers"):
        getattr(turned.state, name)[:] = getattr(best.state, name)
    turned.state.rotation[:] = Pose.from_rotvec([0.0, 0.0, 0.2], np.zeros(3)).rotation @ best.state.rotation
    assert best.shared(turned) == 1.0
    assert not best.same_as(turned)


# --- rigs --------------------------------------------------------------------------------------------


def test_labels_of_one_camera_bring_those_of_the_others():
    rig = scenes.rig_scene(41, "B", 3, hidden=0.3, false=1.0)
    views = settling.views_of_rig(rig)
    whole = settling.settled(views, rig)
    joint = settling.settled(views, rig, settling.labels_of(*rig.views, keep=lambda c, m: c == 1))
    np.testing.assert_array_equal(joint.state.match, whole.state.match)
    assert joint.scores.sum() == pytest.approx(joint.score)
    for c, view in enumerate(rig.views):
        spot, marker = joint.pairs(c)
        assert (view.label[spot] == marker).mean() > 0.9
        expected = rig.cam_from_rig[c] @ joint.rig_from_model
        np.testing.assert_allclose(joint.cam_from_model(c).translation, expected.translation, atol=1e-9)
    first = rig.views[0].label[rig.views[0].label >= 0][:3].tolist()
    assert settling.settled(views, rig, settling.labels_of(*rig.views, keep=lambda c, m: c == 0 and m in first)) is None


def test_one_free_focal_length_of_a_rig():
    """Of a camera whose focal length is off by 12 %: found beside a camera whose own is given."""
    rig = scenes.rig_scene(42, "B", 2, noise_px=0.2)
    wrong = replace(rig.views[1], camera=replace(rig.views[1].camera, focal_px=1.12 * rig.views[1].camera.focal_px))
    off = scenes.RigScene((rig.views[0], wrong), rig.cam_from_rig, rig.rig_from_model)
    true = rig.views[1].camera.focal_px
    views = settling.views_of_rig(off, each=({}, {"focal_factors": settling.FREE}))
    found = settling.settled(views, off, focal_px=np.array([rig.views[0].camera.focal_px, true * 1.05]))
    assert_right(found, *rig.views)
    assert found.camera(0) is rig.views[0].camera
    sigma = 0.5 * np.log(settling.FREE[-1]) * np.sqrt(found.unit_cov[7, 7])
    assert found.camera(1).focal_px == pytest.approx(true, abs=4 * sigma * true)
    assert sigma < 0.01
    held = settling.settled(settling.views_of_rig(off), off)
    assert held is None or held.count < found.count or held.misfit_px[1] > 3 * found.misfit_px[1]


def test_fixed_labels_and_hiding_are_of_each_camera():
    rig = scenes.rig_scene(43, "B", 2, hidden=0.1)
    spot = int(np.flatnonzero(rig.views[1].label >= 0)[0])
    marker = int(rig.views[1].label[spot])
    xy = rig.views[1].detections.xy.copy()
    xy[spot] += [15.0, 0.0]
    moved = replace(rig.views[1], detections=settling.Detections.make(xy, cov=rig.views[1].detections.cov))
    gone = np.arange(60) % 7 == 0
    each = ({"visible": lambda pose, camera: ~gone}, {"fixed": ((spot, marker),), "binding": True})
    off = scenes.RigScene((rig.views[0], moved), rig.cam_from_rig, rig.rig_from_model)
    found = settling.settled(settling.views_of_rig(off, each=each), off)
    assert found.state.match[1, marker] == spot
    assert not gone[found.pairs(0)[1]].any()
    assert gone[found.pairs(1)[1]].any()


# --- bent models -------------------------------------------------------------------------------------


def test_a_bent_model_is_labelled_from_its_rigid_core():
    scene, xyz = bent_scenes.scene(7110, "B", bent_scenes.Bend(0.02), hidden=0.25, false=0.25)
    views = settling.views_of(scene)
    body = settling.labels_of(scene, keep=lambda c, m: m >= 30)
    rigid = settling.settled(views, scene, body)
    bent = settling.settled(settling.bent_views(views), scene, body)
    assert rigid is None or rigid.count < bent.count
    assert_right(bent, scene)
    frame = views.layout.frame
    found = bent.cam_from_model().apply(scene.markers.xyz + frame.scale * bent.displacement)
    seen = scene.camera.project(found)[0] - scene.camera.project(scene.cam_from_model.apply(xyz))[0]
    assert np.linalg.norm(seen[bent.pairs()[1]], axis=1).max() < 1.5


def test_a_bent_model_seen_by_a_rig_is_known_along_the_sight_too():
    """What one camera does not see of a displacement the other one does."""
    bend, rng = bent_scenes.Bend(0.02), np.random.default_rng(44)
    rig = scenes.rig_scene(44, "B", 2, apart_deg=(40, 60), noise_px=0.1)
    markers = rig.views[0].markers
    xyz = bent_scenes.bent_xyz(markers, "B", bend)
    moved = replace(markers, xyz=xyz)
    views = [scenes.image_of(rng, moved, v.camera, v.cam_from_model, noise_px=0.1) for v in rig.views]
    shown = scenes.RigScene(tuple(replace(v, markers=markers) for v in views), rig.cam_from_rig, rig.rig_from_model)
    both = settling.settled(settling.bent_views(settling.views_of_rig(shown)), shown)
    assert_right(both, *shown.views)
    frame = settling.views_of_rig(shown).layout.frame
    seen = (both.state.match >= 0).any(axis=0)
    error = both.rig_from_model.apply(markers.xyz + frame.scale * both.displacement) - rig.rig_from_model.apply(xyz)
    one = shown.views[0]
    alone = settling.settled(settling.bent_views(settling.views_of(one)), one)
    single = alone.cam_from_model().apply(markers.xyz + frame.scale * alone.displacement) - one.cam_from_model.apply(
        xyz
    )
    assert np.abs(error[seen]).max() < 0.004
    assert np.abs(single[seen]).max() > 1.5 * np.abs(error[seen]).max()


def test_displacement_is_what_the_modes_make():
    scene, _ = bent_scenes.scene(7111, "A", bent_scenes.Bend(0.02))
    views = settling.bent_views(settling.views_of(scene))
    solution = settling.settled(views, scene)
    assert solution.is_bent
    assert not settling.settled(settling.views_of(scene), scene).is_bent
    expected = sum(q * mode for q, mode in zip(solution.state.bent, views.modes, strict=True))
    np.testing.assert_allclose(solution.displacement, expected, atol=1e-12)
