"""The kernels of the settle against slow, readable twins."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes
import settle_scenes as settling
import settle_twins as twins
from scipy.optimize import least_squares

from windmark.registration.settle._kernels import fit, places, project, rigid
from windmark.registration.settle._kernels import settle as kernels
from windmark.registration.settle._kernels.state import COST_END, EXCESS, MISFIT, TAKEN
from windmark.registration.settle.settling import copied, settle_state, with_freedom
from windmark.registration.settle.views import doubted_place
from windmark.scene import Detections


@pytest.fixture(scope="module")
def everything():
    """A rig with all kinds of unknowns, settled: (rig, views, solution)."""
    rig, views = settling.unlike_rig(71)
    views = settling.bent_views(views)
    return rig, views, settling.settled(views, rig)


def moved_state(views, solution, seed):
    """A copy of a state with nuisances, coefficients and offsets that are not zero, cameras brought up to date."""
    rng, state = np.random.default_rng(seed), copied(views, solution.state)
    state.nuisance[:] = rng.normal(0, 0.7, state.nuisance.shape)
    state.bent[:] = rng.normal(0, 0.7, state.bent.shape)
    state.offset[:] = rng.normal(0, 0.3, state.offset.shape)
    project.place_cameras(views.sights, state)
    return state


# --- projection ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_projections_and_derivatives_are_those_of_the_cameras(everything):
    """By the pose, every nuisance, every coefficient, and the marker's own place; cameras from the noun."""
    _, views, solution = everything
    state, size = moved_state(views, solution, 1), len(solution.state.factor)
    assert size == 6 + 2 * state.nuisance.shape[1] + len(state.bent)
    seen, by, by_marker = twins.project(views, state), twins.by_unknowns(views, state), twins.by_markers(views, state)
    asked, (xy, found) = np.arange(60) % 7 == 0, project.room_for(state)
    for c in range(2):
        project.see(views.sights, state, c, asked, xy, found)
        assert np.isnan(xy[~asked]).all()
        for m in np.flatnonzero(asked):
            np.testing.assert_allclose(xy[m], seen[c, m], atol=1e-8)
            scale = np.abs(by[c, m]).max(axis=0) + 1.0
            np.testing.assert_allclose(found[m, :, :size] / scale, by[c, m] / scale, atol=2e-6)
            np.testing.assert_allclose(found[m, :, size:], by_marker[c, m], rtol=1e-6, atol=1e-4)


def test_a_camera_may_stand_elsewhere_in_the_rig(everything):
    """Projections are exact, derivatives by the place are those of a small one; beside all other unknowns."""
    _, views, solution = everything
    opened = views.opened([doubted_place(1e-3, 2e-3)] * 2)
    state, size = moved_state(opened, solution, 3), len(solution.state.factor) + 12
    assert len(state.factor) == size
    seen, by = twins.project(opened, state), twins.by_unknowns(opened, state, step=1e-3)
    asked, (xy, found) = np.arange(60) % 7 == 0, project.room_for(state)
    for c in range(2):
        project.see(opened.sights, state, c, asked, xy, found)
        for m in np.flatnonzero(asked):
            np.testing.assert_allclose(xy[m], seen[c, m], atol=1e-8)
            scale = np.abs(by[c, m]).max(axis=0) + 1.0
            np.testing.assert_allclose(found[m, :, :size] / scale, by[c, m] / scale, atol=5e-3)
    assert np.abs(seen - twins.project(views, copied(views, state))).min() > 0.01


def test_places_are_the_projections_and_nothing_behind_the_camera(everything):
    _, views, solution = everything
    state = moved_state(views, solution, 2)
    for c in range(2):
        got = places.places_kernel(views.sights, state, c)
        np.testing.assert_allclose(got, twins.project(views, state)[c], atol=1e-8)
    state.translation[:] = views.cam_from_rig[0].inverse().apply([0.0, 0.0, -20.0]) / views.layout.frame.scale
    project.place_cameras(views.sights, state)
    assert np.isnan(places.places_kernel(views.sights, state, 0)).all()


# --- fit -----------------------------------------------------------------------------------------


