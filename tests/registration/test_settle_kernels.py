"""The kernels of the settle against slow, readable twins."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes
import settle_scenes as settling
import settle_twins as twins
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from windmark.geometry import Camera, Pose
from windmark.registration.settle._kernels import fit, label, places, project
from windmark.registration.settle._kernels import settle as kernels
from windmark.registration.settle._kernels.state import COST_END, EXCESS, EXPECTED, MISFIT, TAKEN
from windmark.registration.settle.solution import copied, settle, settle_state, with_freedom
from windmark.scene import Detections


def rig_of(seed, **more):
    """Two unlike cameras: one is curved and may be wrong as its covariance says, both have a free focal length."""
    rig = scenes.rig_scene(seed, "B", 2, hidden=0.3, false=0.5)
    plain = rig.views[0]
    camera = Camera(plain.camera.size_px, plain.camera.focal_px, aspect=1.03, k1=-0.1, p1=1e-3, cov=camera_cov())
    pose = plain.cam_from_model
    true, shown = plain.label >= 0, scenes.visible(plain.markers, camera, pose)[0]
    xy = plain.detections.xy.copy()
    xy[true] += shown[plain.label[true]] - scenes.visible(plain.markers, plain.camera, pose)[0][plain.label[true]]
    first = scenes.Scene(Detections.make(xy, cov=plain.detections.cov), plain.markers, camera, pose, plain.label)
    rig = scenes.RigScene((first, rig.views[1]), rig.cam_from_rig, rig.rig_from_model)
    return rig, settling.views_of_rig(rig, each=({}, {"focal_factors": settling.FREE}), **more)


def camera_cov():
    """(11, 11) of principal point, k1 and tangential distortion, the first two correlated."""
    cov = np.diag([0.0, 1e-6, 9.0, 4.0, 1e-4, 0.0, 1e-8, 0.0, 0.0, 0.0, 0.0])
    cov[2, 3] = cov[3, 2] = 3.0
    return cov


@pytest.fixture(scope="module")
def everything():
    """A rig with all kinds of unknowns, settled: (rig, views, solution)."""
    rig, views = rig_of(71)
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


def test_projections_and_derivatives_are_those_of_the_cameras(everything):
    """By the pose, every nuisance, every coefficient, and the marker's own place; cameras from the noun."""
    _, views, solution = everything
    state, size = moved_state(views, solution, 1), len(solution.state.factor)
    assert size == 6 + 2 * state.nuisance.shape[1] + len(state.bent)
    seen, by, by_marker = twins.project(views, state), twins.by_unknowns(views, state), twins.by_markers(views, state)
    u, v, by_xyz, scratch = np.empty(size), np.empty(size), np.empty((2, 3)), np.empty(12)
    for c in range(2):
        for m in range(0, 60, 7):
            x, y, valid = project.see(views.sights, state, c, m, u, v, by_xyz, scratch)
            assert valid
            np.testing.assert_allclose([x, y], seen[c, m], atol=1e-8)
            scale = np.abs(by[c, m]).max(axis=0) + 1.0
            np.testing.assert_allclose(np.stack([u, v]) / scale, by[c, m] / scale, atol=2e-6)
            np.testing.assert_allclose(by_xyz, by_marker[c, m], rtol=1e-6, atol=1e-4)


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

    best = least_squares(whitened, np.zeros(len(state.factor)), x_scale=np.sqrt(np.diag(twins_cov(state))))
    cov = np.linalg.inv(best.jac.T @ best.jac)
    sigma = np.sqrt(np.diag(cov))
    assert (np.abs(best.x) < 1e-3 * sigma).all()
    np.testing.assert_allclose(twins_cov(state) / np.outer(sigma, sigma), cov / np.outer(sigma, sigma), atol=2e-3)
    assert state.report[COST_END] == pytest.approx(best.cost, rel=1e-6)


def twins_cov(state):
    return np.linalg.inv(state.factor @ state.factor.T)


def test_covariance_of_places_residuals_and_what_the_fit_takes(everything):
    rig, views, _ = everything
    sigma = np.full((60, 3), 4e-4) * [1.0, 2.0, 0.5]
    tables = [replace(v, markers=replace(v.markers, sigma=sigma)) for v in rig.views]
    views = settling.bent_views(settling.views_of(*tables, cam_from_rig=rig.cam_from_rig, focal_factors=settling.FREE))
    solution = settling.settled(views, rig)
    state, held = copied(views, solution.state), solution.state.match >= 0
    assert kernels.fit_kernel(views.sights, state)
    by, table = twins.by_unknowns(views, state), twins.table_of(views, state)
    place = by @ twins_cov(state) @ np.swapaxes(by, 2, 3)
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


# --- labels --------------------------------------------------------------------------------------


def relabelled(views, state, *, shut=False):
    """Labels (C, N) by the kernel, of a state whose places are up to date."""
    new = np.empty(state.match.shape, np.int32)
    packed = twins.table_of(views, state).reshape(*state.match.shape, 4)[..., [0, 1, 3]]
    label.label(views.sights, state, np.ascontiguousarray(packed), new, shut)
    return new


def assert_as_the_twin(views, state, **more):
    new = relabelled(views, state, **more)
    expected, must = twins.label(views, state, **more)
    for c, pairs in enumerate(expected):
        assert {int(m): int(new[c, m]) for m in np.flatnonzero(new[c] >= 0)} == pairs
    np.testing.assert_array_equal(state.must, must)
    return new


