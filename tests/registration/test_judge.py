"""The judge's questions one by one: one pair that holds the pose, the mirror image, solutions beside each other."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
import registration_scenes as scenes
import settle_scenes as settling

from windmark.geometry import Pose
from windmark.registration import register, rules
from windmark.registration.budget import Budget
from windmark.registration.judge import own
from windmark.registration.judge.answer import answer
from windmark.registration.judge.cameras import blocked
from windmark.registration.judge.mirror import FAR, _unlike, mirror_of
from windmark.registration.judge.source import Source, distinct
from windmark.registration.judge.symmetric import told_by_bending, told_by_table_errors
from windmark.registration.search.layout import FLIP
from windmark.registration.search.pool import Candidate
from windmark.registration.settle._kernels.fit import refine
from windmark.registration.settle._kernels.mirror import mirrors_kernel, start, with_twins
from windmark.registration.settle._kernels.state import EXPECTED, state_of
from windmark.registration.task import Limits
from windmark.scene import MarkerSet

LIMITS = Limits(-9.0, 60.0, 10.0, 0.05, 0.025, 0.05)
MARGIN = LIMITS.margin


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
    views, best = settling.best_of(right)
    mirror = mirror_of(views, best, 8)
    assert mirror is None or best.lead_over(mirror) > MARGIN
    views, best = settling.best_of(wrong)
    mirror = mirror_of(views, best, 8)
    assert mirror.count == (wrong.label >= 0).sum()
    assert mirror.lead_over(best) > MARGIN
    assert mirror.misfit_px[0] < 0.2 < best.misfit_px[0]
    np.testing.assert_allclose(mirror.views.sights.xyz, views.sights.xyz @ FLIP)
    assert np.linalg.det(mirror.state.rotation) == pytest.approx(1.0)


@pytest.mark.slow
def test_mirror_images_are_given_up_where_adjusting_them_to_the_end_brings_them_no_nearer():
    near, far = 0, 0
    for seed in range(61, 67):
        for relief in (1.0, -1.0):
            views, best = settling.best_of(with_relief(seed, relief))
            onto, turn, shift = (part[:8] for part in views.layout.mirror_starts[:3])
            across = views.layout.mirror_starts[3]
            images = (np.tile(onto, (1 + across.any(), 1)), *with_twins(best.state, turn, shift, across))
            assert len(images[0]) == len(images[1]) == len(images[2])
            sights, reach = views.mirrored(FLIP).sights, FAR * np.maximum(best.misfit_px, 0.1)
            state = state_of(sights, best.state.rotation, best.state.translation, best.state.match)
            kept = mirrors_kernel(sights, best.state, onto, turn, shift, reach, across)[0]
            for b, image in enumerate(zip(*images, strict=True)):
                start(best.state, state, *image)
                adjusted = refine(sights, state, np.zeros((*state.match.shape, 3)))
                residual = np.linalg.norm(state.residual[state.match >= 0], axis=1)
                assert kept[b] == (adjusted and np.median(residual) <= reach[0])
                near, far = near + kept[b], far + (not kept[b])
    assert min(near, far) > 5


def test_mirror_images_that_come_to_rest_at_one_are_one():
    onto, places = np.array([[0, 1]] * 6, np.int32), np.array([[0.0, 0.0, 4.0]] * 6)
    turns, nuisances, bent = np.stack([np.eye(3)] * 6), np.zeros((6, 1, 2)), np.zeros((6, 3))
    turns[1] += 1e-9  # the same; another labelling; another place; other cameras; another deformation
    onto[2], places[3, 0], nuisances[4, 0, 1], bent[5, 1] = (1, 0), 1e-3, 0.5, 0.1
    assert _unlike(np.arange(6), onto, turns, places, nuisances, bent) == [0, 2, 3, 4, 5]
    assert _unlike(np.array([1, 4]), onto, turns, places, nuisances, bent) == [1, 4]


def test_register_says_that_the_table_is_mirrored():
    wrong = with_relief(64, -1.0)
    found = register(wrong.detections, wrong.markers, wrong.camera, max_time_s=30.0)
    assert not found
    assert found.cause == "mirrored", found.reason
    assert "mirror image" in found.reason
    right = with_relief(64)
    found = register(right.detections, right.markers, right.camera, max_time_s=30.0)
    assert found
    assert "mirror" not in [u.what for u in found.unchecked]


def test_a_flat_plate_cannot_tell_its_mirror_image():
    """Half a relief of nothing: both explain it alike, and the answer says so."""
    flat = with_relief(65, 0.0)
    xy = scenes.visible(flat.markers, flat.camera, flat.cam_from_model)[0]
    flat = replace(flat, detections=settling.Detections.make(xy, sigma_px=0.1), label=np.arange(24))
    found = register(flat.detections, flat.markers, flat.camera, max_time_s=30.0)
    assert found, found.reason
    assert "mirror" in [u.what for u in found.unchecked]


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
        views, one = settling.best_of(shown)
        match = settling.labels_of(shown)[:, half]
        two = settling.settle(views, *views.layout.frame.unit(shown.cam_from_model @ turned), match)
        one, two = sorted((one, two), key=lambda s: -s.evidence)
        assert one.shared(two) < 0.1
        found[name] = told_by_table_errors(one, two, MARGIN)
    assert found == {"errors": True, "there": False}


@dataclass(frozen=True)
class Plain:
    """What `told_by_bending` asks of a solution: its labels' name, pairs, and worth."""

    labels: str
    count: int
    worth: float = 0.0

    @property
    def evidence(self):
        return self.worth

    def shared(self, other):
        return float(self.labels == other.labels)

    def lead_over(self, other):
        return self.worth - other.worth


