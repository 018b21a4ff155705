"""Other explanations of the residuals: another camera, a bent model; and what a picture cannot tell."""

import re
from dataclasses import replace

import bent_scenes
import numpy as np
import pytest
import registration_scenes as scenes
import settle_scenes as settling

from windmark.geometry import Camera
from windmark.registration import CAUSES, Unchecked, register
from windmark.registration.budget import Budget
from windmark.registration.judge.bending import Bender
from windmark.registration.judge.doubts import PARTS, Doubts, _off
from windmark.registration.judge.first_order import FirstOrder, shown
from windmark.registration.search.pool import Candidate
from windmark.registration.settle import views as v

MARGIN = 10.0


# --- other cameras ---------------------------------------------------------------------------------


WRONG = {
    "focal length": Camera((1280, 1000), 990.0),
    "aspect": Camera((1280, 1000), 900.0, aspect=1.03),
    "principal point": Camera((1280, 1000), 900.0, cx=719.5, cy=449.5),
    "lens": Camera((1280, 1000), 900.0, k1=-0.08),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_with_a_camera_is_named(what):
    """Focal length by 10 %, aspect by 3 %, principal point by 94 px, a lens that shifts the corner by 6 %."""
    scene = settling.wide_scene(66, WRONG[what])
    views, best = settling.best_of(scene)
    doubts = Doubts(views, best, 0.0, MARGIN)
    assert doubts.camera_promises
    named = doubts.other_camera(best.evidence)
    assert named.what == what
    assert "the misfit falls from" in named.words
    found = register(scene.detections, scene.markers, scene.camera, max_time_s=30.0)
    assert not found
    assert found.cause == ("wrong_focal" if what == "focal length" else "wrong_camera"), found.reason
    assert found.cause in CAUSES


@pytest.mark.parametrize(("lens", "k1"), [("brown", 0.0), ("brown", -0.1), ("rational", 0.0), ("fisheye", -0.02)])
def test_how_far_a_lens_is_off_is_seen_in_the_image(lens, k1):
    """The largest shift of a corner, whatever the coefficient means in the lens' model."""
    more = {"k4": 0.1} if lens == "rational" else {}
    given = Camera((1280, 1000), 900.0, cx=600.0, cy=520.0, k1=k1, lens=lens, **more)
    found = replace(given, k1=k1 + 0.01, focal_px=910.0)
    corners = np.array([[0.0, 0.0], [1279.0, 0.0], [0.0, 999.0], [1279.0, 999.0]])
    away = np.linalg.norm(corners - [600.0, 520.0], axis=1)
    there = replace(given, k1=k1 + 0.01).project(given.directions(corners))[0]
    expected = (np.linalg.norm(there - corners, axis=1) / away).max()
    assert _off("lens", given, found, 1624.0) == pytest.approx(expected, rel=1e-6)


def test_a_fisheye_that_ends_before_the_corner_is_compared_at_its_end():
    given = Camera((1280, 1000), 300.0, k1=-0.08, lens="fisheye")
    assert np.isnan(given.directions(np.zeros(2))).any()
    assert 0.0 < _off("lens", given, replace(given, k1=-0.079), 1624.0) < 0.1


def test_the_right_camera_is_not_doubted():
    for seed in range(67, 72):
        scene = settling.wide_scene(seed)
        views, best = settling.best_of(scene)
        doubts = Doubts(views, best, 0.0, MARGIN)
        assert not doubts.camera_promises or doubts.other_camera(best.evidence) is None


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
        assert first.gain(part[0], part[-1] + 1) == pytest.approx(gain)


def test_an_error_of_the_size_that_shows_leads_by_the_margin():
    """One unknown, no noise: moved by what `shown` says it gains the margin exactly."""
    rng = np.random.default_rng(6)
    by = rng.normal(size=(40, 7))
    for margin in (3.0, 10.0):
        size = FirstOrder(by.T @ by, np.zeros(7), np.array([6])).shown(0, margin)
        first = FirstOrder(by.T @ by, by.T @ (by[:, 6] * size), np.array([6]))
        information = 1 + first._reduced[0][0, 0]
        # What is shown is seen less the prior's pull.
        assert first.gain(0, 1) == pytest.approx(margin * (information - 1) ** 2 / information**2, rel=0.2)


@pytest.mark.parametrize(("what", "more"), [("principal point", 4.0), ("lens", 2.5), ("aspect", 2.5)])
def test_what_is_unchecked_goes_unnoticed_and_more_does_not(what, more):
    """Off by 0.4 of what is said a camera gives no reason to doubt it; by 2.5 times that it is named.

    Half of a principal point's error is a turn of the camera, which moves the pose by few sigmas only.
    """
    plain = settling.wide_scene(73, noise_px=0.3)
    views, best = settling.best_of(plain)
    doubts = Doubts(views, best, 0.0, MARGIN)
    k = PARTS[what][0]
    size = shown(doubts.look.told[0, k], MARGIN)
    column = v.doubted_camera(plain.camera)[:11, k]
    for factor, noticed in ((0.4, False), (more, True)):
        given = Camera(plain.camera.size_px, *(plain.camera.packed()[:11] + factor * size * column))
        views, best = settling.best_of(replace(plain, camera=given))
        other = Doubts(views, best, 0.0, MARGIN)
        found = other.other_camera(best.evidence) if other.camera_promises else None
        assert (found is not None) == noticed


def test_unchecked_is_what_the_picture_would_not_show():
    """A flat wing far away says little of the camera; a wide picture with depth says all but the scale."""
    far = scenes.scene(74, "A", noise_px=0.3)
    found = register(far.detections, far.markers, far.camera, max_time_s=30.0)
    whats = [u.what for u in found.unchecked]
    assert {"focal length", "principal point", "scale"} <= set(whats)
    assert all(isinstance(u, Unchecked) and u.camera == 0 and u.words for u in found.unchecked)
    near = settling.wide_scene(75, noise_px=0.02)
    told = register(near.detections, near.markers, near.camera, max_time_s=30.0)
    assert told, told.reason
    assert [u.what for u in told.unchecked] == ["camera", "scale"]
    assert "is taken as exact: its principal point off by 0.14 px" in told.unchecked[0].words
    known = np.diag([0.05, 1e-5, 0.05, 0.05, 1e-5] + [0.0] * 10) ** 2
    told = register(near.detections, near.markers, replace(near.camera, cov=known), max_time_s=30.0)
    assert [u.what for u in told.unchecked] == ["scale"]
    free = register(far.detections, far.markers, far.camera, free_focal=True, max_focal_sigma=1.0, max_time_s=30.0)
    assert not free or "focal length" not in [u.what for u in free.unchecked]


def test_what_an_exact_camera_would_do_is_what_it_does():
    """Principal points off all round: those that neither are farther off than calibrated ones nor cost three nats."""
    near = settling.wide_scene(75, noise_px=0.02)
    right = register(near.detections, near.markers, near.camera)
    words = next(u.words for u in right.unchecked if u.what == "camera")
    sigmas, most = float(re.findall(r"([0-9.]+) of its sigmas", words)[0]), 2e-4 * np.hypot(*near.camera.size_px)
    moved = []
    for angle in np.linspace(0, np.pi, 17)[:-1]:
        both = []
        for size in (0.05, -0.05):
            off = {"cx": near.camera.cx + size * np.cos(angle), "cy": near.camera.cy + size * np.sin(angle)}
            both.append(register(near.detections, near.markers, replace(near.camera, **off)))
        delta = (both[0].cam_from_model @ right.cam_from_model.inverse()).log()
        cost = np.mean([other.report.final_cost for other in both]) - right.report.final_cost
        moved.append(np.sqrt(delta @ np.linalg.solve(right.cov, delta) / (0.05**2 / most**2 + cost / 3)))
    assert max(moved) == pytest.approx(sigmas, rel=0.1)


# --- bent models -----------------------------------------------------------------------------------


def test_a_bender_grows_the_core_of_a_candidate():
    scene, _ = bent_scenes.scene(7110, "B", bent_scenes.Bend(0.02), hidden=0.25, false=0.25)
    views = settling.views_of(scene)
    core = settling.labels_of(scene, keep=lambda c, m: m >= 30)[0]
    candidate = Candidate(scene.cam_from_model, scene.camera.focal_px, 50.0, int((core >= 0).sum()), core)
    bender = Bender(views, 0.05, Budget())
    (bent,) = bender.solutions([(0, candidate)])
    assert (scene.label[bent.pairs()[0]] == bent.pairs()[1]).all()
    assert bent.count == (scene.label >= 0).sum()
    assert bender.allows(bent)
    assert not Bender(views, 0.9 * bent.largest, Budget()).allows(bent)
    assert bender.solutions([(0, candidate)])[0] is bent  # what was grown is kept
    assert Bender(views, 0.0, Budget()).solutions([(0, candidate)]) == []


def test_bending_is_tried_where_the_residuals_or_free_spots_speak_for_it():
    bent, _ = bent_scenes.scene(7140, "B", bent_scenes.Bend(0.02))
    straight = scenes.scene(7112, "A", noise_px=0.2)
    for scene, promising in ((bent, True), (straight, False)):
        views, best = settling.best_of(scene)
        doubts = Doubts(views, best, Bender(views, 0.05, Budget()).bend, MARGIN)
        assert doubts.bending_promises == promising
    assert not Doubts(*settling.best_of(bent), 0.0, MARGIN).bending_promises
