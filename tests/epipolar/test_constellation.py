"""Seeds and growth of matchings by constellation, against slow twins and the truth."""

import constellation_twins as twins
import numpy as np
import pytest
from scipy import stats

from windmark.epipolar.constellation import _kernels as kernels
from windmark.epipolar.constellation.evidence import FREE, MISSING, weigh
from windmark.epipolar.constellation.patches import (
    GROW_TOLERANCE,
    LEAST_MET,
    LN_MET,
    NEAR_A,
    NEAR_B,
    NOISE_PX,
    TESTED,
    Neighbours,
    _ranked,
    find_patches,
)

NO_LIMIT = np.zeros((0, 0), np.bool_)


def plane(seed, n=40, noise=0.1, missing=3):
    """Random spots and their images under an affine map, some missing on either side, some false."""
    rng = np.random.default_rng(seed)
    a = rng.uniform(0, 1000, (n, 2))
    turn = rng.uniform(0, 2 * np.pi)
    m = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ [[1.1, 0.1], [0.0, 0.8]]
    b = a @ m.T + [300, -200] + rng.normal(0, noise, a.shape)
    order = rng.permutation(n)[missing:]
    truth = np.full(n, -1)
    truth[order] = np.arange(len(order))
    return a, np.concatenate([b[order], rng.uniform(b.min(axis=0), b.max(axis=0), (missing, 2))]), truth, m


def test_seed_maps_are_those_of_the_slow_twin():
    a, b, _, _ = plane(1, 14)
    near = Neighbours.of(a, b)
    na, nb, first = near.na[:, :8].copy(), near.nb[:, :10].copy(), np.array([0, 5, 9])
    limits = (0.08, 2.0, 1.7, 2.0, 6)
    met, offset, maps, tried = kernels.seed_maps(near.a, na, near.b, nb, first, np.array([4, 5]), *limits)
    slow = twins.seed_maps(
        near.a, na, near.b, nb, first, (4, 5), *limits, kernels.SHARPEST, kernels.WITHIN
    )  # fmt: skip
    np.testing.assert_array_equal(met, slow[0])
    assert (met >= 6).any()
    assert tried == slow[3]
    np.testing.assert_allclose(offset[met >= 0], slow[1][met >= 0])
    np.testing.assert_allclose(maps[met >= 0], slow[2][met >= 0], atol=1e-9)


def test_predictions_are_those_of_the_slow_twin():
    a, b, truth, _ = plane(2)
    near, out = Neighbours.of(a, b), np.empty(3)
    match = np.where(np.random.default_rng(0).random(len(a)) < 0.5, truth, -1)
    fitted = 0
    for i in range(len(a)):
        n = kernels.predict(near.a, near.na, near.b, match, i, out)
        slow = twins.predict(near.a, near.na, near.b, match, i, kernels.NEIGHBOURS)
        assert (n >= 0) <= (slow is not None)
        if n >= 0:
            fitted += 1
            np.testing.assert_allclose(out, slow, atol=1e-6)
    assert fitted > 20


@pytest.mark.parametrize("seed", range(4))
def test_a_plane_is_matched_whole_at_any_roll(seed):
    a, b, truth, _ = plane(10 + seed, 60)
    patches = find_patches(Neighbours.of(a, b))
    best = patches.match[(patches.match >= 0).sum(axis=1).argmax()]
    assert (best != truth)[best >= 0].sum() <= 1  # a false spot may lie where a missing one would be
    assert (best >= 0).sum() >= 0.9 * (truth >= 0).sum()


def test_growth_stays_within_what_is_allowed_and_is_one_to_one():
    a, b, truth, _ = plane(3, 60)
    near = Neighbours.of(a, b)
    start = np.where(np.arange(60) < 12, truth, -1)
    free = kernels.grow(near.a, near.na, near.b, near.nb, start, 0.12, 2.0, NO_LIMIT)
    assert len(np.unique(free[free >= 0])) == (free >= 0).sum()
    allowed = np.ones((60, len(b)), np.bool_)
    barred = truth[np.flatnonzero((truth >= 0) & (start < 0))[:10]]
    allowed[:, barred] = False
    some = kernels.grow(near.a, near.na, near.b, near.nb, start, 0.12, 2.0, allowed)
    assert np.isin(barred, free).any()
    assert not np.isin(barred, some).any()


def test_a_wrong_pair_among_right_ones_leaves():
    a, b, truth, _ = plane(4, 60)
    near, start = Neighbours.of(a, b), truth.copy()
    wrong = int(np.flatnonzero(truth >= 0)[7])
    start[wrong] = len(b) - 1  # a false spot
    grown = kernels.grow(near.a, near.na, near.b, near.nb, start, 0.12, 2.0, NO_LIMIT)
    assert grown[wrong] != len(b) - 1


def test_evidence_counts_right_pairs_and_what_is_missing():
    a, b, truth, _ = plane(5, 60)
    near = Neighbours.of(a, b)

    def everywhere(xy):
        return np.ones(len(xy), np.bool_)

    whole = weigh(near, truth, np.inf, everywhere, 1000)
    half = weigh(near, np.where(np.arange(60) % 2, truth, -1), np.inf, everywhere, 1000)
    assert whole.log10_nfa < half.log10_nfa < 3
    assert whole.score > half.score
    nothing = weigh(near, np.full(60, -1), np.inf, everywhere, 1000)
    assert nothing.log10_nfa == np.inf
    assert nothing.score == 0


