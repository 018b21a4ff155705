"""Parts of the choice of a model: what chance can do by drawing it, and both sides of each test."""

from itertools import combinations
from math import comb

import numpy as np
import pytest
from scipy import stats

from windmark.geometry import Pose
from windmark.geometry.two_view import choice
from windmark.geometry.two_view.candidates import GATE_LINE, GATE_POINT
from windmark.geometry.two_view.fundamental import MOST_SETS, _count, _epipole, _subsets, refine_fundamental
from windmark.geometry.two_view.homography import _FLAT, fit_homography
from windmark.geometry.two_view.homography_refine import homography_errors
from windmark.geometry.two_view.matrices import essential_from_poses
from windmark.geometry.two_view.pairs import Pairs
from windmark.geometry.two_view.refine import sampson_errors

POSE = Pose.from_rotvec([0.05, -0.1, 0.02], [-0.8, 0.1, 0.05])


def seen(count=40, sigma=1e-3, seed=0):
    rng = np.random.default_rng(seed)
    xyz = np.column_stack([rng.uniform(-1, 1, (count, 2)), rng.uniform(3, 5, count)])
    other = POSE.apply(xyz)
    a, b = xyz / xyz[:, 2:], other / other[:, 2:]
    cov = np.tile(sigma**2 * np.eye(2), (count, 1, 1))
    return Pairs(a, b, cov, cov)


def unrelated(pairs, count, seed):
    """Points of a with places anywhere in the extent of b."""
    rng = np.random.default_rng(seed)
    a = pairs.a[rng.integers(len(pairs), size=count)]
    low, high = pairs.b[:, :2].min(axis=0), pairs.b[:, :2].max(axis=0)
    b = np.column_stack([rng.uniform(low, high, (count, 2)), np.ones(count)])
    cov = np.tile(pairs.cov_a[:1], (count, 1, 1))
    return Pairs(a, b, cov, cov)


def test_chance_on_a_line_is_that_of_draws():
    """The gate's width across the extent; lines are shorter than its diagonal, so it is no less than is drawn."""
    pairs = seen(sigma=3e-3)
    drawn = sampson_errors(essential_from_poses(POSE), unrelated(pairs, 40_000, 1)) ** 2 < GATE_LINE
    got = choice.chance_on_line(POSE, pairs)
    assert drawn.mean() < got < 2.2 * drawn.mean()


def test_chance_on_a_line_is_the_gates_width_times_the_diagonal_over_the_area():
    """Level lines, by a shift to the side, one for each point: no wrong partner agrees, and the width alone counts."""
    place = np.column_stack([np.linspace(0, 3, 7), np.linspace(0, 4, 7), np.ones(7)])
    cov = np.tile(1e-3**2 * np.eye(2), (7, 1, 1))
    got = choice.chance_on_line(Pose(np.eye(3), np.array([1.0, 0, 0])), Pairs(place, place, cov, cov))
    assert got == pytest.approx(2 * np.sqrt(GATE_LINE) * np.sqrt(2) * 1e-3 * 5 / 12)


def test_chance_at_a_point_is_that_of_draws():
    pairs, h = seen(sigma=0.01), np.eye(3)
    h[:2, 2] = (pairs.b - pairs.a)[:, :2].mean(axis=0)
    drawn = homography_errors(h, unrelated(pairs, 200_000, 2)) < GATE_POINT
    assert choice.chance_at_point(h, pairs) == pytest.approx(drawn.mean(), rel=0.5)


def test_wrong_partners_that_agree_are_counted():
    agree = np.zeros((6, 6), bool)
    agree[np.arange(6), np.arange(6)] = True  # right ones do not count
    agree[1, 2] = agree[4, 0] = agree[5, 3] = True
    assert choice._with_counted(0.01, agree.ravel(), 6) == 3 / 30
    assert choice._with_counted(0.2, agree.ravel(), 6) == 0.2
    assert choice._with_counted(7.0, agree.ravel(), 6) == 1.0
    pairs = seen(7)
    every = choice._every_couple(pairs)
    assert len(every) == 49
    np.testing.assert_array_equal(every.a.reshape(7, 7, 3), np.broadcast_to(pairs.a[:, None], (7, 7, 3)))
    np.testing.assert_array_equal(every.b.reshape(7, 7, 3), np.broadcast_to(pairs.b[None], (7, 7, 3)))
    assert len(choice._some(seen(choice._COUNTED))) == choice._COUNTED
    many = seen(3 * choice._COUNTED)
    some = choice._some(many)
    assert len(some) == choice._COUNTED
    np.testing.assert_array_equal(some.a[[0, -1]], many.a[[0, -1]])


def test_without_chance_every_pair_counts_and_with_it_more_than_there_are_parameters():
    simple = np.zeros(20, bool)
    simple[:8] = True
    for extra, lone in ((0, False), (1, True)):
        rich = simple | (np.arange(20) < 8 + extra)
        assert choice._more_agree(simple, rich, 3, 0.0) == lone
        assert not choice._more_agree(simple, rich, 3, 1e-6)
    # Four of twelve, in 495 ways, three of them for the model in four, two models: 3960 times the chance of the fourth.
    assert choice._more_agree(simple, np.arange(20) < 12, 3, 0.9e-3 / 3960)
    assert not choice._more_agree(simple, np.arange(20) < 12, 3, 1.1e-3 / 3960)
    assert not choice._more_agree(simple, np.arange(20) < 11, 3, 1e-9)  # three are what three parameters bring
    assert not choice._more_agree(simple, np.arange(20) < 12, 3, 0.3)  # chance alone brings as many
    assert not choice._more_agree(simple, ~simple & (np.arange(20) > 19), 3, 0.0)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("per_point", [0, 1])
