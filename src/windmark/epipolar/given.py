"""Matches that are given, such as clicks: what grows from them, and which of them their neighbours contradict.

On a regular pattern whole families shifted by a pitch explain as much as the right one, or more where part of it is
hidden; how many spots match is no evidence then. Given matches decide between them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.epipolar.continuity import Family, Pairs, grow_family

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

MOST_RIGHT = 0.5
"""Given matches are believed if more than this part of them stands together."""
FOLDS = 16
"""Given matches are judged in so many groups by all others: up to so many one by one."""
LEAD_MATCH = float(np.log(100.0))
"""A match must be so many times likelier than the next one of either spot, and than chance."""
TRIED, LIKE_ITSELF = 3, 0.4
"""Spots in the middle whose other candidates are tried, and the part of a family's evidence that makes another one a
shift of the same pattern."""


def candidates_of(pairs: Pairs, given: Ints) -> Ints:
    """(G,) the candidate that each of the given matches (G, 2) is, -1 where it is none."""
    number = {pair: k for k, pair in enumerate(zip(pairs.first.tolist(), pairs.second.tolist(), strict=True))}
    return np.array([number.get((i, j), -1) for i, j in given.tolist()], np.int64)


def family_of(pairs: Pairs, near: Ints, seeds: Ints) -> tuple[Family, Mask] | None:
    """The family that grows from given candidates (S,), and which of these (S,) its neighbours contradict.

    None where most of them do not stand together: they decide nothing then. Each one is judged by what grows from the
    others: on a regular pattern a wrong one has neighbours that fit to it, too.
    """
    start = seeds[np.sort(np.unique(pairs.first[seeds], return_index=True)[1])]
    start = start[np.sort(np.unique(pairs.second[start], return_index=True)[1])]
    stand = np.ones(len(start), bool)
    for k in range(min(FOLDS, len(start)) if len(start) > 1 else 0):
        left_out = np.arange(len(start)) % FOLDS == k
        stand[left_out] = ~_contradicted(pairs, grow_family(pairs, near, start[~left_out]), start[left_out])
    if not stand.sum() > MOST_RIGHT * len(seeds):
        return None
    family = grow_family(pairs, near, start[stand])
    return family, _contradicted(pairs, family, seeds)


def _contradicted(pairs: Pairs, family: Family, seeds: Ints) -> Mask:
    """Which of some candidates (S,) have a spot that the family clearly matches otherwise."""
    members = family.chosen[(family.chosen >= 0) & (family.lead > LEAD_MATCH)]
    sure = np.full(len(family.chosen), -1)
    sure[pairs.first[members]] = members
    back = np.full(int(pairs.second.max(initial=0)) + 1, -1)
    back[pairs.second[members]] = members
    one, other = sure[pairs.first[seeds]], back[pairs.second[seeds]]
    return np.asarray(((one >= 0) & (one != seeds)) | ((other >= 0) & (other != seeds)))


def left_over(pairs: Pairs, near: Ints, family: Family) -> Mask:
    """(C,) candidates of spots that are not in the family; none where the pattern fits itself when shifted.

    What one picture does not show of the family's surface and what the other does not show of it match there, too.
    """
    if _fits_itself(pairs, near, family):
        return np.zeros(len(pairs.first), bool)
    return ~pairs.sharing(family.chosen[family.chosen >= 0])


def disagrees(pairs: Pairs, members: Ints, seeds: Ints) -> bool:
    """Whether some candidates have a spot of a given one with another partner."""
    return bool((pairs.sharing(seeds)[members] & ~np.isin(members, seeds)).any())


def _fits_itself(pairs: Pairs, near: Ints, family: Family) -> bool:
    """Whether another family has much of the family's evidence, by other matches of the same spots of both pictures."""
    spots = np.flatnonzero(family.chosen >= 0)
    partners = pairs.second[family.chosen[spots]]
    away = np.linalg.norm(pairs.xy[spots] - np.median(pairs.xy[spots], axis=0), axis=1)
    for spot in spots[np.argsort(away, kind="stable")[:TRIED]]:
        for other in np.setdiff1d(np.flatnonzero(pairs.first == spot), family.chosen[spot]):
            shifted = grow_family(pairs, near, np.array([other]))
            where = np.flatnonzero((shifted.chosen >= 0) & (shifted.chosen != family.chosen))
            both = np.isin(where, spots) & np.isin(pairs.second[shifted.chosen[where]], partners)
            if shifted.total > LIKE_ITSELF * family.total and both.sum() > LIKE_ITSELF * len(spots):
                return True
    return False
