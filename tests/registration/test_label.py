"""Which spot each marker has, against the slow twin; pairs as if they had been left out; what must be seen."""

import numpy as np
import pytest
import registration_scenes as scenes
import settle_scenes as settling
import settle_twins as twins
from hypothesis import given
from hypothesis import strategies as st

from windmark.geometry import Camera
from windmark.registration.settle._kernels import fit, label
from windmark.registration.settle._kernels import settle as kernels
from windmark.registration.settle._kernels.state import EXPECTED
from windmark.registration.settle.settling import copied


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


@pytest.mark.slow
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


@pytest.mark.parametrize(("seed", "crowd", "step"), [(72, 1, 2), (73, 1, 2), (72, 300, 2), (73, 300, 2), (72, 1, 9)])
def test_labels_of_a_bent_model_in_a_rig_are_those_of_the_twin(seed, crowd, step):
    """Hidden markers, bound ones, clear leads: all at once, from half of the pairs; if spots were so many times denser,
    where a new pair must be far likelier than a foreign spot; and from so few pairs that most places are open.
    """  # fmt: skip
    rig, views = settling.unlike_rig(seed)
    views = settling.bent_views(views, 0.015 if step == 2 else 0.1)
    state = copied(views, settling.settled(views, rig).state)
    views.__dict__["densities"] = tuple(crowd * d for d in views.densities)
    views.__dict__["sights"] = views.sights._replace(density=crowd * views.sights.density)
    state.match[:, np.arange(60) % step > 0] = -1
    state.hidden[0, 5:9] = True
    state.match[:, 5:9] = -1
    assert fit.refine(views.sights, state, np.zeros((2, 60, 3)))
    state.bound[1, 12] = 3
    new = assert_as_the_twin(views, state)
    assert new[1, 12] == 3
    assert (new[0, 5:9] == -1).all()
    assert crowd > 1 or (new[:, np.arange(60) % step > 0] >= 0).any()


@pytest.mark.parametrize("is_bent", [False, True])
def test_pairs_are_one_to_one_closest_first_and_clear_of_a_bent_model(is_bent):
    """Random distances of eight markers to eight spots, some of them held, one bound: as the twin chooses."""
    scene = settling.curved_scene(5)
    views = settling.bent_views(settling.views_of(scene)) if is_bent else settling.views_of(scene)
    state = copied(views, settling.settled(settling.views_of(scene), scene).state)
    kept, rng = [0, 0], np.random.default_rng(6)
    for _ in range(200):
        state.match[:], new = -1, np.full((1, 60), -1, np.int32)
        held = rng.permutation(8)[:5]
        state.match[0, held] = rng.permutation(8)[:5]
        new[0, 59] = 7
        m, s = np.nonzero(rng.uniform(size=(8, 8)) < 0.2)
        d = rng.uniform(0, 20, len(m))
        pairs = [(*pair, state.match[0, pair[1]] == pair[2]) for pair in zip(d, m.tolist(), s.tolist(), strict=True)]
        expected = twins.one_to_one(pairs, {59: 7}, is_bent)
        label._pair_up(state.match[0], is_bent, 8, m.astype(np.int32), s.astype(np.int32), d, new[0])
        assert {int(k): int(new[0, k]) for k in np.flatnonzero(new[0] >= 0)} == expected
        for k, spot in expected.items():
            kept[int(state.match[0, k] == spot)] += 1
    assert min(kept) > 30


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
        cov = noise + by @ twins.cov_of(alone) @ by.T
        off = twins.project(views, alone)[0, m] - scene.detections.xy[spot]
        du, dv = state.residual[0, m]
        got, root = label.leave_one_out(du, dv, *state.spread[0, m], *state.place[0, m], True)
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
    got = label.leave_one_out(du, dv, *noise[[0, 0, 1], [0, 1, 1]], *place[[0, 0, 1], [0, 1, 1]], held)
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
