"""What labels are worth: every reading against dense probability theory, and the lead that holds in all of them."""

from itertools import product

import numpy as np
import pytest
import registration_scenes as scenes
import settle_scenes as settling
import settle_twins as twins
from scipy.stats import multivariate_normal

from windmark.geometry import Camera
from windmark.registration._kernels.evidence import log10_nfa
from windmark.registration.settle._kernels import worth
from windmark.registration.settle._kernels.doubt import doubt_kernel
from windmark.registration.settle._kernels.state import EXPECTED, READINGS
from windmark.registration.settle.settling import copied, with_freedom
from windmark.registration.settle.solution import Solution


def settled(scene, **more):
    views = settling.views_of(scene, **more)
    return settling.settled(views, scene)


@pytest.fixture(scope="module")
def some_hidden():
    scene = settling.curved_scene(31, hidden=0.3, false=0.5)
    return scene, settled(scene)


# --- readings ------------------------------------------------------------------------------------


def test_pairs_are_weighed_by_their_covariance_against_the_density(some_hidden):
    _, solution = some_hidden
    spot, marker = solution.pairs()
    density = solution.views.densities[0][-1][spot]
    logs = [
        multivariate_normal.logpdf(solution.state.residual[0, m], cov=twins.square(solution.state.spread[0, m]))
        for m in marker
    ]
    assert len(solution.views.leads[0]) == 1
    assert solution.readings[0, worth.PAIRS] == pytest.approx((np.array(logs) - np.log(density)).sum(), rel=1e-9)


def test_of_the_prefixes_of_a_long_list_the_best_one_counts():
    """Five times as many bad spots behind the good ones cost the logarithm of the number of prefixes, not more."""
    scene = scenes.scene(32, "A", noise_px=0.2)
    alone = settled(scene)
    clutter = np.random.default_rng(0).uniform(0, 1, (400, 2)) * scene.camera.size_px
    # Far from the model's spots, so that the labels stay as they are.
    far = np.linalg.norm(clutter[:, None] - scene.detections.xy[None], axis=2).min(axis=1) > 60
    xy = np.concatenate([scene.detections.xy, clutter[far]])
    more = scenes.Scene(
        settling.Detections.make(xy, sigma_px=0.2), scene.markers, scene.camera, scene.cam_from_model,
        np.append(scene.label, np.full(far.sum(), -1)),
    )  # fmt: skip
    both = settled(more)
    leads = both.views.leads[0]
    assert len(leads) > 2
    assert both.readings[0, worth.LEAD] == 0
    first = both.views.densities[0][0][both.pairs()[0]]
    at_all = both.views.densities[0][-1][both.pairs()[0]]
    expected = alone.readings[0, worth.PAIRS] + np.log(alone.views.densities[0][-1][alone.pairs()[0]]).sum()
    assert both.readings[0, worth.PAIRS] == pytest.approx(expected - np.log(first).sum() - np.log(len(leads)), abs=0.1)
    assert np.log(at_all / first).sum() > 5


def test_missing_markers_each_by_itself():
    """The likelihood of so many seen ones at their own share, and the same where the image has no border."""
    rng = np.random.default_rng(9)
    markers = scenes.wing_and_body(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(30, 30), tilt_max_deg=20)
    camera = Camera((560, 420), camera.focal_px)  # smaller than the image of the model
    solution = settled(scenes.image_of(rng, markers, camera, pose, noise_px=0.1, hidden=0.3))
    state, n = solution.state, solution.count
    facing = (state.faces[0] | (state.match[0] >= 0)).sum()
    for reading, of in ((worth.ALONE, state.numbers[0, EXPECTED]), (worth.CLOSED, facing)):
        share = np.clip((n + 1) / (of + 2), 0.25, 0.95)
        assert solution.readings[0, reading] == pytest.approx(n * np.log(share) + (of - n) * np.log(1 - share))
    assert facing > solution.expected > n


def hidden_where(chosen):
    """A regular grid that is seen whole but for some markers."""
    x, y = np.meshgrid(np.arange(8.0), np.arange(6.0), indexing="ij")
    rng = np.random.default_rng(33)
    xyz = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3) + rng.normal(0, 0.1, (48, 3))
    markers = scenes.MarkerSet.make([f"g{i}" for i in range(48)], xyz, normal=np.tile([0.0, 0.0, 1.0], (48, 1)))
    camera, pose = scenes.random_view(rng, markers, tilt_max_deg=20)
    scene = scenes.image_of(rng, markers, camera, pose, noise_px=0.2)
    kept = ~np.isin(scene.label, chosen)
    return scenes.Scene(scene.detections.take(kept), markers, camera, pose, scene.label[kept])


