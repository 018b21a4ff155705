"""Which spots of two pictures belong together, by the constellation alone: patches that an affine map explains.

Nothing is known but the spots. Small pieces of a surface look alike in two pictures up to an affine map; so frames of
a spot and two of its neighbours in one picture are laid on all such frames of the other one, those that take most of
the other neighbours onto spots are kept, and from them a matching grows from spot to spot, each predicted by its
matched neighbours, as long as that fits. Parallax ends a patch; the epipolar geometry of all patches together takes
over from there (`match_pair`).

Frames of neighbouring points are those of locally likely arrangement hashing (Nakai, Kise, Iwamura, DAS 2006); the
neighbourhood as evidence is that of AIAA 2005-5007, section VI.D.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NEAR_A, NEAR_B = 12, 20
"""Neighbours that are looked at: those of a spot in a, and the spots of b that may be theirs."""
TESTED = 10
"""Neighbours that test a map."""
ARMS = (5, 7)
"""Nearest neighbours that make frames; more in b, where false spots may push them back."""
SEED_TOLERANCE, GROW_TOLERANCE = 0.08, 0.12
"""How far (as part of the distance) a spot may lie from where a seed's map, and a local fit, say."""
NOISE_PX = 2.0
SCALE, STRETCH = 1.7, 2.0
"""Change of size either way, and ratio of the axes of the imaged circle: some 60 degrees of tilt in one picture."""
LEAST_MET = 7
"""Neighbours of `TESTED`, the two arms among them, that a seed must meet."""
SEED_SPOTS = 250
"""Spots of a that are tried, spread over the picture."""
LN_MET = 3.0
"""What a neighbour that is met says (nats): chance does it in one of twenty."""


@dataclass(frozen=True)
class Neighbours:
    """Spots of two pictures (ideal pixels) and their neighbours, nearest first; ``nb`` are those of b."""

    a: Array
    b: Array
    na: Ints
    nb: Ints

    @classmethod
    def of(cls, a: Array, b: Array) -> Neighbours:
        """Neighbour tables of (A, 2) and (B, 2) spots."""
        return cls(np.ascontiguousarray(a), np.ascontiguousarray(b), _near(a, NEAR_A), _near(b, NEAR_B))

    def swapped(self) -> Neighbours:
        """The same with the pictures exchanged."""
        return Neighbours.of(self.b, self.a)


@dataclass(frozen=True)
class Patches:
    """Matchings that grew from seeds, in no order.

    Parameters
    ----------
    match : (P, A) spot of b for each spot of a, or -1
    tried : maps that were compared to find them
    """

    match: Ints
    tried: int

    def pairs(self) -> tuple[Ints, Array]:
        """(K, 2) pairs of all patches without repetition, and the size of the largest patch that has each."""
        size = (self.match >= 0).sum(axis=1)
        patch, a = np.nonzero(self.match >= 0)
        pairs, where = np.unique(np.stack([a, self.match[patch, a]], axis=1), axis=0, return_inverse=True)
        largest = np.zeros(len(pairs))
        np.maximum.at(largest, where.ravel(), size[patch])
        return pairs.astype(np.int64), largest


def find_patches(near: Neighbours, most: int = 12) -> Patches:
    """Patches grown from the best seeds; a seed that is part of a patch already is not grown again.

    Parameters
    ----------
    near : the spots and their neighbours
    most : patches at most
    """
    from windmark.epipolar.constellation import _kernels as kernels

    nothing = np.zeros((0, len(near.a)), np.int64)
    if min(len(near.a), len(near.b)) < LEAST_MET + 1:
        return Patches(nothing, 0)
    first = _spread(near.a)
    tested = np.ascontiguousarray(near.na[:, :TESTED])
    arms = np.minimum(ARMS, [tested.shape[1], near.nb.shape[1]])
    met, offset, maps, tried = kernels.seed_maps(
        near.a, tested, near.b, near.nb, first, arms, SEED_TOLERANCE, NOISE_PX, SCALE, STRETCH, LEAST_MET
    )  # fmt: skip
    taken = np.zeros(met.shape, np.bool_)
    row = np.full(len(near.a), -1)
    row[first] = np.arange(len(first))
    patches: list[Ints] = []
    no_limit = np.zeros((0, 0), np.bool_)
    for s, q in _ranked(met, offset):
        if taken[s, q]:
            continue
        start = seeded(near, int(first[s]), q, maps[s, q].reshape(2, 2))
        match = kernels.grow(near.a, near.na, near.b, near.nb, start, GROW_TOLERANCE, NOISE_PX, no_limit)
        a = np.flatnonzero((match >= 0) & (row >= 0))
        taken[row[a], match[a]] = taken[s, q] = True
        patches.append(match)
        if len(patches) == most:
            break
    return Patches(np.stack(patches) if patches else nothing, int(tried))


def _ranked(met: Ints, offset: Array) -> list[tuple[int, int]]:
    """Seeds, the most telling first: what they meet, less what equally good partners of the same spots say."""
    s, q = np.nonzero(met >= LEAST_MET)
    good = met >= LEAST_MET
    top_row, top_column = met.max(axis=1, initial=-1)[:, None], met.max(axis=0, initial=-1)[None]
    alike = (good & (met >= top_row - 1)).sum(axis=1)[s] * (good & (met >= top_column - 1)).sum(axis=0)[q]
    value = LN_MET * met[s, q] - np.log(np.maximum(alike, 1)) - offset[s, q] / TESTED
    order = np.argsort(-value, kind="stable")
    return [(int(s[o]), int(q[o])) for o in order]


def seeded(near: Neighbours, p: int, q: int, m: Array) -> Ints:
    """The pairs of one seed: the spot, and its neighbours that the map takes onto spots."""
    match = np.full(len(near.a), -1, np.int64)
    match[p] = q
    arm = near.a[near.na[p, :TESTED]] - near.a[p]
    around = near.nb[q]
    gap = np.linalg.norm((near.b[q] + arm @ m.T)[:, None] - near.b[around][None], axis=2)
    reach = SEED_TOLERANCE * np.linalg.norm(arm, axis=1) * np.sqrt(np.linalg.det(m)) + NOISE_PX
    best = gap.argmin(axis=1)
    for n in np.flatnonzero(gap.min(axis=1) < reach):
        if not (match == around[best[n]]).any():
            match[near.na[p, n]] = around[best[n]]
    return match


def _near(xy: Array, count: int) -> Ints:
    count = min(count, len(xy) - 1)
    if count < 1:
        return np.zeros((len(xy), 0), np.int64)
    return np.ascontiguousarray(cKDTree(xy).query(xy, count + 1)[1][:, 1:], dtype=np.int64)


def _spread(xy: Array) -> Ints:
    """At most `SEED_SPOTS` spots all over the picture, its outermost among them: a corner is like no other place."""
    if len(xy) <= SEED_SPOTS:
        return np.arange(len(xy))
    centred = xy - xy.mean(axis=0)
    angle = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    outer = np.unique((centred @ np.stack([np.cos(angle), np.sin(angle)])).argmax(axis=0))
    rest = np.setdiff1d(np.linspace(0, len(xy) - 1, SEED_SPOTS - len(outer)).astype(int), outer)
    return np.concatenate([outer, np.lexsort((xy[:, 1], xy[:, 0]))[rest]]).astype(np.int64)
