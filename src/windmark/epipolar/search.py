"""Points from spots: hypotheses from pairs, grown through all views, chosen by their evidence, until none is left.

The evidence of a point is log(p / q) summed over its spots: p is the density of a spot there when it is the point's
image (Gaussian, with the covariances of spot, pose and point so far), q that of spots by chance, counted among the
spots that are still free. How often a point is seen where it might be is not known: every share counts alike, which
costs log((n + 1) C(n, k)) for k spots in n pictures beside the pair. Under chance the expectation of exp(evidence) is
at most one per hypothesis, so that (number of hypotheses) exp(-evidence) bounds the expected number of false points
from above (the idea of counting them: Desolneux, Moisan and Morel 2000).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from windmark.epipolar._kernels.arrays import Spots, Stations
from windmark.epipolar._kernels.choose import ACCEPTED, TIED, choose
from windmark.epipolar._kernels.grow import AMBIGUOUS, OUTSIDE, grow_points
from windmark.epipolar._kernels.pairs import pair_candidates
from windmark.epipolar.views import raster

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

PARTNERS = 3
"""Views that each view is paired with at first, near ones and far ones; then all, with the spots that are left."""
ROUNDS = 8
"""Times that the spots which are left are looked through, at most."""
ROUGH_ROUNDS, ENOUGH = 3, 20
"""The same where the points only have to serve the poses, and the links that every view should have for that."""
SEEDS = 100
"""There of every pair of views only so many candidates with the best log(p / q): next to the line, few others near."""
PATIENCE = 4
"""There a hypothesis is given up when so many more views have no spot than have one."""


@dataclass(frozen=True)
class Criteria:
    """What makes a point.

    Parameters
    ----------
    gate : a spot is near a prediction within so many standard deviations
    min_views : least number of spots of a point
    max_nfa : largest expected number of false points
    lead : evidence by which a point must be ahead of a rival for its spots
    rough : the points only serve to improve the poses: ``max_nfa`` holds per spot, and not all are looked for
    """

    gate: float
    min_views: int
    max_nfa: float
    lead: float
    rough: bool


@dataclass(frozen=True)
class Found:
    """T points.

    Parameters
    ----------
    rows : (T, V) spot of each point in every view, negative for none
    xyz, cov : (T, 3), (T, 3, 3)
    log_nfa : (T,) natural logarithm of the expected number of false points with such evidence
    met : (S,) spots that are on the epipolar line of another free one at the end
    tied : (S,) spots of points that were no better than a rival at the end
    """

    rows: Ints
    xyz: Array
    cov: Array
    log_nfa: Array
    met: Mask
    tied: Mask


def find_points(
    stations: Stations, xy: Array, cov: Array, count: Ints, usable: Mask, depth: Array, criteria: Criteria
) -> Found:
    """All points of the spots.

    Parameters
    ----------
    stations : the views
    xy, cov : (S, 2), (S, 3) ideal coordinates of all spots, view after view
    count : (V,) number of spots of each view
    usable : (S,) spots that take part
    depth : (V,) where the poses' uncertainty is judged before a point's depth is known
    criteria : what makes a point
    """
    free = usable.copy()
    kept: list[Found] = []
    few, every = first_pairs(stations), all_pairs(len(count))
    stages = [(few, ROUGH_ROUNDS)] if criteria.rough else [(few, ROUNDS), (every, ROUNDS)]
    for pairs, rounds in stages:
        for _ in range(rounds):
            new = _one_round(stations, raster(xy, cov, count, free), free, pairs, depth, criteria)
            kept.append(new)
            if not len(new.rows):
                break
            free[new.rows[new.rows >= 0]] = False
            if criteria.rough and (sum((f.rows >= 0).sum(axis=0) for f in kept) >= ENOUGH).all():
                break
    rows, xyz, cov_xyz, log_nfa = (
        np.concatenate([getattr(f, name) for f in kept]) for name in ("rows", "xyz", "cov", "log_nfa")
    )
    return Found(rows, xyz, cov_xyz, log_nfa, kept[-1].met, kept[-1].tied)


def all_pairs(views: int) -> Ints:
    """(P, 2) pairs of views."""
    return np.stack(np.triu_indices(views, 1), axis=1)


def first_pairs(stations: Stations) -> Ints:
    """Each view with the nearest one and with ones farther away: (P, 2), every pair once."""
    views = len(stations.near)
    rank = np.unique(np.round(np.geomspace(1, max(1, (views - 1) / 2), PARTNERS)).astype(int))
    pairs = {(min(a, int(b)), max(a, int(b))) for a in range(views) for b in stations.order[a, rank]}
    return np.array(sorted(pairs))


def candidates(
    stations: Stations, spots: Spots, free: Mask, pairs: Ints, gate: float, depth: Array
) -> tuple[Ints, Array]:
    """Pairs of spots (C, 2) near each other's epipolar line, and their log(p / q) (C,)."""
    room = 4 * int(free.sum()) + 1000
    while True:
        found, gain = np.empty((room, 2), dtype=np.int64), np.empty(room)
        count = pair_candidates(stations, spots, free, pairs, gate**2, depth, found, gain)
        if count <= room:
            return found[:count], gain[:count]
        room = count