@pytest.mark.parametrize("shut", [False, True])
def test_labels_of_a_rigid_model_are_those_of_the_twin(shut):
    """Of a state that has lost every third pair: others come back, unless the labels are shut."""
    scene = settling.curved_scene(5, hidden=0.3, false=1.0)
    views = settling.views_of(scene)
    state = copied(views, settling.settled(views, scene).state)
    before = state.match.copy()
    state.match[0, ::3] = -1
    assert fit.refine(views.sights, state, np.zeros((1, 60, 3)))
    new = assert_as_the_twin(views, state, shut=shut)
    if shut:
        assert (new[0, ::3] == -1).all()
    else:
        np.testing.assert_array_equal(new, before)


@pytest.mark.parametrize(("seed", "crowd"), [(72, 1), (73, 1), (72, 300), (73, 300)])
def test_labels_of_a_bent_model_in_a_rig_are_those_of_the_twin(seed, crowd):
    """Hidden markers, bound ones, clear leads: all at once, from half of the pairs; also if spots were so many times
    denser, where a new pair must be far likelier than a foreign spot.
    """  # fmt: skip
    rig, views = rig_of(seed)
    views = settling.bent_views(views)
    state = copied(views, settling.settled(views, rig).state)
    views.__dict__["densities"] = tuple(crowd * d for d in views.densities)
    views.__dict__["sights"] = views.sights._replace(density=crowd * views.sights.density)
    state.match[:, 1::2] = -1
    state.hidden[0, 5:9] = True
    state.match[:, 5:9] = -1
    assert fit.refine(views.sights, state, np.zeros((2, 60, 3)))
    state.bound[1, 12] = 3
    new = assert_as_the_twin(views, state)
    assert new[1, 12] == 3
    assert (new[0, 5:9] == -1).all()
    assert crowd > 1 or (new[:, 1::2] >= 0).any()


def test_a_pair_is_weighed_as_if_it_had_been_left_out():
    """Residual, covariance and determinant of a held pair are those of a fit without it."""
    scene, solution = settling.solution_of(6)
    views = solution.views
    state = copied(views, solution.state)
    assert kernels.fit_kernel(views.sights, state)
    for m in np.flatnonzero(state.match[0] >= 0)[::6]:
        alone, spot = copied(views, state), state.match[0, m]
        alone.match[0, m] = -1
        assert fit.refine(views.sights, alone, np.zeros((1, 60, 3)))
        by = twins.by_unknowns(views, alone)[0, m]
        noise = twins.square(state.spread[0, m])
        cov = noise + by @ twins_cov(alone) @ by.T
        off = twins.project(views, alone)[0, m] - scene.detections.xy[spot]
        du, dv = state.residual[0, m]
        got, root = label.leave_one_out(du, dv, *state.spread[0, m], state.place[0, m], True)
        assert got == pytest.approx(off @ np.linalg.solve(cov, off), rel=0.01, abs=1e-4)
        assert root == pytest.approx(np.sqrt(np.linalg.det(cov)), rel=0.01)


@given(
    st.floats(-3, 3), st.floats(-3, 3), st.floats(0.1, 4), st.floats(-0.9, 0.9), st.floats(0.1, 4),
    st.floats(0, 1.3), st.floats(-0.9, 0.9), st.floats(0, 1.3), st.booleans(),
)  # fmt: skip
def test_leave_one_out_is_that_of_the_matrices(du, dv, sx, r, sy, px, q, py, held):
    """Also where a pair alone determines part of the solution: then a part of its variance is left to it."""
    noise = np.array([[sx * sx, r * sx * sy], [r * sx * sy, sy * sy]])
    place = np.array([[px * px, q * px * py], [q * px * py, py * py]])
    got = label.leave_one_out(du, dv, *noise[[0, 0, 1], [0, 1, 1]], place[[0, 0, 1], [0, 1, 1]], held)
    np.testing.assert_allclose(got, twins.leave_one_out(np.array([du, dv]), noise, place, held), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("radius", [np.nan, 4.0, 60.0])
def test_a_marker_whose_disc_the_border_may_cut_is_not_expected(radius):
    """But counted where it is found all the same."""
    rng = np.random.default_rng(9)
    markers = scenes.wing_and_body(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(30, 30), tilt_max_deg=20)
    camera = Camera((560, 420), camera.focal_px)  # smaller than the image of the model
    scene = scenes.image_of(rng, markers, camera, pose, noise_px=0.1, hidden=0.3)
    radii = np.append(np.full(len(scene.detections) - 1, radius), np.nan)
    solution = settling.settled(settling.views_of(scene, radius_px=radii), scene)
    xy, seen = scenes.visible(markers, camera, pose)
    clear = np.minimum(xy + 0.5, np.array(camera.size_px) - 0.5 - xy).min(axis=1)
    must = seen & (clear > label.BORDER + np.nan_to_num(radius))
    found = np.isin(np.arange(len(markers)), scene.label)
    assert solution.count == found.sum()
    assert solution.expected == solution.state.numbers[0, EXPECTED] == (must | found).sum()
    if radius == 60.0:
        assert solution.expected < (seen & (clear > label.BORDER)).sum()


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


def test_a_bent_start_whose_misfit_grows_is_lost():
    """Labels of another model: within the first rounds the excess must not open the gates."""
    scene = settling.curved_scene(14)
    views = settling.bent_views(settling.views_of(scene))
    rng, match = np.random.default_rng(1), settling.labels_of(scene)
    held = np.flatnonzero(match[0] >= 0)
    match[0, held] = rng.permutation(match[0, held])
    pose = Pose(scene.cam_from_model.rotation, scene.cam_from_model.translation)
    assert settle(views, *views.layout.frame.unit(pose), match) is None
    assert with_freedom(views, settling.settled(settling.views_of(scene), scene)) is not None
