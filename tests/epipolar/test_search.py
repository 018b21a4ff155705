"""Points from pairs: what the search counts, and with whom it pairs."""

from itertools import combinations
from math import comb, log

import numpy as np
import pytest

from windmark.epipolar._kernels.grow import AMBIGUOUS, NONE, OUTSIDE
from windmark.epipolar.search import SEEDS, _best_of_pairs, all_pairs, candidates, first_pairs, share_cost
from windmark.epipolar.views import ideal_spots, raster, stations
from windmark.geometry import Camera, Pose
from windmark.scene import Detections


@pytest.mark.parametrize("seed", range(4))
def test_not_knowing_how_often_a_point_is_seen_costs_all_shares_alike(seed):
    rng = np.random.default_rng(seed)
    rows = rng.choice([4, NONE, AMBIGUOUS, OUTSIDE], (30, 7), p=[0.4, 0.3, 0.15, 0.15])
    rows[:, :2] = 1  # the pair
    expected = []
    for row in rows[:, 2:].tolist():
        able = [r for r in row if r not in (AMBIGUOUS, OUTSIDE)]
        k, n = sum(r >= 0 for r in able), len(able)
        expected.append(log((n + 1) * comb(n, k)))
    np.testing.assert_allclose(share_cost(rows), expected, atol=1e-9)
    # All ways in which n views may or may not have a spot have one probability together.
    n = 5
    ways = [
        np.r_[1, 1, np.where(np.isin(np.arange(n), c), 1, NONE)]
        for k in range(n + 1)
        for c in combinations(range(n), k)
    ]
    assert np.exp(-share_cost(np.array(ways))).sum() == pytest.approx(1.0)


def test_the_best_of_every_pair_are_kept():
    rng = np.random.default_rng(1)
    pair = rng.choice([3, 8, 11], 500, p=[0.7, 0.25, 0.05])
    gain = rng.normal(size=500)
    kept = _best_of_pairs(pair, gain)
    assert len(set(kept.tolist())) == len(kept)
    for p in (3, 8, 11):
        mine = np.sort(gain[pair == p])[::-1]
        np.testing.assert_allclose(np.sort(gain[kept[pair[kept] == p]])[::-1], mine[:SEEDS])


def ring(views):
    """Cameras side by side that look at one place."""
    poses = [Pose.look_at([200.0 * k, 0, 0], [0, 0, 1500.0], [0, -1.0, 0]) for k in range(views)]
    return Pose(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))


CAMERA = Camera((640, 480), 800.0)


@pytest.mark.parametrize("views", [3, 4, 9])
def test_every_view_is_paired_with_its_neighbour_and_some_farther_away(views):
    assert {tuple(p) for p in all_pairs(views).tolist()} == set(combinations(range(views), 2))
    stand, _ = stations((CAMERA,) * views, ring(views), np.zeros((views, 6, 6)), None, None)
    pairs = first_pairs(stand).tolist()
    assert sorted({tuple(p) for p in pairs}) == [tuple(p) for p in pairs]
    assert all(a < b for a, b in pairs)
    for v, order in enumerate(stand.order):
        partners = {a + b - v for a, b in pairs if v in (a, b)}
        assert order[1] in partners
        assert partners & {*order[(views - 1) // 2 :].tolist()}  # of the farther half
    assert len(pairs) <= 3 * views


def test_candidates_are_all_pairs_on_one_line_however_many_there_are():
    """Every spot of one picture is on the epipolar line of every one of the other."""
    count = 70
    poses = Pose(np.tile(np.eye(3), (2, 1, 1)), np.array([[0.0, 0, 0], [-100, 0, 0]]))
    rng = np.random.default_rng(5)
    spots = [Detections.make(np.stack([rng.uniform(*ends, count), np.full(count, 240.0)], axis=1))
             for ends in ((400, 600), (100, 300))]  # fmt: skip
    stand, depth = stations((CAMERA,) * 2, poses, np.zeros((2, 6, 6)), (10.0, np.inf), None)
    xy, cov = ideal_spots(spots, (CAMERA,) * 2)
    free = np.ones(2 * count, bool)
    free[3] = False
    found, gain = candidates(stand, raster(xy, cov, np.array([count] * 2), free), free, all_pairs(2), 4.0, depth)
    assert len(found) > 4 * 2 * count + 1000  # more than there is room for at first
    assert {tuple(f) for f in found.tolist()} == {
        (a, b) for a in range(count) if a != 3 for b in range(count, 2 * count)
    }
    assert np.isfinite(gain).all()