def test_bending_alone_does_not_decide_between_labellings():
    bent = Plain("shifted", 77)
    other, own = Plain("as it is", 80, 15.0), Plain("shifted", 80, 0.0)
    assert told_by_bending(bent, [other, own], MARGIN) is other
    assert told_by_bending(bent, [other, replace(own, worth=30.0)], MARGIN) is None  # the rigid model says so, too
    assert told_by_bending(bent, [replace(other, count=60), own], MARGIN) is None  # bending brings labels
    poor = replace(other, worth=-40.0)  # a grown part of the labelling is no measure of it
    assert told_by_bending(bent, [poor, own, replace(own, worth=-35.0)], MARGIN) is None
    assert told_by_bending(bent, [own], MARGIN) is None


def test_distinct_solutions_are_the_best_of_their_like():
    scene = settling.curved_scene(76, hidden=0.1)
    views = settling.views_of(scene)
    every = settling.settled(views, scene)
    some = settling.settled(views, scene, settling.labels_of(scene, keep=lambda c, m: m % 3 == 0))
    assert distinct([some, every, some]) == [max(some, every, key=lambda s: s.evidence)]


def test_a_loose_solution_needs_more_evidence():
    scene = scenes.scene(77, "B", noise_px=0.2, hidden=0.3)
    _, tight = settling.best_of(scene)
    assert not own.is_loose(tight, 0)
    assert own.least_score(tight, LIMITS) == LIMITS.score
    told = replace(scene, detections=settling.Detections.make(scene.detections.xy, sigma_px=0.03))
    _, loose = settling.best_of(told)
    assert own.is_loose(loose, 0)
    missing = loose.expected - loose.count
    assert own.least_score(loose, LIMITS) >= LIMITS.score + rules.MISSED * min(missing, 1)
    spot, marker = (int(a[0]) for a in tight.pairs())
    _, labelled = settling.best_of(scene, fixed=((spot, marker),))
    assert own.least_score(labelled, LIMITS) == pytest.approx(LIMITS.score - np.log(60))


def test_a_camera_of_a_rig_that_shows_something_else_contradicts():
    rig = scenes.rig_scene(78, "B", 2, noise_px=0.2)
    views = settling.views_of_rig(rig)
    joint = settling.settled(views, rig)
    assert blocked(joint, 0) == blocked(joint, 1) == ""
    rng = np.random.default_rng(0)
    clutter = settling.Detections.make(rng.uniform(0, 1, (40, 2)) * rig.views[1].camera.size_px, sigma_px=0.2)
    blind = replace(rig.views[1], detections=clutter, label=np.full(40, -1))
    off = scenes.RigScene((rig.views[0], blind), rig.cam_from_rig, rig.rig_from_model)
    best = settling.settled(settling.views_of_rig(off), off)
    words = blocked(best, 1)
    assert "among its 40 spots" in words
    assert "cam_from_rig" in words
    assert blocked(best, 0) == ""


