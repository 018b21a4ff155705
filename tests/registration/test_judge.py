"""The judge's questions one by one: one pair that holds the pose, the mirror image, other cameras, a bent model."""

from dataclasses import replace

import bent_scenes
import numpy as np
import pytest
import registration_scenes as scenes
import settle_scenes as settling
import settle_twins as twins

from windmark.geometry import Camera, Pose
from windmark.registration import CAUSES, Unchecked, register
from windmark.registration.judge import own, rules
from windmark.registration.judge.answer import answer
from windmark.registration.judge.bending import Bender
from windmark.registration.judge.cameras import contradiction
from windmark.registration.judge.doubts import PARTS, Doubts, FirstOrder
from windmark.registration.judge.mirror import FLIP, mirror_of
from windmark.registration.judge.source import distinct
from windmark.registration.judge.symmetric import told_by_table_errors
from windmark.registration.search.pool import Candidate
from windmark.registration.settle import views as v
from windmark.registration.settle._kernels.fit import refine
from windmark.registration.settle.solution import copied
from windmark.registration.task import Limits
from windmark.scene import MarkerSet

LIMITS = Limits(-9.0, 60.0, 10.0, 0.05, 0.025, 0.05)
MARGIN = LIMITS.margin


def best_of(scene, **more):
    views = settling.views_of(scene, **more)
    return views, settling.settled(views, scene)


# --- one pair --------------------------------------------------------------------------------------


def boom(off_line):
    """Ten markers along a boom, nearly on a line, and so many of two others beside it; all seen."""
    rng = np.random.default_rng(3)
    xyz = np.column_stack([np.linspace(-1, 1, 10), *rng.normal(0, 0.004, (2, 10))])
    xyz = np.concatenate([xyz, [[-0.5, 0.6, 0.1], [0.6, 0.5, -0.1]]])
    markers = MarkerSet.make([f"m{i:02d}" for i in range(12)], xyz)
    camera, pose = Camera((1280, 1000), 1600.0), Pose.look_at([0.3, -0.5, 3.0], [0, 0, 0], [0.2, 1, 0])
    scene = scenes.image_of(
        np.random.default_rng(4), replace(markers, normal=np.tile([0.0, 0, 1], (12, 1))), camera, pose
    )
    kept = scene.label < 10 + off_line
    return scenes.Scene(scene.detections.take(kept), markers, camera, pose, scene.label[kept])


def test_the_pair_that_holds_the_pose_alone_is_named():
    """Beside a line a single marker tells how the model is turned about it; how far off it could be is told."""
    scene = boom(1)
    scene = replace(scene, markers=scene.markers.take(np.arange(11)))
    views, best = best_of(scene)
    words = own.held_by_one(best)
    assert "marker m10" in words
    alone = copied(views, best.state)
    alone.match[0, 10] = -1
    assert refine(views.sights, alone, np.zeros((1, 11, 3)))
    by = twins.by_unknowns(views, alone)[0, 10]
    cov = by @ np.linalg.inv(alone.factor @ alone.factor.T) @ by.T
    wide = float(words.split("leave open by ")[1].split(" px")[0])
    assert wide == pytest.approx(np.sqrt(np.linalg.eigvalsh(cov)[-1]), rel=0.2)
    assert wide > rules.HELD * 6.0


def test_two_pairs_beside_the_line_check_each_other():
    assert own.held_by_one(best_of(boom(2))[1]) == ""


def test_matched_markers_on_a_line_leave_the_others_open():
    words = own.held_by_one(best_of(boom(0))[1])
    assert "leave the place of others open" in words
    assert "of m10" in words or "of m11" in words


def test_spread_markers_hold_their_pose_together():
    for seed in range(5):
        assert own.held_by_one(best_of(scenes.scene(seed, "AB"[seed % 2], hidden=0.4))[1]) == ""


def test_a_pose_on_one_pair_is_refused_by_register():
    scene = boom(1)
    markers = scene.markers.take(np.arange(11))
    found = register(scene.detections, markers, scene.camera, prior=scene.cam_from_model, max_time_s=2.0)
    assert not found
    assert found.cause == "one_pair", found.reason
    assert "m10" in found.reason
    assert CAUSES["one_pair"]


# --- mirror image ----------------------------------------------------------------------------------


def with_relief(seed, relief=1.0):
    """A wing whose relief (3 % of its span) is other in its table; the picture is of the true one."""
    scene = scenes.scene(seed, "A", noise_px=0.1)
    scale = np.array([1.0, 1.0, relief])
    markers = replace(scene.markers, xyz=scene.markers.xyz * scale)
    return scenes.Scene(scene.detections, markers, scene.camera, scene.cam_from_model, scene.label)


