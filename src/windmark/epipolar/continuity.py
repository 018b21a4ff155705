"""The paper's neighbourhood criterion for two views: spots that are neighbours have neighbouring depths.

Inverse depth over the picture is affine for a plane. From the neighbours already matched the inverse depth of a spot
is predicted (Bayesian regression: slopes of a surface are moderate, neighbours scatter about a plane), and a match
that agrees with it has evidence beyond the epipolar distance. A match and all that grows from it so is a *family*;
on a regular pattern families shifted by a pitch exist beside the right one and differ only in how much they explain,
so that whole families are compared, never single matches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

NEIGHBOURS = 12
SLOPE = 1.0
"""1 sigma of a surface's slope: relative change of depth per unit of ideal coordinates (45 degrees)."""
ROUGH = 0.1
"""Neighbours scatter about a plane by this part of their distance."""
GATE = 3.7
CLEAR = 5.0
"""Evidence by which a match is ahead of the next one of its spots when it joins at once."""


@dataclass(frozen=True)
class Pairs:
    """C candidates of two views.

    Parameters
    ----------
    first, second : (C,) spots of the two views, ordered by the first
    inverse, sigma : (C,) inverse depth in the first view and its standard deviation
    gain : (C,) log(p / q) of the epipolar distance
    xy : (M, 2) ideal coordinates of the first view's spots
    span : range of the inverse depths that are possible
    """

    first: Ints
    second: Ints
    inverse: Array
    sigma: Array
    gain: Array
    xy: Array
    span: float

    def sharing(self, some: Ints) -> Mask:
        """(C,) candidates that have a spot of one of these."""
        return np.isin(self.first, self.first[some]) | np.isin(self.second, self.second[some])

    def take(self, kept: Mask) -> Pairs:
        """Some of the candidates."""
        return Pairs(
            self.first[kept], self.second[kept], self.inverse[kept], self.sigma[kept], self.gain[kept], self.xy,
            self.span,
        )  # fmt: skip


@dataclass(frozen=True)
class Family:
    """Matches that support each other.

    Parameters
    ----------
    chosen : (M,) candidate of every spot of the first view, -1 for none
    evidence : (M,) log(p / q) of each match, its neighbours included
    lead : (M,) how far it is ahead of the next candidate of either spot
    """

    chosen: Ints
    evidence: Array
    lead: Array

    @property
    def total(self) -> float:
        """Evidence of all matches."""
        return float(self.evidence[self.chosen >= 0].sum())


def neighbours(xy: Array) -> Ints:
    """(M, k) nearest other spots of each; -1 where there are fewer."""
    out = np.full((len(xy), NEIGHBOURS), -1)
    k = min(NEIGHBOURS, len(xy) - 1)
    if k > 0:
        out[:, :k] = cKDTree(xy).query(xy, k + 1)[1][:, 1:]
    return out


def predict(pairs: Pairs, near: Ints, chosen: Ints, spots: Ints) -> tuple[Array, Array]:
    """Inverse depth (n,) of some spots from their matched neighbours, and its variance; inf without any."""
    around = near[spots]
    member = np.where(around >= 0, chosen[around], -1)
    known = member >= 0
    w, variance = pairs.inverse[member], pairs.sigma[member] ** 2
    offset = np.where(known[..., None], pairs.xy[around] - pairs.xy[spots][:, None], 0.0)
    middle = np.sum(np.where(known, w, 0.0), axis=1) / np.maximum(known.sum(axis=1), 1)
    scatter = variance + (ROUGH * middle[:, None]) ** 2 * (offset**2).sum(axis=-1)
    weight = np.where(known, 1.0 / np.maximum(scatter, 1e-300), 0.0)
    design = np.concatenate([np.ones((*offset.shape[:2], 1)), offset], axis=-1)
    normal = np.einsum("nki,nk,nkj->nij", design, weight, design)
    prior = np.where(middle > 0, 1.0 / (SLOPE * np.maximum(middle, 1e-150)) ** 2, 1.0)
    normal[:, 1, 1] += prior
    normal[:, 2, 2] += prior
    right = np.einsum("nki,nk,nk->ni", design, weight, np.where(known, w, 0.0))
    any_known = known.any(axis=1)
    normal[~any_known] = np.eye(3)
    inverse = np.linalg.inv(normal)
    value = np.einsum("ni,ni->n", inverse[:, 0], right)
    return value, np.where(any_known, inverse[:, 0, 0], np.inf)