def test_missing_markers_in_one_piece_are_charged_by_the_edge():
    """Two columns at one end have an edge of six links and some; as many scattered ones have four each."""
    piece, scattered = np.arange(12), np.array([1, 4, 9, 14, 16, 21, 25, 28, 33, 36, 40, 44])
    found = {}
    for name, gone in (("piece", piece), ("scattered", scattered), ("none", np.zeros(0, int))):
        solution = settled(hidden_where(gone))
        near = solution.views.layout.model.near[:, : worth.LINKS]
        assert solution.count == 48 - len(gone)
        assert solution.state.faces.all()
        seen = solution.state.match[0] >= 0
        links = (seen[:, None] != seen[near]).sum()
        found[name] = solution.readings[0, worth.PIECES]
        assert found[name] == pytest.approx(-np.log(48) - 0.5 * np.log(3.0) * links)
        better = np.maximum(solution.readings[0, worth.ALONE], found[name])
        assert solution.score == pytest.approx(solution.readings[0, worth.PAIRS] + better)
        if name == "piece":
            assert found[name] > solution.readings[0, worth.ALONE] + 3
    assert found["scattered"] < found["piece"] - 10 < found["none"] - 10


def test_a_camera_with_two_pairs_has_no_reading(some_hidden):
    _, solution = some_hidden
    state = copied(solution.views, solution.state)
    held = np.flatnonzero(state.match[0] >= 0)
    state.match[0, held[2:]] = -1
    r = Solution(solution.views, state).readings[0]
    assert r[worth.PAIRS] == -np.inf
    assert r[worth.LOG10_NFA] == np.inf


# --- false alarms --------------------------------------------------------------------------------


def nfa_of(residual_px, matched, expected, spots=30, seed=0, log_share=0.0):
    rng = np.random.default_rng(seed)
    residuals, density = rng.normal(0, residual_px, (matched, 2)), np.full(matched, spots / 1e6)
    return log10_nfa(residuals, density, expected, 24, spots, 3, log_share)


def test_false_alarm_number_orders_labellings():
    good = nfa_of(0.3, 15, 16)
    assert good < nfa_of(0.3, 12, 16) < nfa_of(0.3, 8, 16)
    assert good < nfa_of(3.0, 15, 16) < nfa_of(30.0, 15, 16)
    assert good < nfa_of(0.3, 15, 16, spots=300)
    assert nfa_of(0.3, 3, 3) == np.inf
    assert nfa_of(0.3, 15, 16, log_share=np.log(1e-3)) == pytest.approx(good - 3)


def test_false_alarm_number_bounds_false_alarms():
    """Random spots against random predictions: fewer than 1 in 1/NFA trials is as good (here without the tests)."""
    rng = np.random.default_rng(3)
    spots, markers, trials, hits = 30, 12, 400, 0
    tests = np.log10(4 * 220 * 30 * 29 * 28)
    for _ in range(trials):
        xy, drawn = rng.uniform(0, 1000, (spots, 2)), rng.uniform(0, 1000, (markers, 2))
        distance = np.linalg.norm(xy[None] - drawn[:, None], axis=2)
        spot = distance.argmin(axis=1)
        _, first = np.unique(spot, return_index=True)
        residuals = (drawn - xy[spot])[first]
        residuals[:3] = 0  # three exact pairs stand for the ones that fixed the pose
        hits += log10_nfa(residuals, np.full(len(first), spots / 1e6), markers, markers, spots, 3, 0.0) - tests < -1
    assert hits <= 0.1 * trials


@pytest.mark.parametrize("free", [0, 1, 2])
def test_false_alarms_of_a_rig_count_all_spots_and_pairs(free):
    """Three pairs fix the pose, and one more each free focal length."""
    rig = scenes.rig_scene(36, "B", 2, hidden=0.5, false=0.5)
    views = settling.views_of_rig(
        rig, each=tuple({"focal_factors": settling.FREE} if c < free else {} for c in range(2))
    )
    both = settling.settled(views, rig)
    ones = [settled(view) for view in rig.views]
    assert both.log10_nfa < min(one.log10_nfa for one in ones)
    residuals = np.concatenate([both.state.residual[c, both.pairs(c)[1]] for c in range(2)])
    density = np.concatenate([views.densities[c][-1][both.pairs(c)[0]] for c in range(2)])
    spots = sum(len(view.detections) for view in rig.views)
    expected = log10_nfa(residuals, density, both.expected, 60, spots, 3 + free, 0.0)
    assert both.log10_nfa == pytest.approx(expected)


# --- evidence and leads --------------------------------------------------------------------------


def test_freedom_is_the_volume_of_the_posterior_in_that_of_the_prior():
    """Six unknowns of the pose: the same for a table in inches, and less by a prior's share."""
    scene = scenes.scene(37, "B", noise_px=0.2)
    solution = settled(scene)
    scaled = scenes.MarkerSet.make(scene.markers.name, 25.4 * scene.markers.xyz, normal=scene.markers.normal)
    pose = scenes.Pose(scene.cam_from_model.rotation, 25.4 * scene.cam_from_model.translation)
    other = settled(scenes.Scene(scene.detections, scaled, scene.camera, pose, scene.label))
    assert other.freedom == pytest.approx(solution.freedom, abs=1e-3)
    assert solution.freedom < -20
    prior = settled(scene, prior=scene.cam_from_model, prior_max_angle_rad=0.5, prior_max_scale=1.3)
    share = prior.views.planes[0].task.prior_share
    assert prior.freedom == pytest.approx(solution.freedom - np.log(share), abs=1e-6)


