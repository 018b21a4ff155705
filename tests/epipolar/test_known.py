"""Two pictures of known relative pose."""

from types import SimpleNamespace

import numpy as np
import pytest
import reconstruct_scenes as scenes

from windmark.epipolar import match_known_pair
from windmark.epipolar.continuity import Pairs, grow_family, neighbours, predict
from windmark.epipolar.known import STARTS, _different, _line_distance, _starts
from windmark.geometry import Camera, Pose
from windmark.scene import Detections


def relative(case, a, b):
    one, other = (Pose(case.poses.rotation[v], case.poses.translation[v]) for v in (a, b))
    return other @ one.inverse()


@pytest.mark.parametrize(("model", "least"), [("plate", 0.9), ("model", 0.6)])
def test_neighbouring_pictures(model, least):
    """Most spots matched, none wrong; what is left out is listed."""
    common = right = 0
    for seed in range(3):
        case = scenes.make(50 + seed, model, "walk", views=2)
        result = match_known_pair(*case.detections, case.camera, case.camera, relative(case, 0, 1))
        one, other = case.labels
        assert (one[result.spot_a] == other[result.spot_b]).all()
        common += len(np.intersect1d(one[one >= 0], other[other >= 0]))
        right += int((one[result.spot_a] >= 0).sum())
        assert len(np.intersect1d(result.spot_a, result.ambiguous_a)) == 0
        assert result.distance_px.max() < 0.8
        truth = Pose(case.poses.rotation[0], case.poses.translation[0]).apply(case.xyz[one[result.spot_a]])
        error = np.linalg.norm(result.xyz - truth, axis=1) / np.sqrt(np.trace(result.cov, axis1=1, axis2=2))
        assert np.median(error) < 2
    assert right > least * common


def lattice(rows=12, columns=14, pitch=20.0, keep=None):
    """A regular plate of dots before two cameras side by side: the epipolar lines run along its rows."""
    camera = Camera((1600, 1200), 1600.0)
    x, y = np.meshgrid(np.arange(columns) - columns / 2, np.arange(rows) - rows / 2)
    xyz = np.stack([pitch * x.ravel(), pitch * y.ravel(), np.full(x.size, 900.0)], axis=1)
    turn = np.radians(5.0)
    xyz[:, 2] += np.tan(turn) * xyz[:, 0]
    b_from_a = Pose(np.eye(3), np.array([-150.0, 0.0, 0.0]))
    rng = np.random.default_rng(4)
    views = []
    for points, kept in ((xyz, None), (b_from_a.apply(xyz), keep)):
        xy = camera.project(points)[0] + rng.normal(0, 0.1, (len(points), 2))
        views.append(xy if kept is None else np.where(kept(xyz)[:, None], xy, np.nan))
    return camera, b_from_a, views


def test_a_regular_pattern_is_matched_by_its_borders():
    """Every dot has a rival one pitch on; only the whole pattern decides."""
    camera, b_from_a, (one, other) = lattice()
    order = np.random.default_rng(0).permutation(len(other))
    result = match_known_pair(Detections.make(one), Detections.make(other[order]), camera, camera, b_from_a)
    assert len(result) > 0.9 * len(one)
    np.testing.assert_array_equal(order[result.spot_b], result.spot_a)


def test_a_pattern_cut_by_the_pictures_stays_open():
    """A lattice wider than both pictures: a shift by a pitch explains as much or more, and leaves nothing over."""
    camera, b_from_a, views = lattice(columns=80, rows=8)
    spots = [Detections.make(xy[camera.in_image(xy)]) for xy in views]
    result = match_known_pair(*spots, camera, camera, b_from_a)
    assert len(result) == 0
    assert len(result.ambiguous_a) > 0.8 * len(spots[0])


@pytest.mark.parametrize("count", [8, 40])
def test_given_matches_decide_on_a_pattern_cut_by_the_pictures_and_wrong_ones_are_named(count):
    """One by one where they are few, in groups where they are many; one in eight is a pitch off."""
    camera, b_from_a, views = lattice(columns=80, rows=8)
    number = [np.flatnonzero(camera.in_image(xy)) for xy in views]
    spots = [Detections.make(xy[n]) for xy, n in zip(views, number, strict=True)]
    both = np.intersect1d(*number)
    picked = np.random.default_rng(count).choice(both, count, replace=False)
    meant, wrong = picked.copy(), np.arange(count) % 8 == 0
    meant[wrong] += np.where(np.isin(picked[wrong] + 1, number[1]), 1, -1)
    given = np.stack([np.searchsorted(n, p) for n, p in zip(number, (picked, meant), strict=True)], axis=1)
    result = match_known_pair(*spots, camera, camera, b_from_a, given=given)
    np.testing.assert_array_equal(result.contradicted, wrong)
    assert len(result) > 0.9 * len(both)
    np.testing.assert_array_equal(number[0][result.spot_a], number[1][result.spot_b])


@pytest.mark.parametrize(("second", "open_"), [(30, False), (31, True)])
def test_what_contradicts_a_given_match_stays_open_where_given_ones_contradict_each_other(second, open_):
    """Of two that cannot both be right none is known to be wrong, and what grows without them is against one."""
    camera, b_from_a, views = lattice(6, 8)
    spots = [Detections.make(xy) for xy in views]
    assert len(match_known_pair(*spots, camera, camera, b_from_a)) > 40
    found = match_known_pair(*spots, camera, camera, b_from_a, given=[(10, 10), (30, second)])
    assert len(found) == 0 if open_ else len(found) > 40
    assert not found.contradicted.any()


