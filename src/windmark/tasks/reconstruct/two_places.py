"""Markers that moved between the pictures: each is two, and no picture shows both.

Two markers that are each found at the rate r are seen one without the other in 2 r (1 - r) / (1 - (1 - r)^2) of the
pictures that show either; in all n pictures that should show both, by chance, in the n-th power of that. A single pair
needs many such pictures. What moved as a whole (a flap, a loose plate) leaves many pairs, each in a few pictures only,
but all of them divide the pictures alike and lie alike: together they are no chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import gammaln

from windmark.errors import g3
from windmark.scene import Doubt, MarkerSet
from windmark.tasks.reconstruct.doubts import CHANCE, Sight

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

NEIGHBOURS = 6
"""Nearest markers of each one that may be another place of it."""
LEAST_ALONE = 2
"""Pictures that show one and should show the other, of each of both, below which a pair tells nothing by itself."""
LIKE = 0.5
"""Steps of a group differ from each other by at most this part of them: what turns about a hinge moves unequally."""
SHARED = 2
"""Pictures in which two pairs both show something, from which it is asked whether they divide them alike."""


@dataclass(frozen=True)
class _Pairs:
    """Neighbours that are never in one picture, though pictures of one side show now one, now the other.

    Parameters
    ----------
    first, second : (K,) markers
    log_chance : (K,) logarithm of the chance that two markers are never found together, where both should have been
    least : (K,) the smaller number of those pictures of either
    step : (K, 3) from the first to the second
    reach : (K,) distance in which the first one's neighbours are
    side : (K, V) 1 where a picture shows the first, -1 the second, 0 neither
    count : neighbours that were looked at
    """

    first: Ints
    second: Ints
    log_chance: Array
    least: Ints
    step: Array
    reach: Array
    side: Array
    count: int


def two_places(markers: MarkerSet, sight: Sight) -> list[Doubt]:
    """Neighbouring markers that may be two places of one, as one doubt; none where the pictures are too few to tell."""
    if len(markers) < 2 or not sight.rate > 0:
        return []
    pairs = _exclusive(markers.xyz, sight)
    named = _each(pairs) | _together(pairs)
    return _moved(markers, [(int(pairs.first[k]), int(pairs.second[k])) for k in np.flatnonzero(named)])


def _exclusive(xyz: Array, sight: Sight) -> _Pairs:
    far, near = cKDTree(xyz).query(xyz, min(NEIGHBOURS + 1, len(xyz)))
    every = sorted({(min(i, j), max(i, j)) for i, row in enumerate(near.tolist()) for j in row if i != j})
    found = []
    for i, j in every:
        first, second = sight.seen[:, i], sight.seen[:, j]
        if (first & second).any():
            continue
        of_first = int((first & sight.inside[:, j] & (sight.alike @ second)).sum())
        of_second = int((second & sight.inside[:, i] & (sight.alike @ first)).sum())
        where = sight.place - (xyz[i] + xyz[j]) / 2
        if min(of_first, of_second) and not _apart(where[first & ~second], where[second & ~first]):
            found.append((i, j, of_first, of_second))
    a, b, of_a, of_b = np.array(found, dtype=np.int64).reshape(-1, 4).T
    alone = np.log(max(2 * (1 - sight.rate) / (2 - sight.rate), np.finfo(float).tiny))
    seen = sight.seen.astype(float)
    return _Pairs(
        a, b, alone * (of_a + of_b), np.minimum(of_a, of_b), xyz[b] - xyz[a], far[a, -1],
        (seen[:, a] - seen[:, b]).T, len(every),
    )  # fmt: skip


def _apart(one: Array, other: Array) -> bool:
    """Whether a line parts the directions from which one marker is seen from those of the other: something before them
    hides now one, now the other, and nothing has moved.
    """
    from scipy.optimize import linprog

    way = np.concatenate([one, other])
    way = way / np.linalg.norm(way, axis=1, keepdims=True)
    _, _, axes = np.linalg.svd(way - way.mean(axis=0))
    side = np.r_[np.ones(len(one)), -np.ones(len(other))]
    # side (w x + b) >= 1 for some w, b
    rows = -side[:, None] * np.column_stack([(way - way.mean(axis=0)) @ axes[:2].T, np.ones(len(way))])
    return bool(linprog(np.zeros(3), rows, -np.ones(len(way)), bounds=(None, None)).status == 0)


def _each(pairs: _Pairs) -> Mask:
    """(K,) pairs that are no chance by themselves.

    Of many such pairs so many are named that few of them are chance (Benjamini and Hochberg, J. R. Stat. Soc. B 57,
    1995).
    """
    tells = np.flatnonzero(pairs.least >= LEAST_ALONE)
    order = tells[np.argsort(pairs.log_chance[tells], kind="stable")]
    limit = np.log(CHANCE * np.arange(1, len(order) + 1) / max(pairs.count, 1))
    below = np.flatnonzero(pairs.log_chance[order] < limit)
    out = np.zeros(len(pairs.first), dtype=np.bool_)
    out[order[: below[-1] + 1 if len(below) else 0]] = True
    return out


def _together(pairs: _Pairs) -> Mask:
    """(K,) pairs of groups that are no chance: each divides the pictures, and is displaced, as a first one is.

    A pair is as likely to be never together as by itself, and its step to be like the first one's as a neighbour to be
    in that part of the disc in which neighbours are. Expected number of groups as good among all neighbours, whichever
    is the first and how many follow: the a-contrario number of false alarms (Desolneux, Moisan and Morel, 2000).
    """
    out = np.zeros(len(pairs.first), dtype=np.bool_)
    n = max(pairs.count, 1)
    for s in range(len(pairs.first)):
        like, log_chance = _like(pairs, s)
        order = like[np.argsort(log_chance, kind="stable")]
        more = np.arange(1, len(order) + 1)
        ways = gammaln(n + 1) - gammaln(more + 1) - gammaln(n - more + 1) + 2 * np.log(n)
        if (ways + pairs.log_chance[s] + np.cumsum(np.sort(log_chance)) < np.log(CHANCE)).any():
            out[[s, *order.tolist()]] = True
    return out


def _like(pairs: _Pairs, s: int) -> tuple[Ints, Array]:
    """Pairs that go with one of them, and the logarithm of the chance that each does."""
    both = pairs.side * pairs.side[s]
    shared, agree = np.abs(both).sum(axis=1), both.sum(axis=1)
    size = LIKE * np.linalg.norm(pairs.step[s])
    near = np.linalg.norm(np.sign(agree)[:, None] * pairs.step - pairs.step[s], axis=1) <= size
    apart = (pairs.first != pairs.first[s]) & (pairs.second != pairs.second[s])
    like = np.flatnonzero((shared >= SHARED) & (np.abs(agree) == shared) & near & apart)
    part = np.minimum(size / np.maximum(pairs.reach[like], np.finfo(float).tiny), 1.0)
    return like, pairs.log_chance[like] + 2 * np.log(part)


def _moved(markers: MarkerSet, pairs: list[tuple[int, int]]) -> list[Doubt]:
    """One doubt of all pairs, each marker with the nearest of those it may be."""
    gap = {pair: float(np.linalg.norm(markers.xyz[pair[0]] - markers.xyz[pair[1]])) for pair in pairs}
    taken: dict[int, float] = {}
    for pair in sorted(pairs, key=gap.__getitem__):
        if not taken.keys() & set(pair):
            taken[pair[0]] = taken[pair[1]] = gap[pair]
    kept = [pair for pair in pairs if taken.get(pair[0]) == taken.get(pair[1]) == gap[pair]]
    if not kept:
        return []
    words = ", ".join(f"{{}} and {{}} ({g3(gap[pair])})" for pair in kept)
    names = tuple(str(markers.name[k]) for pair in kept for k in pair)
    said = f"neighbours never in one picture, as if a marker had moved meanwhile (gaps in the markers' unit): {words}"
    return [Doubt(names, said, "marker")]
