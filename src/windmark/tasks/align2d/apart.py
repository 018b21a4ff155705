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
PITCH = 0.2
"""Part of the other markers that a pitch carries onto each other."""
TURNED, SCALED, CLOSE_PX = 4, 0.2, 0.3
"""Markers of a part that turns; by how much it may seem to shrink or grow; how near a marker must be to where the
others of its part say, at least."""
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

    found = _turned(x, off, np.maximum(SIGMAS * np.sqrt(2.0) * sigma, CLOSE_PX))
    free = np.ones(count, dtype=bool)
    free[np.concatenate([np.empty(0, np.int64), *found])] = False
    found = [_with_others(group, x, free, alike(ALIKE)) for group in found]
    for near_only, share, least in ((True, ALIKE, 3), (False, ALIKE_TWO, 4), (True, ALIKE_TWO, 2)):
        linked = close & alike(share) if near_only else alike(share)
        for group in sorted(_connected(linked), key=len, reverse=True):
            if len(group) >= least and free[group].all():
                free[group] = False
                found.append(_with_others(group, x, free, alike(share)))
    return sorted(found, key=len, reverse=True)


def _with_others(group: Ints, x: Array, free: NDArray[np.bool_], alike: NDArray[np.bool_]) -> Ints:
    """A part with those that moved as the nearest of it did, whatever lies between; they are free no longer."""
    nearest = group[cKDTree(x[group]).query(x)[1]]
    more = np.flatnonzero(free & alike[np.arange(len(x)), nearest])
    free[more] = False
    return np.concatenate([group, more])


def _turned(x: Array, off: Array, near: Array) -> list[Ints]:
    """Groups of four or more that one similarity of their own explains, each within ``near`` (R,) pixels.

    A part that turns has no two markers that moved alike. Two of them tell the similarity, the others confirm it.
    """
    left, found = np.arange(len(x)), []
    while len(left) >= TURNED:
        z, w = ((at[left] @ (1.0, 1j)) for at in (x, x + off))
        i, j = np.triu_indices(len(left), 1)
        turn = (w[j] - w[i]) / np.where(z[j] == z[i], np.nan, z[j] - z[i])
        miss = np.abs(w[None] - w[i][:, None] - turn[:, None] * (z[None] - z[i][:, None]))
        inside = (miss < near[left]) & (np.abs(np.abs(turn) - 1.0) < SCALED)[:, None]
        best = inside[inside.sum(axis=1).argmax()]
        if best.sum() < TURNED:
            break
        found.append(left[best])
        left = left[~best]
    return found


def _connected(linked: NDArray[np.bool_]) -> list[Ints]:
    from scipy.sparse.csgraph import connected_components

    count, label = connected_components(linked, directed=False)
    return [np.flatnonzero(label == k) for k in range(count)]


def moved_together(expected: Array, seen: Array, area_px: float, others: Array) -> Ints:
    """Pairs (M, 2) of markers without a partner that lie together at another place than expected.

    The shift that most agree about, at the level at which chance is least: with a share p of the picture near one of
    the `seen`, so many agree by chance as often as the binomial law says, for any of the shifts. One that carries the
    other markers onto each other is the pitch of a regular layout, in which gaps are anywhere.

    Parameters
    ----------
    expected : (A, 2) where the others' transformation has the left-over spots of the reference
    seen : (B, 2) left-over spots of the image
    area_px : of the picture
    others : (K, 2) the markers that have a partner, in the image
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
    middle = np.median(shift[best], axis=0)
    off = np.hypot(*(shift[best] - middle).T)
    if len(others) and np.mean(cKDTree(others).query(others + middle)[0] < LEVELS_PX[-1]) > PITCH:
        return none
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
