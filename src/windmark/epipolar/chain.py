"""Matchings of pairs of pictures joined to tracks over all pictures, wrong links cut."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.epipolar._kernels.merge import JOINED, OUTVOTED, SHARED_VIEW, merge
from windmark.errors import UsageError
from windmark.scene import Tracks

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

CUT = {
    SHARED_VIEW: "two spots of one picture in a track",
    OUTVOTED: "more links speak against it than for it",
}
"""Why a link was cut."""


@dataclass(frozen=True)
class PairLinks:
    """Which spots of two views are one marker.

    Parameters
    ----------
    view_a, view_b : the views
    spot_a, spot_b : (K,) spots of each, one to one
    weight : (K,) trust in each link, > 0; None for one each
    """

    view_a: int
    view_b: int
    spot_a: Ints
    spot_b: Ints
    weight: Array | None = None


@dataclass(frozen=True)
class Chain:
    """Tracks from pairs, and what did not fit.

    Parameters
    ----------
    tracks : the tracks, numbered from 0; within a track in the order of the views
    links : (L, 4) view_a, spot_a, view_b, spot_b of all links that were given
    closed, broken : (L,) triplets that confirm each link, and contradictions that it is part of (three links in a row
        from one to another spot of a view)
    cut : (L,) links that are in no track: `JOINED` (0) or a key of `CUT`
    """

    tracks: Tracks
    links: Ints
    closed: Ints
    broken: Ints
    cut: Ints

    @property
    def unconfirmed(self) -> int:
        """Links in tracks that no triplet confirms."""
        return int(((self.cut == JOINED) & (self.closed == 0)).sum())

    def report(self) -> str:
        """One line for the user."""
        words = [f"{int((self.cut == key).sum())} cut ({why})" for key, why in CUT.items() if (self.cut == key).any()]
        count = len(np.unique(self.tracks.track))
        return "; ".join([f"{count} tracks from {len(self.links)} links, {self.unconfirmed} unconfirmed", *words])


def chain(count: ArrayLike, pairs: Sequence[PairLinks], *, min_views: int = 2) -> Chain:
    """Join links of pairs of views to tracks.

    A link is confirmed by every third view in which both of its spots are linked with the same spot; where they are
    linked with different ones, all three links are part of a contradiction. Links are taken up in the order of
    confirmations less contradictions, then of their weight: two tracks are joined where they have no view in common
    and the links between them outweigh those that lead from one to another spot of the other's views. What is left
    over is cut. Views may come in any order and may be useless.

    Parameters
    ----------
    count : (V,) number of spots of each view
    pairs : links of pairs of views; no pair twice
    min_views : shorter tracks are left out

    Raises
    ------
    ValueError
        Indices that do not exist, a pair of views given twice, links that are not one to one, weights <= 0.
    """
    sizes = np.asarray(count, dtype=np.int64)
    start = np.cumsum(sizes) - sizes
    if min_views < 2:
        raise UsageError(f"chain: min_views must be 2 or more, got {min_views}")
    links, first, second, weight = _table(sizes, start, pairs)
    view = np.repeat(np.arange(len(sizes)), sizes)
    shape = (len(view), len(sizes))
    partner, number, trust = np.full(shape, -1), np.full(shape, -1), np.zeros(shape)
    for s, t in ((first, second), (second, first)):
        partner[s, view[t]], number[s, view[t]], trust[s, view[t]] = t, np.arange(len(s)), weight
    closed, broken = _triplets(partner, number, first, second)
    order = np.lexsort((-weight, broken - closed))
    track, members = np.empty(len(view), dtype=np.int64), np.empty_like(partner)
    cut = np.zeros(len(first), dtype=np.int64)
    merge(first, second, order, partner, trust, view, track, members, cut)
    return Chain(_tracks(members, start, min_views), links, closed, broken, cut)


def _table(sizes: Ints, start: Ints, pairs: Sequence[PairLinks]) -> tuple[Ints, Ints, Ints, Array]:
    """All links: (L, 4) as given; first and second spot counted over all views; weights."""
    given: set[frozenset[int]] = set()
    links, weights = [np.zeros((0, 4), dtype=np.int64)], [np.zeros(0)]
    for pair in pairs:
        a, b = int(pair.view_a), int(pair.view_b)
        name = f"chain: views {a} and {b}"
        if not (0 <= a < len(sizes) and 0 <= b < len(sizes)) or a == b:
            raise ValueError(f"{name}: expected two different views of 0 ... {len(sizes) - 1}")
        if frozenset((a, b)) in given:
            raise ValueError(f"{name} are given twice")
        given.add(frozenset((a, b)))
        s, t = np.asarray(pair.spot_a, dtype=np.int64), np.asarray(pair.spot_b, dtype=np.int64)
        w = np.ones(len(s)) if pair.weight is None else np.asarray(pair.weight, dtype=float)
        if not s.shape == t.shape == w.shape or s.ndim != 1:
            raise ValueError(f"{name}: spot_a, spot_b and weight must have the same length")
        for spots, v in ((s, a), (t, b)):
            if len(spots) and not (spots.min() >= 0 and spots.max() < sizes[v]):
                raise ValueError(f"{name}: spots of view {v} must be 0 ... {sizes[v] - 1}")
            if len(np.unique(spots)) != len(spots):
                raise ValueError(f"{name}: a spot of view {v} is linked twice")
        if not (w > 0).all():
            raise ValueError(f"{name}: weight must be > 0")
        links.append(np.stack([np.full(len(s), a), s, np.full(len(s), b), t], axis=1))
        weights.append(w)
    table = np.concatenate(links)
    return table, start[table[:, 0]] + table[:, 1], start[table[:, 2]] + table[:, 3], np.concatenate(weights)


def _triplets(partner: Ints, number: Ints, first: Ints, second: Ints) -> tuple[Ints, Ints]:
    """(L,) third views that confirm each link, and contradictions (three links in a row) it is part of.

    ``partner`` and ``number`` (S, V) are the spot that each is linked with in every view and the link's number.
    """
    closed, broken = np.zeros(len(first), dtype=np.int64), np.zeros(len(first), dtype=np.int64)
    for third, link in zip(partner.T, number.T, strict=True):
        a, b = third[first], third[second]
        both = (a >= 0) & (b >= 0)
        closed += both & (a == b)
        clash = both & (a != b)
        broken += clash
        np.add.at(broken, link[first[clash]], 1)
        np.add.at(broken, link[second[clash]], 1)
    return closed, broken


def _tracks(members: Ints, start: Ints, min_views: int) -> Tracks:
    rows = members[(members >= 0).sum(axis=1) >= min_views]
    track, view = np.nonzero(rows >= 0)
    return Tracks(track, view, rows[track, view] - start[view])