class Found:
    """A search that has found some candidates."""

    links = 0

    def __init__(self, *candidates):
        self.candidates = list(candidates)

    def top(self, count, within=np.inf):
        return self.candidates[:count]

    def batches(self):
        return iter(())


def test_a_candidate_that_is_grown_again_keeps_its_solution():
    """The search puts a better one in its place: what that would settle to is known, and stays known."""
    rig = scenes.rig_scene(78, "B", 2, noise_px=0.2)
    views = settling.views_of_rig(rig)
    match = settling.labels_of(*rig.views)[0]
    first, again = (Candidate(rig.views[0].cam_from_model, views.planes[0].task.camera.focal_px, score,
                              int((match >= 0).sum()), match.copy()) for score in (90.0, 100.0))  # fmt: skip
    search = Found(first)
    source = Source(views, [search, None], np.inf, Budget())
    (known,) = source.solutions()
    search.candidates = [again]
    assert source.solutions() == [known]


def test_few_of_many_markers_confirm_what_the_others_see():
    """Ten pairs of sixty are evidence enough, though the other camera sees nearly all."""
    rig = scenes.rig_scene(78, "B", 2, noise_px=0.2)
    kept = np.flatnonzero(rig.views[1].label >= 0)[:10]
    few = replace(rig.views[1], detections=rig.views[1].detections.take(kept), label=rig.views[1].label[kept])
    off = scenes.RigScene((rig.views[0], few), rig.cam_from_rig, rig.rig_from_model)
    best = settling.settled(settling.views_of_rig(off), off)
    assert best.counts[1] == 10
    assert best.state.numbers[1, EXPECTED] > 40
    assert blocked(best, 1) == ""


@pytest.mark.parametrize(("counts", "expected", "words"), [
    ([50, 5], [60, 6], ""),  # as many as elsewhere
    ([50, 1], [60, 0], ""),  # it looks beside the model
    ([0, 5], [0, 60], ""),  # nobody else sees it
    ([50, 1], [60, 40], "1 of 40 markers among its 30 spots where the others see 50 of 60"),
])  # fmt: skip
def test_a_camera_is_blocked_that_sees_far_fewer_than_the_others(counts, expected, words):
    numbers = np.zeros((2, 3))
    numbers[:, EXPECTED] = expected
    plane = SimpleNamespace(task=SimpleNamespace(xy=np.zeros((30, 2))))
    best = SimpleNamespace(
        views=SimpleNamespace(planes=(plane, plane)), counts=np.array(counts), scores=np.array([400.0, 15.0]),
        state=SimpleNamespace(numbers=numbers), count=sum(counts), expected=float(sum(expected)),
    )  # fmt: skip
    said = blocked(best, 1)
    assert words in said if words else said == ""


# --- the answer ------------------------------------------------------------------------------------


def test_the_answer_has_the_centres_of_discs():
    """The projections are moved by the eccentricity of the ellipses, so that the residuals are free of it."""
    scene = settling.wide_scene(79, noise_px=0.0)
    axes = scene.cam_from_model.rotation
    normal = np.tile((axes[0] - axes[2]) / np.sqrt(2), (60, 1))
    discs = replace(scene.markers, radius=np.full(60, 0.04), normal=normal)
    _, best = settling.best_of(replace(scene, markers=discs))
    final, cov = answer(best)
    held = final.state.match[0] >= 0
    assert (np.linalg.norm(final.state.offset[0, held], axis=1) > 0.005).any()
    assert (final.state.offset[0, ~held] == 0).all()
    assert cov.shape == final.unit_cov.shape
    plain, _ = answer(settling.best_of(scene)[1])
    assert (plain.state.offset == 0).all()