def test_freedom_is_that_of_place_and_distance():
    """The posterior's volume by rotation, place (px) and logarithm of the distance of the middle of what is seen."""
    scene = scenes.scene(37, "B", noise_px=0.2)
    solution = settled(scene)
    camera, state = scene.camera, solution.state
    at = state.rotation @ solution.views.layout.model.xyz[solution.pairs()[1]].mean(axis=0) + state.translation

    def seen(t):
        return np.append(camera.project(t)[0], np.log(t[2]))

    change = np.eye(6)
    change[3:, 3:] = np.stack([(seen(at + d) - seen(at - d)) / 2e-6 for d in 1e-6 * np.eye(3)], axis=1)
    cov = change @ solution.unit_cov @ change.T
    volume = 0.5 * np.linalg.slogdet(2 * np.pi * cov)[1]
    prior = np.log(8 * np.pi**2) + np.log(np.prod(camera.size_px)) + np.log(np.log(100.0))
    assert solution.freedom == pytest.approx(volume - prior, abs=1e-5)


def test_freedom_has_the_priors_of_cameras_and_shape():
    """Two sigma of a nuisance cost two nats, one of a coefficient half a nat."""
    scene = scenes.scene(37, "B", noise_px=0.2)
    best = settled(scene)
    views = settling.bent_views(best.views.doubted(columns=(1,)))
    best = with_freedom(views, best)
    best.state.nuisance[:], best.state.bent[:] = 0.0, 0.0
    before = best.freedom
    for at, size, cost in ((best.state.nuisance, 2.0, 2.0), (best.state.bent, 1.0, 0.5)):
        at.flat[0] = size
        assert Solution(views, best.state).freedom == pytest.approx(before - cost)
        at.flat[0] = 0.0


@pytest.mark.parametrize("columns", [(0,), (1,), (2, 3), (4,), range(5)])
def test_evidence_with_more_freedom_is_what_the_first_order_says(columns):
    """Normal equations with more unknowns tell what settling with them gains, Occam factor and priors included."""
    scene = settling.of_rough_table(38, sigma=0.0005)
    best = settled(scene)
    views = best.views.doubted(columns=columns)
    normal, side = doubt_kernel(views.sights, copied(views, best.state))
    np.testing.assert_allclose(normal[:6, :6], np.linalg.inv(best.unit_cov), rtol=0.05, atol=1e-3 * normal.max())
    whole = normal + np.diag((np.arange(len(side)) >= 6).astype(float))
    rest = whole[:6, :6]
    cost = 0.5 * (side @ np.linalg.solve(whole, side) - side[:6] @ np.linalg.solve(rest, side[:6]))
    occam = 0.5 * (np.linalg.slogdet(whole)[1] - np.linalg.slogdet(rest)[1])
    refit = with_freedom(views, best, relabel=False)
    assert refit.evidence - best.evidence == pytest.approx(cost - occam, abs=0.15)


def test_a_lead_is_that_in_the_worst_reading():
    """Two solutions with made-up readings: of four ways to read them the least lead counts, and the freedoms."""
    scene = scenes.scene(39, "A")
    rng = np.random.default_rng(5)
    for _ in range(40):
        one, two = settled(scene), settled(scene)
        for solution in (one, two):
            solution.__dict__["readings"] = rng.normal(0, 30, (1, READINGS))
            solution.__dict__["freedom"] = rng.normal(-40, 5)
        leads = []
        for border, smooth in product((worth.ALONE, worth.CLOSED), (False, True)):
            worths = []
            for solution in (one, two):
                r = solution.readings[0]
                value = r[worth.PAIRS] + max(r[border], r[worth.PIECES]) + (r[worth.SYSTEMATIC] if smooth else 0.0)
                worths.append(value + solution.freedom)
            leads.append(worths[0] - worths[1])
        assert one.lead_over(two) == pytest.approx(min(leads))
        assert two.lead_over(one) == pytest.approx(-max(leads))
    assert one.lead_over(one) == 0.0


def test_a_camera_without_pairs_is_worth_nothing():
    rig = scenes.rig_scene(40, "A", 2)
    view = rig.views[1]
    clutter = np.random.default_rng(0).uniform(0, 5, (6, 2))
    blind = scenes.Scene(
        settling.Detections.make(clutter, sigma_px=0.2), view.markers, view.camera, view.cam_from_model,
        np.full(6, -1),
    )  # fmt: skip
    both = settling.views_of(rig.views[0], blind, cam_from_rig=rig.cam_from_rig)
    seen = scenes.RigScene((rig.views[0], blind), rig.cam_from_rig, rig.rig_from_model)
    solution = settling.settled(both, seen)
    assert solution.counts.tolist() == [settled(rig.views[0]).count, 0]
    assert solution.scores[1] == 0.0
    assert solution.score == pytest.approx(settled(rig.views[0]).score, abs=0.1)