def test_prediction_of_a_plane():
    """Inverse depth of a plane is affine: predicted from neighbours, with a variance that holds."""
    rng = np.random.default_rng(0)
    xy = rng.uniform(-0.3, 0.3, (60, 2))
    inverse = 1e-3 * (1 + 0.2 * xy[:, 0] - 0.4 * xy[:, 1])
    pairs = Pairs(np.arange(60), np.arange(60), inverse, np.full(60, 1e-8), np.zeros(60), xy, 5e-3)
    value, variance = predict(pairs, neighbours(xy), np.arange(60), np.arange(60))
    assert np.abs(value - inverse).max() < 2e-5
    assert (np.abs(value - inverse) < 4 * np.sqrt(variance)).all()
    nobody = predict(pairs, neighbours(xy), np.full(60, -1), np.arange(60))[1]
    assert np.isinf(nobody).all()
    family = grow_family(pairs, neighbours(xy), 5)
    assert (family.chosen >= 0).mean() > 0.9


def test_a_baseline_of_uncertain_length_makes_all_depths_uncertain_by_the_same_part():
    camera, b_from_a, (one, other) = lattice(6, 8)
    cov = np.zeros((6, 6))
    cov[3, 3] = (0.01 * 150.0) ** 2
    pair = Detections.make(one), Detections.make(other), camera, camera, b_from_a
    exact, rough = match_known_pair(*pair), match_known_pair(*pair, pose_cov=cov)
    assert len(rough) > 0.9 * len(one)
    _, i, j = np.intersect1d(exact.spot_a, rough.spot_a, return_indices=True)
    more = np.sqrt(rough.cov[j, 2, 2] - exact.cov[i, 2, 2])
    np.testing.assert_allclose(more, 0.01 * exact.xyz[i, 2], rtol=0.02)


def test_bad_options():
    camera, spots = Camera((100, 100), 100.0), Detections.make(np.zeros((2, 2)))
    pose = Pose(np.eye(3), np.array([1.0, 0, 0]))
    with pytest.raises(ValueError, match="no baseline"):
        match_known_pair(spots, spots, camera, camera, Pose.identity())
    with pytest.raises(ValueError, match="pose_cov"):
        match_known_pair(spots, spots, camera, camera, pose, pose_cov=np.eye(3))
    with pytest.raises(ValueError, match="depth_range"):
        match_known_pair(spots, spots, camera, camera, pose, depth_range=(2.0, 1.0))
    assert len(match_known_pair(spots.take([]), spots, camera, camera, pose)) == 0


def test_distances_from_epipolar_lines_are_those_in_the_picture():
    """Through the lens: the least distance of a spot from the images of the points that its partner may be."""
    camera = Camera((800, 600), 700.0, 1.2, 380.0, 310.0, k1=-0.15, p1=1e-3)
    step = Pose.from_rotvec([0.05, -0.2, 0.1], [-300.0, 40.0, 30.0])
    rng = np.random.default_rng(3)
    ideal = rng.uniform(-0.25, 0.25, (20, 2))
    depth = rng.uniform(900, 1400, 20)
    there, valid = camera.project(step.apply(np.column_stack([ideal, np.ones(20)]) * depth[:, None]))
    assert valid.all()
    off = rng.normal(0, 0.3, (20, 2))
    got = _line_distance(camera, step, ideal, there + off)
    for k in range(20):
        near = np.linspace(0.98, 1.02, 20001)[:, None] * depth[k] * np.append(ideal[k], 1.0)
        line = camera.project(step.apply(near))[0]
        assert got[k] == pytest.approx(np.hypot(*(line - there[k] - off[k]).T).min(), abs=2e-3)


def test_families_differ_where_they_disagree_on_most_of_what_both_match():
    one = SimpleNamespace(chosen=np.array([0, 1, 2, 3, -1, 5]))
    for other, different in (
        ([0, 9, 9, -1, 4, -1], True), ([0, 1, 9, -1, 4, -1], False), ([0, 1, 9, 9, 4, -1], False),
        ([0, 9, 9, 9, 4, -1], True), ([-1, -1, -1, -1, 4, -1], False),
    ):  # fmt: skip
        assert _different(one, SimpleNamespace(chosen=np.array(other))) == different


def test_search_starts_in_the_middle_and_where_few_candidates_are():
    rng = np.random.default_rng(6)
    xy = rng.uniform(-1, 1, (40, 2))
    first = np.repeat(np.arange(40), rng.integers(0, 6, 40))
    pairs = SimpleNamespace(first=first, xy=xy)
    tried = np.zeros(40, bool)
    tried[::5] = True
    got = _starts(pairs, 40, tried)
    left = np.array([s for s in range(40) if s in first and not tried[s]])
    away = np.linalg.norm(xy[left] - np.median(xy[left], axis=0), axis=1)
    middle, few = got[: STARTS - STARTS // 2], got[STARTS - STARTS // 2 :]
    np.testing.assert_array_equal(middle, left[np.argsort(away)[: STARTS - STARTS // 2]])
    counts = [(first == s).sum() for s in few]
    assert sorted(counts) == sorted((first == s).sum() for s in left)[: STARTS // 2]
    assert not len(_starts(pairs, 40, np.ones(40, bool)))
