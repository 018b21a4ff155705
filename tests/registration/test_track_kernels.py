"""The kernels of tracking against slow, readable twins."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes
import settle_twins as twins
from scipy.linalg import block_diag
from scipy.special import logsumexp

from windmark.geometry import Pose
from windmark.registration import prepare
from windmark.registration.judge.one_pair import held_by_one
from windmark.registration.options import default_tolerance
from windmark.registration.search.plane import Plane
from windmark.registration.settle._kernels.state import EXCESS, HELD_PX, REST_PX, blank_kernel
from windmark.registration.settle.settling import copied, settle
from windmark.registration.settle.views import Views
from windmark.registration.task import Task
from windmark.registration.track._kernels import checks, gates, motion, spots, suppose
from windmark.registration.track.prepared import Prepared
from windmark.scene import MarkerSet


def sights_of(scene, prepared):
    """What the kernels make of a picture."""
    model, found = prepared.layout.model, scene.detections
    return spots.sights_of(
        model.xyz, model.normal, model.near, prepared.sigma, prepared.packed, prepared.loose, prepared.size, found.xy,
        found.cov, found.radius_px, 0.0, prepared.rough, 0.0,
    )  # fmt: skip


def views_of(scene, prepared, tolerance):
    """The same as a search would have it."""
    found = scene.detections
    task = Task(scene.markers, scene.camera, found.xy, found.cov, tolerance, radius_px=found.radius_px)
    return Views.of([Plane(task, prepared.layout)])


@pytest.fixture(scope="module")
def view():
    scene = scenes.scene(21, "B", hidden=0.2, false=0.5)
    prepared = Prepared.of(scene.markers, scene.camera, prepare(scene.markers))
    return scene, prepared, sights_of(scene, prepared)


@pytest.mark.slow
def test_the_picture_is_that_of_a_search(view):
    scene, prepared, sights = view
    for name, expected in views_of(scene, prepared, sights.tolerance[0]).sights._asdict().items():
        np.testing.assert_allclose(getattr(sights, name), expected, rtol=1e-9, err_msg=name)


def test_prediction_is_that_of_the_matrices():
    rng = np.random.default_rng(2)
    root = rng.normal(0, 0.01, (12, 12))
    pose = Pose.from_rotvec([0.3, -0.2, 0.9], [0.1, 0.2, 8.0])
    before = motion.Estimate(pose.rotation, pose.translation, rng.normal(0, 0.01, 6), root @ root.T)
    change, f, q = np.array([0.004, 0.002]), np.eye(12), np.zeros((12, 12))
    f[:6, 6:] = np.eye(6)
    got = motion.predict_kernel(before, change, 3.0)
    # Three single frames, one after the other.
    cov = before.cov
    step = np.repeat([change[0] ** 2, change[1] ** 2 * float(got.translation @ got.translation)], 3)
    q[:6, :6] = q[:6, 6:] = q[6:, :6] = q[6:, 6:] = np.diag(step)
    for _ in range(3):
        cov = f @ cov @ f.T + q
    np.testing.assert_allclose(got.cov, cov, rtol=1e-9, atol=1e-15)
    turned = Pose.from_rotvec(3 * before.velocity[:3], np.zeros(3)).rotation @ pose.rotation
    np.testing.assert_allclose(got.rotation, turned, atol=1e-12)
    np.testing.assert_allclose(got.translation, pose.translation + 3 * before.velocity[3:])


def test_update_is_that_of_kalman():
    rng = np.random.default_rng(3)
    root, noise = rng.normal(0, 0.02, (12, 12)), rng.normal(0, 0.01, (6, 6))
    cov, measured, innovation = root @ root.T, noise @ noise.T, rng.normal(0, 0.01, 6)
    before = motion.Estimate(np.eye(3), np.array([0.0, 0.0, 5.0]), np.zeros(6), cov)
    got = motion.update_kernel(before, innovation, measured)
    h = np.eye(6, 12)
    gain = cov @ h.T @ np.linalg.inv(h @ cov @ h.T + measured)
    np.testing.assert_allclose(got.cov, cov - gain @ h @ cov, atol=1e-12)
    np.testing.assert_allclose(got.velocity, gain[6:] @ innovation, atol=1e-12)
    np.testing.assert_allclose(got.translation - before.translation, gain[3:6] @ innovation, atol=1e-12)
    distance2 = motion.distance2_of(innovation, cov, measured)
    assert distance2 == pytest.approx(innovation @ np.linalg.solve(cov[:6, :6] + measured, innovation))


@pytest.mark.parametrize("turn", [[0.0, 0.0, 0.0], [1e-9, 0.0, 0.0], [0.3, -1.2, 0.4], [3.1, 0.0, 0.1]])
def test_difference_leads_from_one_pose_to_the_other(turn):
    start, out = Pose.from_rotvec([0.5, 0.1, -0.7], [1.0, 2.0, 3.0]), np.empty(6)
    end = Pose.from_rotvec(turn, np.zeros(3)).rotation @ start.rotation
    motion.difference(end, start.translation + 0.5, start.rotation, start.translation, out)
    np.testing.assert_allclose(out, [*turn, 0.5, 0.5, 0.5], atol=1e-7)


def placed(sights, rotation, translation):
    """An empty state at a pose."""
    state = blank_kernel(sights)
    state.rotation[:], state.translation[:] = rotation, translation
    return state


@pytest.mark.slow
def test_labels_in_gates_are_those_of_the_slow_twin(view):
    scene, prepared, sights = view
    cov, floor2 = np.diag([1e-6] * 3 + [4e-5] * 3), (0.25 * sights.tolerance[0]) ** 2
    state = placed(sights, *prepared.layout.frame.unit(scene.cam_from_model))
    sight = gates.sight_from(sights, state, cov)
    match = np.empty(len(scene.markers), np.int32)
    count = gates.label_in_gates(sights, sight, floor2, match)
    pairs = []
    for m in np.flatnonzero(sight.seen):
        by_pose = sight.by_pose[m, :, :6]
        spread = by_pose @ cov @ by_pose.T + floor2 * np.eye(2)
        for s, (xy, noise) in enumerate(zip(scene.detections.xy, scene.detections.cov, strict=True)):
            offset = xy - sight.xy[m]
            d2 = offset @ np.linalg.solve(spread + noise, offset)
            near = np.linalg.norm(offset) < gates.SHARE * sight.spacing[m]
            if d2 < gates.GATE and near and abs(offset[0]) <= np.sqrt(gates.GATE * spread[0, 0]):
                pairs.append((d2, m, s))
    twin = np.full(len(match), -1)
    for _, m, s in sorted(pairs):
        if twin[m] < 0 and s not in twin:
            twin[m] = s
    np.testing.assert_array_equal(match, twin)
    assert count == (twin >= 0).sum() > 10


@pytest.mark.slow
def test_a_supposed_pair_brings_back_a_common_shift(view):
    """A prediction that is off by more than the markers' spacing."""
    scene, prepared, sights = view
    r, t = prepared.layout.frame.unit(scene.cam_from_model)
    true = gates.sight_from(sights, placed(sights, r, t), np.eye(6))
    shift = 40.0 * t[2] / scene.camera.focal_px
    cov = np.diag([1e-6] * 3 + [shift**2, shift**2, 1e-6])
    state = placed(sights, r, t + np.array([shift, -0.5 * shift, 0.0]))
    sight = gates.sight_from(sights, state, cov)
    worth = suppose.supposed(sights, sight, state, cov, (0.25 * sights.tolerance[0]) ** 2)
    found = gates.sight_from(sights, state, cov)
    assert worth > 50
    assert np.abs(found.xy - true.xy)[true.seen].max() < 4


