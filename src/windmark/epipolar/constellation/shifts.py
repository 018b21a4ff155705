"""Other ways to lay a matched constellation: on a regular layout every neighbour of a spot may take its place.

A matching of a regular block that is shifted by a pitch explains nearly as much as the right one. Such rivals are not
left to chance: they are made, from the layout's own translations, and judged like any other matching.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.epipolar.constellation import patches
from windmark.epipolar.constellation.patches import Neighbours

Ints = NDArray[np.int64]

STEPS = 8
"""Neighbours that take a spot's place, nearest first: those of a square grid."""
MOST = 4
"""Shifts that are given, the largest first."""
LEAST_PART = 0.25
"""Part of a matching's pairs that its shifted rivals have; the layout is not regular where there are none."""


def shifted(near: Neighbours, match: Ints) -> list[Ints]:
    """Up to `MOST` matchings (A,) that grow when a spot in the middle takes the partner of one of its neighbours.

    Parameters
    ----------
    near : the spots and their neighbours
    match : (A,) spot of b for each spot of a, or -1
    """
    from windmark.epipolar.constellation import _kernels as kernels

    known = np.flatnonzero(match >= 0)
    inner = (match[near.na[known]] >= 0).sum(axis=1)
    off = np.linalg.norm(near.a[known] - np.median(near.a[known], axis=0), axis=1)
    middle = int(known[np.lexsort((off, -inner))[0]])
    no_limit = np.zeros((0, 0), np.bool_)
    out: list[Ints] = []
    for step in near.na[middle, :STEPS]:
        around = near.na[step][match[near.na[step]] >= 0]
        if match[step] < 0 or len(around) < 3:
            continue
        slope = np.linalg.pinv(near.a[around] - near.a[step]) @ (near.b[match[around]] - near.b[match[step]])
        if not np.linalg.det(slope) > 0:
            continue
        start = patches.seeded(near, middle, int(match[step]), slope.T)
        grown = kernels.grow(
            near.a, near.na, near.b, near.nb, start, patches.GROW_TOLERANCE, patches.NOISE_PX, no_limit
        )  # fmt: skip
        if (grown >= 0).sum() >= LEAST_PART * len(known):
            out.append(grown)
    return sorted(out, key=lambda m: -(m >= 0).sum())[:MOST]