def test_fit_is_that_of_least_squares(everything):
    """All unknowns of pose, cameras and shape at once, with their priors."""
    _, views, solution = everything
    state, held = copied(views, solution.state), solution.state.match >= 0
    state.translation[:] += 1e-3
    assert fit.refine(views.sights, state, np.zeros((*state.match.shape, 3)))
    fit.spread_places(views.sights, state)
    fit.weigh_residuals(views.sights, state, np.zeros((*state.match.shape, 3)))
    root = np.linalg.inv(np.linalg.cholesky(twins.square(state.spread[held])))
    spots, start = twins.spots(views, state)[held], np.append(state.nuisance, state.bent)

    def whitened(delta):
        off = twins.project(views, state, delta)[held] - spots
        return np.append(np.einsum("kij,kj->ki", root, off), start + delta[6:])

    best = least_squares(whitened, np.zeros(len(state.factor)), x_scale=np.sqrt(np.diag(twins.cov_of(state))))
    cov = np.linalg.inv(best.jac.T @ best.jac)
    sigma = np.sqrt(np.diag(cov))
    assert (np.abs(best.x) < 1e-3 * sigma).all()
    np.testing.assert_allclose(twins.cov_of(state) / np.outer(sigma, sigma), cov / np.outer(sigma, sigma), atol=2e-3)
    assert state.report[COST_END] == pytest.approx(best.cost, rel=1e-6)


def test_covariance_of_places_residuals_and_what_the_fit_takes(everything):
    rig, views, _ = everything
    sigma = np.full((60, 3), 4e-4) * [1.0, 2.0, 0.5]
    tables = [replace(v, markers=replace(v.markers, sigma=sigma)) for v in rig.views]
    views = settling.bent_views(settling.views_of(*tables, cam_from_rig=rig.cam_from_rig, focal_factors=settling.FREE))
    solution = settling.settled(views, rig)
    state, held = copied(views, solution.state), solution.state.match >= 0
    assert kernels.fit_kernel(views.sights, state)
    by, table = twins.by_unknowns(views, state), twins.table_of(views, state)
    place = by @ twins.cov_of(state) @ np.swapaxes(by, 2, 3)
    np.testing.assert_allclose(twins.square(state.place), place, rtol=1e-3, atol=1e-4)
    for c, plane in enumerate(views.planes):
        noise = plane.task.cov[state.match[c, held[c]]] + table[c, held[c]] + state.numbers[c, EXCESS] * np.eye(2)
        np.testing.assert_allclose(twins.square(state.spread[c, held[c]]), noise, rtol=1e-4)
        taken = np.trace(np.linalg.solve(noise, place[c, held[c]]), axis1=1, axis2=2).sum()
        assert state.numbers[c, TAKEN] == pytest.approx(taken, rel=1e-3)
        squares = (state.residual[c, held[c]] ** 2).sum()
        assert state.numbers[c, MISFIT] == pytest.approx(squares / (2 * held[c].sum() - taken), rel=1e-3)
    # What the spots determine and what the priors do are all unknowns.
    normal = twins.normal_equations(views, state)
    by_priors = np.trace(np.linalg.inv(normal)[6:, 6:])
    assert state.numbers[:, TAKEN].sum() + by_priors == pytest.approx(len(normal), rel=1e-3)


def test_too_few_pairs_and_a_line_are_no_fit():
    scene = settling.curved_scene(4)
    views = settling.views_of(scene)
    first = set(scene.label[:3].tolist())
    assert settling.settled(views, scene, settling.labels_of(scene, keep=lambda c, m: m in first)) is None
    solution = settling.settled(views, scene)
    state = copied(views, solution.state)
    views.sights.xyz[:, 1:] *= 0.0
    assert not fit.refine(views.sights, state, np.zeros((1, 60, 3)))


# --- excess --------------------------------------------------------------------------------------


def alike_spots():
    """Spots with one round covariance, settled."""
    scene = scenes.scene(6, "B", noise_px=0.2)
    views = settling.views_of(scene)
    return views, settling.settled(views, scene)


def drawn(rng, views, state, excess):
    """A state whose residuals are random with the covariances of their spots and so much more (px^2)."""
    other = copied(views, state)
    other.numbers[0, TAKEN] = 0.0
    for m in np.flatnonzero(state.match[0] >= 0):
        cov = views.planes[0].task.cov[state.match[0, m]] + excess * np.eye(2)
        other.residual[0, m] = rng.multivariate_normal([0.0, 0.0], cov)
    return other


@pytest.mark.slow
@pytest.mark.parametrize("excess", [0.0, 0.3, 2.0])
def test_excess_is_what_the_residuals_have_beyond_the_spots(excess):
    """On average over 300 pictures; one gross error among 40 pairs moves it by little."""
    views, solution = alike_spots()
    rng, table = np.random.default_rng(3), np.zeros((1, 60, 3))
    found, with_gross = [], []
    for _ in range(300):
        state = drawn(rng, views, solution.state, excess)
        found.append(fit.excess_of(views.sights, state, table, 0, 0.0, 0.0)[0])
        state.residual[0, np.flatnonzero(state.match[0] >= 0)[7]] = 40.0
        with_gross.append(fit.excess_of(views.sights, state, table, 0, 0.0, 0.0)[0])
    weak_prior = 2 * solution.count / (2 * solution.count + fit.PRIOR_WORTH)
    # Noise of 0.2 px: without any excess its estimate is cut at 0 and a little above it.
    assert np.mean(found) == pytest.approx(weak_prior * excess, rel=0.06, abs=0.006)
    assert np.mean(with_gross) < 1.25 * np.mean(found) + 0.01


