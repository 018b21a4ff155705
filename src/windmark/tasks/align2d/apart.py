"""Parts of the model that moved by themselves: rejected markers that agree with each other.

A wrong pair (dirt, a false spot, a wrong name) is off by anything. Neighbours that are off by the same are a flap, a
slat or a store that moves by itself, and the transformation of the others is wrong wherever that part is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NEIGHBOURS = 4
"""Markers of a part are among each other's so many nearest ones."""
ALIKE, ALIKE_TWO = 0.25, 0.1
"""Neighbours on a part that turns are off alike to this share; where there are two only, or four and more that are no
neighbours (walls between the model's markers), to this one: chance makes them more often than three."""
FEWEST, CHANCE, LEVELS_PX = 3, 1e-4, (1.0, 2.0, 4.0, 8.0)
"""Markers without a partner that moved together: so many at least, not by chance, within so much of each other."""
SIGMAS = 5.0
"""Nor does it count by what the marks' own sigmas let them differ."""
BETWEEN = 2.0
"""A place may be of the part that is so many times as far from it as from the others: the step lies between markers."""


def parts_apart(x: Array, off: Array, sigma: Array, others: Array) -> list[Ints]:
    """Groups of markers that moved alike, each of two or more, of rejected ones.

    Parameters
    ----------
    x : (R, 2) their places in the reference
    off : (R, 2) how far they are from where the others' transformation has them
    sigma : (R,) of `off`, per coordinate
    others : (K, 2) the places of the pairs that agree

    Returns
    -------
    Indices into the rejected ones, the largest group first
    """
    count = len(x)
    if count < 2:
        return []
    every = np.vstack([x, others])
    near = cKDTree(every).query(x, k=min(NEIGHBOURS + 1, len(every)))[1]
    apart = np.hypot(*np.moveaxis(off[:, None] - off[None], -1, 0))
    size = np.hypot(*off.T)
    allowed = SIGMAS * np.hypot(sigma[:, None], sigma[None]), np.minimum(size[:, None], size[None])
    close = np.zeros((count, count), dtype=bool)
    row, other = np.divmod(np.flatnonzero(near < count), near.shape[1])
    close[row, near[row, other]] = True
    close |= close.T

    def alike(share: float) -> NDArray[np.bool_]:
        return np.asarray(apart <= np.maximum(allowed[0], share * allowed[1]))

    found, free = [], np.ones(count, dtype=bool)
    for near_only, share, least in ((True, ALIKE, 3), (False, ALIKE_TWO, 4), (True, ALIKE_TWO, 2)):
        linked = close & alike(share) if near_only else alike(share)
        for group in sorted(_connected(linked), key=len, reverse=True):
            if len(group) < least or not free[group].all():
                continue
            # Those that moved as the nearest of the part did belong to it, whatever lies between.
            nearest = group[cKDTree(x[group]).query(x)[1]]
            part = np.flatnonzero(free & alike(share)[np.arange(count), nearest])
            free[part] = False
            found.append(part)
    return sorted(found, key=len, reverse=True)


def _connected(linked: NDArray[np.bool_]) -> list[Ints]:
    from scipy.sparse.csgraph import connected_components

    count, label = connected_components(linked, directed=False)
    return [np.flatnonzero(label == k) for k in range(count)]


def moved_together(expected: Array, seen: Array, area_px: float) -> Ints:
    """Pairs (M, 2) of markers without a partner that lie together at another place than expected.

    The shift that most agree about, at the level at which chance is least: with a share p of the picture near one of
    the `seen`, so many agree by chance as often as the binomial law says, for any of the shifts.

    Parameters
    ----------
    expected : (A, 2) where the others' transformation has the left-over spots of the reference
    seen : (B, 2) left-over spots of the image
    area_px : of the picture
    """
    from scipy.special import bdtrc

    none, best, least = np.empty((0, 2), np.int64), None, CHANCE / len(LEVELS_PX)
    if min(len(expected), len(seen)) < FEWEST:
        return none
    shift = (seen[None] - expected[:, None]).reshape(-1, 2)
    row = np.flatnonzero(np.hypot(*shift.T) > LEVELS_PX[0])  # what is where it is expected has not moved by itself
    if not row.size:
        return none
    shift = shift[row]
    for level in LEVELS_PX:
        share = min(len(seen) * (2 * level) ** 2 / area_px, 1.0)
        for corner in ((0.0, 0.0), (level, 0.0), (0.0, level), (level, level)):
            cell = np.floor((shift + corner) / (2 * level)).astype(np.int64) @ (1 << 20, 1)
            values, count = np.unique(cell, return_counts=True)
            rows = np.flatnonzero(cell == values[count.argmax()])
            agreeing = len(set((row[rows] // len(seen)).tolist()))
            chance = 4 * len(shift) * float(bdtrc(agreeing - 2, len(expected) - 1, share))
            if agreeing >= FEWEST and chance < least:
                best, least = rows, chance
    if best is None:
        return none
    off = np.hypot(*(shift[best] - np.median(shift[best], axis=0)).T)
    pairs = np.stack(np.divmod(row[best[np.argsort(off, kind="stable")]], len(seen)), axis=1)
    for side in (0, 1):  # one to one, the nearest first
        pairs = pairs[np.sort(np.unique(pairs[:, side], return_index=True)[1])]
    return np.asarray(pairs, dtype=np.int64)


def of_parts(at: Array, x: Array, off: Array, parts: list[Ints], others: Array) -> Array:
    """(N,) variance per coordinate by which parts that moved by themselves put places `at` (N, 2) in doubt.

    What is nearer to a marker of such a part than to any other belongs to it, and so may what is up to twice as far:
    the step lies anywhere between. It is off by what the marker is.
    """
    out = np.zeros(len(at))
    if not parts:
        return out
    index = np.concatenate(parts)
    to_part, which = cKDTree(x[index]).query(at)
    to_others = cKDTree(others).query(at)[0]
    own = to_part < BETWEEN * to_others
    out[own] = np.square(off[index]).sum(axis=1)[which[own]] / 2
    return out