def grown(
    stations: Stations, spots: Spots, free: Mask, found: Ints, gate: float, patience: int
) -> tuple[Ints, Array, Array, Array]:
    """Rows (C, V), coordinates, covariances and log(p / q) without that of the pair, of the pairs ``found`` (C, 2).

    Best first, as `grow_points` wants them; -inf of pairs without a point or with the same points as others. A pair is
    given up when, at first sight, more than ``patience`` more views have no spot for it than have one.
    """
    rows = np.full((len(found), len(stations.near)), -1, dtype=np.int64)
    each, first, second = np.arange(len(found)), found[:, 0], found[:, 1]
    rows[each, spots.views[first]] = first
    rows[each, spots.views[second]] = second
    xyz, cov, gain = np.empty((len(found), 3)), np.empty((len(found), 3, 3)), np.empty(len(found))
    grow_points(stations, spots, free, rows, spots.views[first], gate**2, patience, xyz, cov, gain)
    return rows, xyz, cov, gain


def _best_of_pairs(pair: Ints, gain: Array) -> Ints:
    """The `SEEDS` largest gains of each pair of views, whose number is ``pair`` (C,)."""
    order = np.lexsort((-gain, pair))
    place = np.arange(len(pair)) - np.searchsorted(pair[order], pair[order])
    return np.asarray(order[place < SEEDS])


def share_cost(rows: Ints) -> Array:
    """What it costs not to know how often a point is seen, for each row.

    The pair is what is tested; of the n other views that the point may be seen in k have a spot: log((n + 1) C(n, k)).
    """
    k = (rows >= 0).sum(axis=1) - 2
    n = ((rows != OUTSIDE) & (rows != AMBIGUOUS)).sum(axis=1) - 2
    k, n = np.maximum(k, 0), np.maximum(n, 0)
    return np.asarray(np.log(n + 1.0) + gammaln(n + 1.0) - gammaln(k + 1.0) - gammaln(n - k + 1.0))


def _one_round(stations: Stations, spots: Spots, free: Mask, pairs: Ints, depth: Array, criteria: Criteria) -> Found:
    """The points that stand out among the free spots."""
    found, pair_gain = candidates(stations, spots, free, pairs, criteria.gate, depth)
    if criteria.rough:
        best = _best_of_pairs(spots.views[found] @ np.array([len(stations.near), 1]), pair_gain)
        found, pair_gain = found[best], pair_gain[best]
    promising = np.argsort(-pair_gain, kind="stable")
    found, pair_gain = found[promising], pair_gain[promising]
    rows, xyz, cov, gain = grown(
        stations, spots, free, found, criteria.gate, PATIENCE if criteria.rough else len(stations.near)
    )
    evidence = gain + pair_gain - share_cost(rows)
    count = np.add.reduceat(free, spots.start[:-1], dtype=float) * (np.diff(spots.start) > 0)
    tests = 2 * len(pairs) / len(count) if criteria.rough else count[pairs[:, 0]].sum()
    log_tests = float(np.log(max(tests, 1.0)))
    score = np.where((rows >= 0).sum(axis=1) >= criteria.min_views, evidence, -np.inf)
    owner, verdict = np.full(len(spots.views), -1), np.zeros(len(rows), dtype=np.int64)
    order = np.argsort(-score, kind="stable")
    choose(rows, score, order, log_tests - float(np.log(criteria.max_nfa)), criteria.lead, owner, verdict)
    good, lost = verdict == ACCEPTED, rows[verdict == TIED]
    met, tied = np.zeros(len(owner), dtype=np.bool_), np.zeros(len(owner), dtype=np.bool_)
    met[found.ravel()] = True
    tied[lost[lost >= 0]] = True
    return Found(rows[good], xyz[good], cov[good], log_tests - evidence[good], met, tied)
