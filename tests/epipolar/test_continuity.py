"""Families of matches on a smooth surface: predictions, evidence and rivals, one spot at a time."""

import numpy as np
import pytest

from windmark.epipolar.continuity import (
    GATE,
    NEIGHBOURS,
    ROUGH,
    SLOPE,
    Family,
    Pairs,
    _best_one_to_one,
    _evidence,
    _has_neighbour,
    _judged,
    _next_best,
    grow_family,
    neighbours,
    predict,
)
from windmark.epipolar.given import _fits_itself


def candidates(seed=0, spots=25, each=3):
    """Every spot has the match on a plane and some beside it."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-0.3, 0.3, (spots, 2))
    first = np.repeat(np.arange(spots), each)
    second = rng.integers(0, spots, len(first))
    inverse = 1e-3 * (1 + 0.2 * xy[first, 0]) + np.where(
        np.arange(len(first)) % each, 1e-4 * rng.normal(size=len(first)), 0
    )
    return Pairs(
        first, second, inverse, rng.uniform(1e-6, 1e-5, len(first)), rng.normal(1.0, 2.0, len(first)), xy, 5e-3
    )


@pytest.mark.parametrize("count", [0, 1, 2, NEIGHBOURS, NEIGHBOURS + 1, 40])
def test_neighbours_are_the_nearest_other_spots(count):
    xy = np.random.default_rng(count).uniform(0, 1, (count, 2))
    got = neighbours(xy)
    assert got.shape == (count, NEIGHBOURS)
    for k in range(count):
        others = np.argsort(np.hypot(*(xy - xy[k]).T))[1 : NEIGHBOURS + 1].tolist()
        assert got[k].tolist() == others + [-1] * (NEIGHBOURS - len(others))


def test_predictions_are_planes_through_the_neighbours_with_a_slope_that_is_no_cliff():
    """Weighted least squares with an expected slope, written down for one spot."""
    pairs = candidates()
    near = neighbours(pairs.xy)
    chosen = np.where(np.random.default_rng(1).random(25) < 0.7, np.arange(25) * 3, -1)
    value, variance = predict(pairs, near, chosen, np.arange(25))
    for spot in range(25):
        around = [s for s in near[spot] if s >= 0 and chosen[s] >= 0]
        if not around:
            assert np.isinf(variance[spot])
            continue
        member = chosen[around]
        w, off = pairs.inverse[member], pairs.xy[around] - pairs.xy[spot]
        middle = w.mean()
        weight = 1 / (pairs.sigma[member] ** 2 + (ROUGH * middle) ** 2 * (off**2).sum(axis=1))
        design = np.column_stack([np.ones(len(around)), off])
        normal = design.T @ (weight[:, None] * design) + np.diag([0, 1, 1]) / (SLOPE * middle) ** 2
        cov = np.linalg.inv(normal)
        assert value[spot] == pytest.approx((cov @ design.T @ (weight * w))[0], rel=1e-9)
        assert variance[spot] == pytest.approx(cov[0, 0], rel=1e-9)


def test_evidence_is_that_of_a_normal_law_beside_chance_over_the_span_within_the_gate():
    pairs = candidates()
    near, chosen = neighbours(pairs.xy), np.arange(25) * 3
    spots = np.arange(0, 25, 2)
    value, variance = predict(pairs, near, chosen, spots)
    got = _evidence(pairs, near, chosen, spots)
    within = 0
    for c, spot in enumerate(pairs.first.tolist()):
        if spot not in spots:
            assert got[c] == -np.inf
            continue
        k = spots.tolist().index(spot)
        whole = variance[k] + pairs.sigma[c] ** 2
        z2 = (pairs.inverse[c] - value[k]) ** 2 / whole
        if z2 >= GATE**2:
            assert got[c] == -np.inf
            continue
        within += 1
        law = np.exp(-z2 / 2) / np.sqrt(2 * np.pi * whole)
        assert got[c] == pytest.approx(pairs.gain[c] + np.log(law * pairs.span), rel=1e-9)
    assert 10 < within < len(pairs.first)


@pytest.mark.parametrize("seed", range(3))
def test_the_best_of_both_spots_and_the_next_best(seed):
    pairs = candidates(seed)
    evidence = np.random.default_rng(seed).normal(size=len(pairs.first))

    def rivals(c):
        return [d for d in range(len(evidence)) if d != c
                and (pairs.first[d] == pairs.first[c] or pairs.second[d] == pairs.second[c])]  # fmt: skip

    best = [c for c in range(len(evidence)) if evidence[c] > 0 and all(evidence[d] <= evidence[c] for d in rivals(c))]
    assert sorted(_best_one_to_one(pairs, evidence).tolist()) == best
    members = np.array(best)
    apart = [max([0.0, *(evidence[d] for d in rivals(c) if d not in best)]) for c in best]
    np.testing.assert_allclose(_next_best(pairs, evidence, members), apart)


def test_a_family_sums_the_evidence_of_its_matches():
    """The first candidate of all, too."""
    family = Family(np.array([-1, 0, 4]), np.array([7.0, 2.0, 3.5]), np.zeros(3))
    assert family.total == 5.5


def test_matches_that_chance_explains_better_leave_and_lone_ones_have_their_line():
    pairs = candidates(3)
    near = neighbours(pairs.xy)
    chosen = np.full(25, -1)
    chosen[:] = np.where(np.arange(25) % 5 == 4, -1, np.arange(25) * 3)
    chosen[7] = 7 * 3 + 1  # beside the plane
    family = _judged(pairs, near, chosen)
    evidence = _evidence(pairs, near, chosen, np.arange(25))
    for spot in range(25):
        if chosen[spot] < 0:
            assert family.chosen[spot] == -1
            continue
        stays = evidence[chosen[spot]] > 0
        assert family.chosen[spot] == (chosen[spot] if stays else -1)
        assert family.evidence[spot] == (evidence[chosen[spot]] if stays else -np.inf)
    assert (family.chosen[chosen >= 0] < 0).any()
    alone = np.full(25, -1)
    alone[3] = 9
    lone = _judged(pairs, near, alone)
    assert lone.chosen[3] == (9 if pairs.gain[9] > 0 else -1)
    assert pairs.gain[9] <= 0 or lone.evidence[3] == pairs.gain[9]


def test_the_first_candidate_is_a_neighbour_as_any_other_and_none_is_none():
    near = np.array([[1, -1], [0, 2], [-1, -1]])
    np.testing.assert_array_equal(_has_neighbour(near, np.array([0, -1, -1])), [False, True, False])
    np.testing.assert_array_equal(_has_neighbour(near, np.array([-1, 5, -1])), [True, False, False])


@pytest.mark.parametrize(("gain", "itself"), [(12.0, True), (2.0, False)])
def test_a_pattern_fits_itself_where_a_shift_of_it_has_much_of_its_evidence(gain, itself):
    """Every spot has its own partner, and its neighbour's at another depth; what that says depends on its lines."""
    xy = 0.05 * np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), axis=-1).reshape(-1, 2)
    own = np.arange(30)
    first, shifted = np.repeat(own, 2), np.tile([False, True], 30)
    inverse = np.where(shifted, 3e-3, 1e-3)
    pairs = Pairs(
        first, np.where(shifted, (first + 1) % 30, first), inverse, np.full(60, 1e-5), np.where(shifted, gain, 12.0),
        xy, 1e-4,
    )  # fmt: skip
    near = neighbours(xy)
    family = grow_family(pairs, near, np.array([28]))
    np.testing.assert_array_equal(family.chosen, 2 * own)
    assert (grow_family(pairs, near, np.array([29])).chosen == 2 * own + 1).mean() > 0.8
    assert _fits_itself(pairs, near, family) == itself