@pytest.mark.parametrize("count", [0, 1, 5])
def test_few_spots_give_no_patches(count):
    a, b, _, _ = plane(6)
    assert not len(find_patches(Neighbours.of(a[:count], b)).match)
    assert not len(find_patches(Neighbours.of(a, b[:count])).match)


def test_seeds_are_ranked_by_what_they_meet_less_what_equally_good_ones_say():
    rng = np.random.default_rng(4)
    met, offset = rng.integers(-1, 11, (9, 12)), rng.uniform(0, 8, (9, 12))
    value = {}
    for s, q in zip(*np.nonzero(met >= LEAST_MET), strict=True):
        row = sum(m >= max(LEAST_MET, met[s].max() - 1) for m in met[s])
        column = sum(m >= max(LEAST_MET, met[:, q].max() - 1) for m in met[:, q])
        value[s, q] = LN_MET * met[s, q] - np.log(max(row * column, 1)) - offset[s, q] / TESTED
    got = _ranked(met, offset)
    assert set(got) == set(value)
    assert [value[k] for k in got] == sorted(value.values(), reverse=True)
    assert not _ranked(np.full((3, 4), LEAST_MET - 1), np.zeros((3, 4)))


def test_planes_far_apart_are_patches_of_their_own_and_pairs_know_their_largest_patch():
    one, two = plane(30, 60), plane(31, 60)
    a = np.concatenate([one[0], two[0] + [3000.0, 0.0]])  # no map takes one onto the other
    b = np.concatenate([one[1], two[1] + [0.0, 5000.0]])
    found = find_patches(Neighbours.of(a, b))
    rows = [tuple(row) for row in found.match.tolist()]
    size = (found.match >= 0).sum(axis=1)
    large = found.match[size > 30] >= 0
    assert {(bool(m[:60].any()), bool(m[60:].any())) for m in large} == {(True, False), (False, True)}
    assert len(find_patches(Neighbours.of(a, b), most=1).match) == 1
    pairs, largest = found.pairs()
    assert len({tuple(p) for p in pairs.tolist()}) == len(pairs)
    for (i, k), most in zip(pairs.tolist(), largest, strict=True):
        assert most == max(size[p] for p in range(len(rows)) if rows[p][i] == k)
    assert sorted({(i, k) for row in rows for i, k in enumerate(row) if k >= 0}) == [tuple(p) for p in pairs.tolist()]


@pytest.mark.parametrize("width", [np.inf, 3.0])
def test_evidence_is_chance_of_the_hits_and_what_hits_and_misses_say(width):
    """Eight pairs say nothing; chance is the area where a spot may lie times the density; the rest is binomial."""
    a, b, truth, _ = plane(7, 60)
    near = Neighbours.of(a, b)
    match = np.where(np.arange(60) % 4 == 1, -1, truth)
    match[np.flatnonzero(truth == 0)] = 0  # also the first spot of b counts
    place = kernels.expectations(near.a, near.na, near.b, near.nb, match, GROW_TOLERANCE, NOISE_PX)

    def inside(xy):
        return xy[:, 0] > np.median(b[:, 0]) - 300

    got = weigh(near, match, width, inside, 500)
    known = np.isfinite(place[:, 0])
    expected = known & inside(np.where(known[:, None], place[:, :2], -1e9))
    np.testing.assert_array_equal(got.expected, expected)
    far = np.sort(np.linalg.norm(b[:, None] - b[None], axis=2), axis=1)[:, near.nb.shape[1]]
    density = np.median(near.nb.shape[1] / (np.pi * far**2))
    chance, gain, hits = [], 0.0, 0
    for k in np.flatnonzero(expected):
        reach = place[k, 2]
        area = np.pi * reach**2 if reach < width else min(4 * width * reach, np.pi * reach**2)
        p = min(max(area * density, 1e-6), 0.5)
        chance.append(p)
        hits += match[k] >= 0
        gain += np.log((1 - MISSING) / p) if match[k] >= 0 else np.log(MISSING / (1 - p))
    assert got.score == pytest.approx(gain, rel=1e-9)
    tail = stats.binom.logsf(hits - FREE - 1, len(chance) - FREE, np.mean(chance))
    assert got.log10_nfa == pytest.approx((np.log(500) + tail) / np.log(10), rel=1e-9)
    some = np.flatnonzero(expected & (match >= 0))
    few = np.full(60, -1)
    few[some[:FREE]] = match[some[:FREE]]
    assert weigh(near, few, width, inside, 500).log10_nfa == np.inf


@pytest.mark.parametrize("count", [1, 2, 9, 40])
def test_neighbours_are_the_nearest_other_spots_of_the_same_picture(count):
    a, b = np.random.default_rng(count).uniform(0, 100, (2, count, 2))
    near = Neighbours.of(a, b)
    for xy, table, most in ((a, near.na, NEAR_A), (b, near.nb, NEAR_B)):
        nearest = np.linalg.norm(xy[:, None] - xy[None], axis=2).argsort(axis=1)[:, 1 : most + 1]
        np.testing.assert_array_equal(table, nearest)