def grow_family(pairs: Pairs, near: Ints, start: Ints) -> Family:
    """The family of some candidates: spots next to members take the match that fits, the clearest ones first.

    A match one pitch off fits nearly as well next to the first member, and not at all next to many: what is not clear
    waits. Where nothing is clear the clearest one joins.
    """
    chosen = np.full(len(pairs.xy), -1)
    chosen[pairs.first[start]] = start
    taken = np.zeros(pairs.second.max() + 1, dtype=np.bool_)
    while True:
        open_spots = np.flatnonzero((chosen < 0) & _has_neighbour(near, chosen))
        evidence = _evidence(pairs, near, chosen, open_spots)
        taken[pairs.second[chosen[chosen >= 0]]] = True
        evidence[taken[pairs.second]] = -np.inf
        new = _best_one_to_one(pairs, evidence)
        if not len(new):
            break
        lead = evidence[new] - _next_best(pairs, evidence, new)
        clear = lead > CLEAR
        if not clear.any():
            clear = np.arange(len(new)) == np.argmax(lead)
        chosen[pairs.first[new[clear]]] = new[clear]
    return _judged(pairs, near, chosen)


def _next_best(pairs: Pairs, evidence: Array, members: Ints) -> Array:
    """Evidence of the best other candidate of either spot of the ``members``; at least 0, which is chance."""
    other = evidence.copy()
    other[members] = -np.inf
    first, second = np.zeros(len(pairs.xy)), np.zeros(pairs.second.max(initial=-1) + 1)
    np.maximum.at(first, pairs.first, other)
    np.maximum.at(second, pairs.second, other)
    return np.asarray(np.maximum(first[pairs.first[members]], second[pairs.second[members]]))


def _judged(pairs: Pairs, near: Ints, chosen: Ints) -> Family:
    """Every match tested by its neighbours; those that chance explains better leave."""
    evidence = _evidence(pairs, near, chosen, np.arange(len(chosen)))
    chosen = chosen.copy()
    member = chosen >= 0
    own = np.where(member, evidence[chosen], -np.inf)
    lone = member & ~np.isfinite(own)
    # A match without matched neighbours has its epipolar distance alone.
    own[lone & ~_has_neighbour(near, chosen)] = pairs.gain[chosen[lone & ~_has_neighbour(near, chosen)]]
    chosen[member & ~(own > 0)] = -1
    members = chosen[chosen >= 0]
    lead = np.full(len(chosen), -np.inf)
    lead[chosen >= 0] = own[chosen >= 0] - _next_best(pairs, evidence, members)
    return Family(chosen, np.where(chosen >= 0, own, -np.inf), lead)


def _has_neighbour(near: Ints, chosen: Ints) -> Mask:
    return np.asarray((np.where(near >= 0, chosen[near], -1) >= 0).any(axis=1))


def _evidence(pairs: Pairs, near: Ints, chosen: Ints, spots: Ints) -> Array:
    """(C,) log(p / q) of the candidates of some spots given their neighbours; -inf for all others."""
    out = np.full(len(pairs.first), -np.inf)
    value, variance = np.zeros(len(chosen)), np.full(len(chosen), np.inf)
    value[spots], variance[spots] = predict(pairs, near, chosen, spots)
    mine = np.flatnonzero(np.isfinite(variance[pairs.first]))
    first = pairs.first[mine]
    whole = variance[first] + pairs.sigma[mine] ** 2
    off2 = (pairs.inverse[mine] - value[first]) ** 2 / whole
    bonus = np.log(pairs.span / np.sqrt(2 * np.pi * whole)) - 0.5 * off2
    out[mine] = np.where(off2 < GATE**2, pairs.gain[mine] + bonus, -np.inf)
    return out


def _best_one_to_one(pairs: Pairs, evidence: Array) -> Ints:
    """The candidates with evidence > 0 that are the best of both of their spots."""
    good = np.flatnonzero(evidence > 0)
    good = good[np.argsort(-evidence[good], kind="stable")]
    first = np.unique(pairs.first[good], return_index=True)[1]
    second = np.unique(pairs.second[good], return_index=True)[1]
    return np.asarray(good[np.intersect1d(first, second)])