@pytest.mark.parametrize("seed", [61, 62, 63])
def test_a_relief_with_the_wrong_sign_is_the_mirror_image(seed):
    """The mirrored table explains the picture better than the wrong one, and worse than the right one."""
    right, wrong = with_relief(seed), with_relief(seed, -1.0)
    views, best = best_of(right)
    mirror = mirror_of(views, best, 8)
    assert mirror is None or best.lead_over(mirror) > MARGIN
    views, best = best_of(wrong)
    mirror = mirror_of(views, best, 8)
    assert mirror.count == (wrong.label >= 0).sum()
    assert mirror.lead_over(best) > MARGIN
    assert mirror.misfit_px[0] < 0.2 < best.misfit_px[0]
    np.testing.assert_allclose(mirror.views.sights.xyz, views.sights.xyz @ FLIP)
    assert np.linalg.det(mirror.state.rotation) == pytest.approx(1.0)


def test_register_says_that_the_table_is_mirrored():
    wrong = with_relief(64, -1.0)
    found = register(wrong.detections, wrong.markers, wrong.camera, max_time_s=2.0)
    assert not found
    assert found.cause == "mirrored", found.reason
    assert "mirror image" in found.reason
    right = with_relief(64)
    found = register(right.detections, right.markers, right.camera, max_time_s=2.0)
    assert found
    assert "mirror" not in [u.what for u in found.unchecked]


def test_a_flat_plate_cannot_tell_its_mirror_image():
    """Half a relief of nothing: both explain it alike, and the answer says so."""
    flat = with_relief(65, 0.0)
    xy = scenes.visible(flat.markers, flat.camera, flat.cam_from_model)[0]
    flat = replace(flat, detections=settling.Detections.make(xy, sigma_px=0.1), label=np.arange(24))
    found = register(flat.detections, flat.markers, flat.camera, max_time_s=2.0)
    assert found, found.reason
    assert "mirror" in [u.what for u in found.unchecked]


# --- other cameras ---------------------------------------------------------------------------------


def wide_scene(seed, given=None, noise_px=0.1):
    """A model with depth that fills a wide picture, all of it seen; ``given`` changes the camera that is believed."""
    rng = np.random.default_rng(seed)
    markers = scenes.wing_and_body(rng)
    markers = replace(markers, normal=np.full_like(markers.xyz, np.nan))
    camera = Camera((1280, 1000), 900.0)
    middle = markers.xyz.mean(axis=0)
    pose = Pose.look_at(middle + 1.9 * np.array([0.5, -0.2, 0.8]), middle, rng.normal(size=3))
    scene = scenes.image_of(
        rng, replace(markers, normal=-pose.rotation[2] + 0 * markers.xyz), camera, pose, noise_px=noise_px
    )
    return scenes.Scene(scene.detections, markers, given or camera, pose, scene.label)