def settled(scene, prepared, sights, kept):
    """The solution from the true labels of some markers."""
    match = np.full((1, len(scene.markers)), -1, np.int32)
    match[0, scene.label[scene.label >= 0]] = np.flatnonzero(scene.label >= 0)
    match[:, ~kept] = -1
    views = views_of(scene, prepared, sights.tolerance[0])
    state = placed(sights, *prepared.layout.frame.unit(scene.cam_from_model))
    solution = settle(views, state.rotation, state.translation, match)
    assert solution is not None
    return solution


def test_what_pairs_leave_open_is_what_the_judge_says():
    """Two rows of which one is hidden but for one spot: that spot holds the pose."""
    rng = np.random.default_rng(5)
    xyz = np.array([[0.1 * k, 0.5 * row, 0.0] for row in range(2) for k in range(8)]) + rng.normal(0, 0.004, (16, 3))
    markers = MarkerSet.make([f"m{k}" for k in range(16)], xyz)
    camera, pose = scenes.random_view(rng, markers)
    scene = scenes.image_of(rng, markers, camera, pose, noise_px=0.1)
    prepared = Prepared.of(markers, camera, prepare(markers))
    for row in (8, 1):  # how many of the second row are seen
        kept = np.isin(scene.label, np.arange(8 + row))
        part = scenes.Scene(scene.detections.take(kept), markers, camera, pose, scene.label[kept])
        sights = sights_of(part, prepared)
        best = settled(part, prepared, sights, np.arange(16) < 8 + row)
        bare, held = best.state.open[0, [REST_PX, HELD_PX]]
        tolerance = sights.tolerance[0]
        words = held_by_one(best)
        assert bool(words) == (held > tolerance / 3 or bare > tolerance) == (row == 1)
        if bare > tolerance:
            assert f"{bare:.2g} px" in words
        elif row == 1:
            assert f"{held:.2g} px" in words