def test_the_likelihood_ratio_rejects_a_true_model_once_in_ten_thousand(known, per_point):
    n = 12
    on = np.ones(n + 2, bool)
    on[-2:] = False
    extra, dof = per_point * n + 5, 2 * n - 8
    rich = np.full(n + 2, dof / n * 0.9)
    base = rich[:n].sum()
    limit = stats.chi2.isf(1e-4, extra) if known else stats.f.isf(1e-4, extra, dof) * base / dof * extra
    for part, better in ((0.99, False), (1.01, True)):
        simple = rich + part * limit / n
        simple[-2:] = 1e9  # pairs that do not agree with both say nothing
        assert choice._fits_better(simple, rich, on, 5, -8, 2, known, per_point=per_point) == better


def test_a_known_sigma_that_the_rich_model_belies_is_the_rich_models():
    n, on = 12, np.ones(12, bool)
    dof, extra = 16, 5
    for base, by_chi in ((stats.chi2.isf(0.011, dof), True), (stats.chi2.isf(0.009, dof), False)):
        excess = 1.05 * stats.chi2.isf(1e-4, extra)
        assert excess < stats.f.isf(1e-4, extra, dof) * base / dof * extra
        rich = np.full(n, base / n)
        assert choice._fits_better(rich + excess / n, rich, on, extra, -8, 2, True) == by_chi
    assert not choice._fits_better(np.full(n, 1e9), np.ones(n), on, 0, -8, 2, True)  # no parameter distinguishes them
    few = np.arange(12) < 4  # no freedom is left to estimate a sigma by
    assert not choice._fits_better(np.full(n, 1e9), np.ones(n), few, 5, -8, 2, False)
    assert choice._fits_better(np.full(n, 1e9), np.ones(n), few, 5, -8, 2, True)


def test_points_on_a_line_within_their_noise():
    rng = np.random.default_rng(5)
    along = np.column_stack([np.linspace(-1, 1, 30), 0.3 * np.linspace(-1, 1, 30) + 2.0, np.ones(30)])
    cov = np.tile(1e-6 * np.eye(2), (30, 1, 1))
    for size, line in ((0.5, True), (3.0, False)):
        noisy = along + np.column_stack([size * 1e-3 * rng.normal(size=(30, 2)), np.zeros(30)])
        assert choice.on_a_line(Pairs(noisy, noisy, cov, cov)) == line
        apart = seen(30)
        assert not choice.on_a_line(Pairs(noisy, apart.b, cov, cov))
        assert not choice.on_a_line(Pairs(apart.a, noisy, cov, cov))


@pytest.mark.parametrize(("n", "wrong"), [(9, 0), (9, 1), (10, 2), (12, 3), (60, 2)])
def test_all_ways_to_leave_some_out_or_those_of_the_worst(n, wrong):
    assert [_count(n, k) for k in range(4)] == [comb(n, k) for k in range(4)]
    rng = np.random.default_rng(n)
    pairs = seen(n, sigma=1e-4, seed=3)
    a, b = 500 * pairs.a[:, :2], 500 * pairs.b[:, :2] + rng.normal(0, 0.05, (n, 2))
    odd = [n - 8, n - 5]
    b[odd] += 40.0
    out = [tuple(np.flatnonzero(~kept).tolist()) for kept in _subsets(a, b, wrong, 0.1)]
    assert len(out) == len(set(out)) <= MOST_SETS
    assert {len(o) for o in out} == {wrong}
    if comb(n, wrong) <= MOST_SETS:
        assert sorted(tuple(sorted(o)) for o in out) == sorted(combinations(range(n), wrong))
    else:
        assert tuple(odd) in {tuple(sorted(o)) for o in out}


@pytest.mark.parametrize(("n", "more"), [(8, True), (9, True), (10, False)])
def test_contradictions_ask_for_more_matches_where_these_cannot_name_a_wrong_one(n, more):
    """Two more than the seven parameters have to be left beside the wrong one."""
    rng = np.random.default_rng(2)
    a, b = rng.uniform(0, 500, (2, n, 2))
    found = refine_fundamental(a, b, sigma_px=0.1, most_wrong=1)
    assert not found
    assert "contradict each other" in found.reason
    assert ("with more matches a wrong one can be named" in found.reason) == more
    assert ("leaving out up to" in found.reason) == (not more)


@pytest.mark.parametrize(("part", "there"), [(3.0, True), (0.3, False)])
def test_points_nearly_on_a_line_determine_no_homography(part, there):
    rng = np.random.default_rng(3)
    source = np.column_stack([rng.uniform(-1, 1, 12), part * _FLAT * rng.uniform(-1, 1, 12)])
    found = fit_homography(source, source + np.array([2.0, 1.0]))
    assert (found is not None) == there


def test_epipoles_are_where_all_lines_meet():
    essential = essential_from_poses(POSE)
    for side in (0, 1):
        at = np.append(_epipole(essential, side), 1.0)
        rest = essential @ at if side == 0 else essential.T @ at
        np.testing.assert_allclose(rest, 0.0, atol=1e-9)
    aside = essential_from_poses(Pose(np.eye(3), np.array([1.0, 0, 0])))
    assert not np.isfinite(_epipole(aside, 0)).all() or np.abs(_epipole(aside, 0)).max() > 1e9