WRONG = {
    "focal length": Camera((1280, 1000), 990.0),
    "aspect": Camera((1280, 1000), 900.0, aspect=1.03),
    "principal point": Camera((1280, 1000), 900.0, cx=719.5, cy=449.5),
    "lens": Camera((1280, 1000), 900.0, k1=-0.08),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_with_a_camera_is_named(what):
    """Focal length by 10 %, aspect by 3 %, principal point by 94 px, a lens that shifts the corner by 6 %."""
    scene = wide_scene(66, WRONG[what])
    views, best = best_of(scene)
    doubts = Doubts(views, best, views.layout.modes[:0], MARGIN)
    assert doubts.camera_promises
    named, words = doubts.other_camera(best)
    assert named == what
    assert "the misfit falls from" in words
    found = register(scene.detections, scene.markers, scene.camera, max_time_s=2.0)
    assert not found
    assert found.cause == ("wrong_focal" if what == "focal length" else "wrong_camera"), found.reason
    assert found.cause in CAUSES


def test_the_right_camera_is_not_doubted():
    for seed in range(67, 72):
        scene = wide_scene(seed)
        views, best = best_of(scene)
        doubts = Doubts(views, best, views.layout.modes[:0], MARGIN)
        assert not doubts.camera_promises or doubts.other_camera(best) is None


def test_gain_to_first_order_is_that_of_least_squares():
    """With unknowns beside those that are asked about, six without a prior and the others with one."""
    rng = np.random.default_rng(5)
    by, seen = rng.normal(size=(60, 11)), rng.normal(size=60) * 3
    first = FirstOrder(by.T @ by, by.T @ seen, np.array([8, 9, 10]))
    prior = np.diag((np.arange(11) >= 6).astype(float))

    def evidence(columns):
        normal = (by.T @ by + prior)[np.ix_(columns, columns)]
        side = (by.T @ seen)[columns]
        return 0.5 * side @ np.linalg.solve(normal, side) - 0.5 * np.linalg.slogdet(normal)[1]

    for part in ([0], [1, 2], [0, 1, 2]):
        gain = evidence([*range(8), *np.array([8, 9, 10])[part]]) - evidence(list(range(8)))
        assert first.gain(np.array(part)) == pytest.approx(gain)


def test_an_error_of_the_size_that_shows_leads_by_the_margin():
    """One unknown, no noise: moved by what `shown` says it gains the margin exactly."""
    rng = np.random.default_rng(6)
    by = rng.normal(size=(40, 7))
    for margin in (3.0, 10.0):
        size = FirstOrder(by.T @ by, np.zeros(7), np.array([6])).shown(0, margin)
        first = FirstOrder(by.T @ by, by.T @ (by[:, 6] * size), np.array([6]))
        information = 1 + first._reduced[0][0, 0]
        # What is shown is seen less the prior's pull.
        assert first.gain(np.array([0])) == pytest.approx(margin * (information - 1) ** 2 / information**2, rel=0.2)


@pytest.mark.parametrize("what", ["principal point", "lens", "aspect"])
def test_what_is_unchecked_goes_unnoticed_and_more_does_not(what):
    """Off by 0.4 of what is said a camera gives no reason to doubt it; by 2.5 times that it is named."""
    plain = wide_scene(73, noise_px=0.3)
    views, best = best_of(plain)
    doubts = Doubts(views, best, views.layout.modes[:0], MARGIN)
    k = PARTS[what][0]
    size = doubts._cameras.shown(k, MARGIN)
    column = v.doubted_camera(plain.camera)[:11, k]
    for factor, noticed in ((0.4, False), (2.5, True)):
        given = Camera(plain.camera.size_px, *(plain.camera.packed()[:11] + factor * size * column))
        views, best = best_of(replace(plain, camera=given))
        other = Doubts(views, best, views.layout.modes[:0], MARGIN)
        found = other.other_camera(best) if other.camera_promises else None
        assert (found is not None) == noticed


def test_unchecked_is_what_the_picture_would_not_show():
    """A flat wing far away says little of the camera; a wide picture with depth says all but the scale."""
    far = scenes.scene(74, "A", noise_px=0.3)
    found = register(far.detections, far.markers, far.camera, max_time_s=2.0)
    whats = [u.what for u in found.unchecked]
    assert {"focal length", "principal point", "scale"} <= set(whats)
    assert all(isinstance(u, Unchecked) and u.camera == 0 and u.words for u in found.unchecked)
    near = wide_scene(75, noise_px=0.02)
    told = register(near.detections, near.markers, near.camera, max_time_s=2.0)
    assert told, told.reason
    assert [u.what for u in told.unchecked] == ["scale"]
    free = register(far.detections, far.markers, far.camera, free_focal=True, max_focal_sigma=1.0, max_time_s=2.0)
    assert not free or "focal length" not in [u.what for u in free.unchecked]


# --- bent models -----------------------------------------------------------------------------------


def test_a_bender_grows_the_core_of_a_candidate():
    scene, _ = bent_scenes.scene(7110, "B", bent_scenes.Bend(0.02), hidden=0.25, false=0.25)
    views = settling.views_of(scene)
    core = settling.labels_of(scene, keep=lambda c, m: m >= 30)[0]
    candidate = Candidate(scene.cam_from_model, scene.camera.focal_px, 50.0, int((core >= 0).sum()), core)
    bender = Bender(views, 0.05)
    (bent,) = bender.solutions([(0, candidate)])
    assert (scene.label[bent.pairs()[0]] == bent.pairs()[1]).all()
    assert bent.count == (scene.label >= 0).sum()
    size = views.layout.size
    largest = np.linalg.norm(bent.displacement[bent.pairs()[1]], axis=1).max() / size
    assert bender.largest(bent) == pytest.approx(largest)
    assert bender.allows(bent)
    assert not Bender(views, 0.9 * largest).allows(bent)
    assert bender.solutions([(0, candidate)])[0] is bent  # what was grown is kept
    assert Bender(views, 0.0).solutions([(0, candidate)]) == []


def test_bending_is_tried_where_the_residuals_or_free_spots_speak_for_it():
    bent, _ = bent_scenes.scene(7140, "B", bent_scenes.Bend(0.02))
    straight = scenes.scene(7112, "A", noise_px=0.2)
    for scene, promising in ((bent, True), (straight, False)):
        views, best = best_of(scene)
        doubts = Doubts(views, best, Bender(views, 0.05).modes, MARGIN)
        assert doubts.bending_promises == promising
    assert not Doubts(*best_of(bent), views.layout.modes[:0], MARGIN).bending_promises


# --- beside each other -----------------------------------------------------------------------------


def grid(error, seed):
    """An 8 x 8 grid, and half a turn of it: a table that is off by so much, two labellings of an exact picture."""
    xyz = np.array([(i, j, 0.0) for i in range(8) for j in range(8)])
    rough = xyz + np.random.default_rng(seed).normal(0, error, xyz.shape)
    markers = MarkerSet.make([f"g{i}" for i in range(64)], rough, normal=np.tile([0.0, 0.0, 1.0], (64, 1)))
    exact = replace(markers, xyz=xyz)
    rng = np.random.default_rng(seed)
    camera, pose = scenes.random_view(rng, exact, tilt_max_deg=30, fov_deg=(30, 40))
    return markers, scenes.image_of(rng, exact, camera, pose, noise_px=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_errors_of_a_table_are_told_from_irregularities_that_are_there(seed):
    rough, scene = grid(0.02, seed)
    there = scenes.image_of(np.random.default_rng(seed), rough, scene.camera, scene.cam_from_model, noise_px=0.1)
    half = np.arange(63, -1, -1)
    turned = Pose(np.diag([-1.0, -1.0, 1.0]), [7.0, 7.0, 0.0])
    found = {}
    for name, shown in (("errors", replace(scene, markers=rough)), ("there", there)):
        views, one = best_of(shown)
        match = settling.labels_of(shown)[:, half]
        two = settling.settle(views, *views.layout.frame.unit(shown.cam_from_model @ turned), match)
        one, two = sorted((one, two), key=lambda s: -s.evidence)
        assert one.shared(two) < 0.1
        found[name] = told_by_table_errors(one, two, MARGIN)
    assert found == {"errors": True, "there": False}


def test_distinct_solutions_are_the_best_of_their_like():
    scene = settling.curved_scene(76, hidden=0.1)
    views = settling.views_of(scene)
    every = settling.settled(views, scene)
    some = settling.settled(views, scene, settling.labels_of(scene, keep=lambda c, m: m % 3 == 0))
    assert distinct([some, every, some]) == [max(some, every, key=lambda s: s.evidence)]


def test_a_loose_solution_needs_more_evidence():
    scene = scenes.scene(77, "B", noise_px=0.2, hidden=0.3)
    _, tight = best_of(scene)
    assert not own.is_loose(tight, 0)
    assert own.least_score(tight, LIMITS) == LIMITS.score
    told = replace(scene, detections=settling.Detections.make(scene.detections.xy, sigma_px=0.03))
    _, loose = best_of(told)
    assert own.is_loose(loose, 0)
    missing = loose.expected - loose.count
    assert own.least_score(loose, LIMITS) >= LIMITS.score + rules.MISSED * min(missing, 1)
    spot, marker = (int(a[0]) for a in tight.pairs())
    _, labelled = best_of(scene, fixed=((spot, marker),))
    assert own.least_score(labelled, LIMITS) == pytest.approx(LIMITS.score - np.log(60))


def test_a_camera_of_a_rig_that_shows_something_else_contradicts():
    rig = scenes.rig_scene(78, "B", 2, noise_px=0.2)
    views = settling.views_of_rig(rig)
    joint = settling.settled(views, rig)
    assert contradiction(joint, [], 0) == contradiction(joint, [], 1) == ""
    rng = np.random.default_rng(0)
    clutter = settling.Detections.make(rng.uniform(0, 1, (40, 2)) * rig.views[1].camera.size_px, sigma_px=0.2)
    blind = replace(rig.views[1], detections=clutter, label=np.full(40, -1))
    off = scenes.RigScene((rig.views[0], blind), rig.cam_from_rig, rig.rig_from_model)
    best = settling.settled(settling.views_of_rig(off), off)
    words = contradiction(best, [], 1)
    assert "among its 40 spots" in words
    assert "cam_from_rig" in words
    assert contradiction(best, [], 0) == ""


# --- the answer ------------------------------------------------------------------------------------


def test_the_answer_has_the_centres_of_discs():
    """The projections are moved by the eccentricity of the ellipses, so that the residuals are free of it."""
    scene = wide_scene(79, noise_px=0.0)
    axes = scene.cam_from_model.rotation
    normal = np.tile((axes[0] - axes[2]) / np.sqrt(2), (60, 1))
    discs = replace(scene.markers, radius=np.full(60, 0.04), normal=normal)
    _, best = best_of(replace(scene, markers=discs))
    final, cov = answer(best)
    held = final.state.match[0] >= 0
    assert (np.linalg.norm(final.state.offset[0, held], axis=1) > 0.005).any()
    assert (final.state.offset[0, ~held] == 0).all()
    assert cov.shape == final.unit_cov.shape
    plain, _ = answer(best_of(scene)[1])
    assert (plain.state.offset == 0).all()