@pytest.mark.slow
@pytest.mark.parametrize("excess", [0.0, 0.02])
def test_the_gain_of_bending_is_that_of_dense_matrices(view, excess):
    """Likelihoods of the residuals, the pose without a prior, with deformations of three sizes and without one."""
    scene, prepared, sights = view
    best = settled(scene, prepared, sights, np.arange(len(scene.markers)) >= 0)
    state, modes = best.state, prepared.modes[:20]
    matched = state.match[0] >= 0
    state.residual[0, :, 1] += 0.5 * np.sin(4 * prepared.layout.model.xyz[:, 0])
    state.numbers[0, EXCESS] = excess
    state.spread[0, matched] += excess * np.array([1.0, 0.0, 1.0])
    by = twins.by_unknowns(best.views.bent(modes), copied(best.views.bent(modes), state))[0, matched].reshape(-1, 26)
    seen = -state.residual[0, matched].ravel()
    cov = block_diag(*twins.square(state.spread[0, matched]))
    variance = 0.5 * (state.spread[0, matched, 0] + state.spread[0, matched, 2])
    least = float(np.mean(1 - excess / variance))

    def likelihood(noise, part):
        whole = noise * cov + part**2 * by[:, 6:] @ by[:, 6:].T
        inverse = np.linalg.inv(whole)
        pose = by[:, :6].T @ inverse @ by[:, :6]
        pull = by[:, :6].T @ inverse @ seen
        square = seen @ inverse @ seen - pull @ np.linalg.solve(pose, pull)
        return -0.5 * (square + np.linalg.slogdet(whole)[1] + np.linalg.slogdet(pose)[1])

    bent = [likelihood(noise, part) - np.log(3) for noise in (1.0, least) for part in checks.PARTS]
    rigid = [likelihood(noise, 0.0) for noise in (1.0, least)]
    expected = logsumexp(bent) - logsumexp(rigid)
    assert checks.bending_gain(sights, modes, state) == pytest.approx(expected, abs=0.2)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.06])
def test_the_usual_tolerance_is_that_of_register(view, share):
    """Wider for a rough table, never so wide that neighbouring spots are one."""
    scene = view[0]
    sigma = np.full((len(scene.markers), 3), share * np.ptp(scene.markers.xyz))
    markers = replace(scene.markers, sigma=sigma)
    prepared = Prepared.of(markers, scene.camera, prepare(markers))
    tolerance = sights_of(scene, prepared).tolerance[0]
    assert tolerance == pytest.approx(default_tolerance(scene.detections.xy, scene.camera, markers), rel=1e-9)
    assert (tolerance > view[2].tolerance[0]) == (share > 0)
