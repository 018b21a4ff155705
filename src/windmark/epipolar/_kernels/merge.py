"""Spots joined to tracks, the best supported link first, as long as the links between two tracks do not contradict."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

JOINED, SHARED_VIEW, OUTVOTED = 0, 1, 2
"""What became of a link: in a track; it would put two spots of one view into a track; more links speak against it."""


@nb.njit(cache=True, nogil=True)
def merge(
    first: Ints, second: Ints, order: Ints, partner: Ints, weight: Array, view: Ints, track: Ints, members: Ints,
    fate: Ints,
) -> None:  # fmt: skip
    """Join the spots of links ``first``, ``second`` (L,), in the given ``order``.

    ``partner`` and ``weight`` (S, V) are the spot that each is linked with in every view (-1: none) and that link's
    weight; ``view`` (S,). Results: ``track`` (S,), ``members`` (S, V) the spots of each track, ``fate`` (L,). A track
    keeps the number of one of its spots.
    """
    views = partner.shape[1]
    for s in range(len(view)):
        track[s] = s
        for v in range(views):
            members[s, v] = -1
        members[s, view[s]] = s
    for link in order:
        a, b = track[first[link]], track[second[link]]
        if a == b:
            continue
        fate[link] = JOINED
        votes = 0.0
        for v in range(views):
            t = members[b, v]
            if t < 0:
                continue
            if members[a, v] >= 0:
                fate[link] = SHARED_VIEW
                break
            for u in range(views):
                s = members[a, u]
                if s < 0:
                    continue
                if partner[s, v] == t:
                    votes += weight[s, v]
                else:
                    if partner[s, v] >= 0:
                        votes -= 0.5 * weight[s, v]
                    if partner[t, u] >= 0:
                        votes -= 0.5 * weight[t, u]
        if fate[link] == JOINED and votes <= 0.0:
            fate[link] = OUTVOTED
        if fate[link] != JOINED:
            continue
        for v in range(views):
            if members[b, v] >= 0:
                members[a, v] = members[b, v]
                track[members[b, v]] = a
                members[b, v] = -1
    for link in range(len(first)):
        if track[first[link]] == track[second[link]]:
            fate[link] = JOINED
        elif fate[link] == JOINED:
            fate[link] = OUTVOTED