def test_luck_is_no_excess_and_doubt_is_kept_without_pairs():
    views, solution = alike_spots()
    rng, table = np.random.default_rng(4), np.zeros((1, 60, 3))
    zero = {0.0: 0, 1.0: 0}
    for _ in range(200):
        state = drawn(rng, views, solution.state, 0.0)
        for luck in zero:
            zero[luck] += fit.excess_of(views.sights, state, table, 0, 0.0, luck)[0] == 0.0
    assert 80 < zero[0.0] < 135  # half of the time without any excess, and 84 % with a sigma of luck
    assert 150 < zero[1.0] < 190
    state.match[:] = -1
    assert fit.excess_of(views.sights, state, table, 0, 0.7, 0.0) == (0.7, 0.0)


def test_one_vague_spot_does_not_hide_the_excess_of_the_others():
    """Of 40 pairs with an excess of three times their sigma one has a sigma of 3 px: its variance alone is 30 times it.
    """
    views, solution = alike_spots()
    rng, table = np.random.default_rng(5), np.zeros((1, 60, 3))
    state = drawn(rng, views, solution.state, 0.3)
    without = fit.excess_of(views.sights, state, table, 0, 0.04, 0.0)[0]
    sights = views.sights._replace(cov=views.sights.cov.copy())
    sights.cov[state.match[0].max()] = [9.0, 0.0, 9.0]
    excess, noise = fit.excess_of(sights, state, table, 0, 0.04, 0.0)
    assert excess == pytest.approx(without, rel=0.1)
    assert 0.04 <= noise < 0.05


# --- the loop ------------------------------------------------------------------------------------


def test_trusted_labels_stay_while_the_excess_settles():
    """The end is the same; on the way labels were looked for less often."""
    scene = settling.curved_scene(11, hidden=0.2, false=0.5)
    views = settling.views_of(scene)
    plain, trusted = settling.settled(views, scene), settling.settled(views, scene, trusted=4)
    np.testing.assert_array_equal(plain.state.match, trusted.state.match)
    delta = (plain.rig_from_model @ trusted.rig_from_model.inverse()).log()
    assert delta @ np.linalg.solve(plain.cov, delta) < 1e-3


def test_settling_again_changes_nothing():
    for solution in (settling.solution_of(12)[1], settling.solution_of(13, focal_factors=settling.FREE)[1]):
        again = settle_state(solution.views, copied(solution.views, solution.state))
        np.testing.assert_array_equal(again.state.match, solution.state.match)
        delta = (again.rig_from_model @ solution.rig_from_model.inverse()).log()
        assert delta @ np.linalg.solve(solution.cov, delta) < 1e-3
        assert again.score == pytest.approx(solution.score, abs=0.2)


def test_a_bent_model_whose_misfit_stays_large_is_lost():
    """Spots that are off by 3 px: a rigid model opens its gates for them, a bent one would make anything of them."""
    scene = scenes.scene(14, "B", noise_px=3.0)
    told = replace(scene, detections=Detections.make(scene.detections.xy, sigma_px=0.2))
    views = settling.views_of(told)
    rigid = settling.settled(views, told)
    assert rigid.excess_px[0] > 2.5
    assert settling.settled(settling.bent_views(views), told) is None
    assert with_freedom(settling.bent_views(views), settling.settled(views, told)) is None
    right = settling.views_of(scene)
    assert settling.settled(settling.bent_views(right), scene) is not None


@pytest.mark.slow
@pytest.mark.parametrize("rough", [0.0, 0.002], ids=["exact table", "rough table"])
def test_of_a_rigid_model_the_normal_equations_are_the_general_ones(rough):
    """Bit for bit: residuals, weights, and the covariance by the table; two cameras, one of them curved."""
    rig = scenes.rig_scene(72, "B", 2, hidden=0.3, false=0.5)
    views = settling.views_of_rig(rig)
    views.__dict__["sights"] = views.sights._replace(sigma=np.full_like(views.sights.sigma, rough))
    found = []
    for way in ("rigid", "general"):
        state = copied(views, settling.settled(views, rig).state)
        state.offset[:] = np.random.default_rng(3).normal(0, 0.3, state.offset.shape)
        table, a, g = np.zeros((*state.match.shape, 3)), np.empty((6, 6)), np.empty(6)
        if way == "rigid":
            cost = rigid.rigid_equations(views.sights, state, table, a, g)
        else:
            cost = fit._normal_equations(views.sights, state, table, *project.room_for(state), a, g)
        found.append((cost, a, g, table, state.residual))
    assert found[0][0] > 0
    assert (found[0][3].max() > 0) == (rough > 0)
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)
