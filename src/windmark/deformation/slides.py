"""Where a part comes to lie on itself: by its own law, so that its markers take each other's places.

Markers in regular rows on a part that slides or turns look the same one spacing further on, but for those at the ends.
Unlike the near-symmetries of a whole model (`registration.Layout`) these are no rigid motions: they are what the law
can do, which is nothing for most laws, and more than a motion along a bent rail. So they are looked for by the law:
what brings a marker onto another one, and then as many of the others as it does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.deformation.law import LawError
from windmark.deformation.misfit import carried
from windmark.deformation.volumes import Placed

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAST, PART = 3, 0.2
"""So many markers, and this part of them, must come onto others."""
ONTO, BESIDE = 24, 4
"""Onto how many others one in the middle and two at the ends are brought, and how many beside them go the same way."""
TOWARDS = 0.5
"""What the law lacks of that way, as part of it, where it is followed further."""
NEAR, ON = 0.3, 0.1
"""Of the distance to the nearest other marker: so near two are taken for each other, and so near they must come."""
ROUNDS, SETTLED = 6, 1e-9
"""Steps of each search at most, and a last one that is so small beside the whole way."""


@dataclass(frozen=True, eq=False)
class Slide:
    """One way of a part to come to lie on itself.

    Parameters
    ----------
    volume : the part whose law does it
    columns : (k,) its parameters among all
    placed : the (n,) markers that its law moves, bound to the laws
    own : (n,) these among all markers
    onto : (n,) the one of them whose place each takes, -1 for none
    change : (k,) of the parameters, from their start
    spacing : how far it moves them, in the middle
    """

    volume: str
    columns: Ints
    placed: Placed
    own: Ints
    onto: Ints
    change: Array
    spacing: float

    @property
    def entering(self) -> Ints:
        """Markers, among all, that it takes to places where none of the part's is."""
        return self.own[self.onto < 0]

    @property
    def vacated(self) -> Ints:
        """Markers, among all, whose places it leaves empty."""
        return np.delete(self.own, self.onto[self.onto >= 0])

    def of(self, q: Array) -> Array | None:
        """Parameters (K,) of all laws with the part so much further on; None where its law or its bounds forbid it."""
        try:
            return self._of(q)
        except LawError:  # a user's law may raise where it has no place
            return None

    def _of(self, q: Array) -> Array | None:
        parameters = [self.placed.volumes.parameters[k] for k in self.columns.tolist()]
        here, on = self.placed.place(q), self.onto >= 0
        wanted, there = here[self.onto[on]], q.copy()
        there[self.columns] += self.change
        for _ in range(ROUNDS):
            if (step := _step(self.placed, there, self.columns, on, wanted)) is None:
                return None
            there[self.columns] += step
            if np.abs(step).max() <= SETTLED * np.abs(self.change).max():
                break
        off = np.linalg.norm(self.placed.place(there)[on] - wanted, axis=1)
        far = np.linalg.norm(wanted - here[on], axis=1)
        inside = all(p.lower <= there[k] <= p.upper for k, p in zip(self.columns.tolist(), parameters, strict=True))
        return there if inside and (off <= ON * far).all() else None


def slides_of(placed: Placed, wall: NDArray[np.bool_]) -> tuple[Slide, ...]:
    """All ways in which parts of a model come to lie on themselves.

    Parameters
    ----------
    placed : all markers (N,), bound to the laws
    wall : (N,) those that belong to no part
    """
    volumes, out = placed.volumes, list[Slide]()
    owner = np.array([part.name for part in volumes.parts if part.law is not None for _ in part.law.parameters])
    for part in volumes.parts:
        own = np.flatnonzero(np.isin(placed.names, carried(volumes, part.name)) & ~wall)
        columns = np.flatnonzero(owner == part.name)
        if part.law is None or not len(columns) or len(own) <= LEAST:
            continue
        try:
            out += _of_part(part.name, columns, volumes.bind(placed.xyz[own], placed.names[own]), own)
        except LawError:
            continue
    return tuple(out)


def _of_part(name: str, columns: Ints, placed: Placed, own: Ints) -> list[Slide]:
    start = placed.volumes.start
    here, by_q = placed.linearise(start)
    slope, tree = by_q[..., columns], cKDTree(here)
    if not np.isfinite(slope).all():
        return []
    spacing = tree.query(here, k=2)[0][:, 1]
    beside = tree.query(here, k=min(BESIDE + 1, len(own)))[1]
    out = np.linalg.norm(here - here.mean(axis=0), axis=1)
    end = int(out.argmax())
    seeds = {int(out.argmin()), end, int(np.linalg.norm(here - here[end], axis=1).argmax())}
    found: dict[bytes, Slide] = {}
    for a in sorted(seeds):
        for b in tree.query(here[a], k=min(ONTO + 1, len(own)))[1].tolist():
            way = here[b] - here[a]
            change = _solved(slope[beside[a]], np.tile(way, (len(beside[a]), 1)))
            if b == a or np.linalg.norm(slope[a] @ change - way) > TOWARDS * np.linalg.norm(way):
                continue
            followed = _followed(placed, start, columns, change, tree, spacing)
            if followed is not None:
                onto, change = followed
                far = float(np.median(np.linalg.norm(here[onto[onto >= 0]] - here[onto >= 0], axis=1)))
                found.setdefault(onto.tobytes(), Slide(name, columns, placed, own, onto, change, far))
    return list(found.values())


def _followed(
    placed: Placed, start: Array, columns: Ints, change: Array, tree: cKDTree, spacing: Array
) -> tuple[Ints, Array] | None:
    """Onto which markers a change brings the others, and the change that does it best; None where those are few."""
    there, count = start.copy(), len(spacing)
    there[columns] += change
    for _ in range(ROUNDS):
        place = placed.place(there)
        if not np.isfinite(place).all():
            return None
        away, onto = tree.query(place)
        near = away < NEAR * spacing
        if _few(near, onto):
            return None
        step = _step(placed, there, columns, near, tree.data[onto[near]])
        if step is None:
            return None
        there[columns] += step
    away, onto = tree.query(placed.place(there))
    on = away < ON * spacing
    once = np.zeros(count, bool)
    once[np.unique(np.where(on, onto, count), return_index=True)[1]] = True
    onto = np.where(on & once, onto, -1)
    if _few(onto >= 0, onto):
        return None
    return onto, there[columns] - start[columns]


def _few(near: NDArray[np.bool_], onto: Ints) -> bool:
    """Whether few markers come onto others, or most of those that do onto themselves, as a root that does not move."""
    same = near & (onto == np.arange(len(onto)))
    return bool(near.sum() < max(LEAST, PART * len(near)) or 2 * same.sum() >= near.sum())


def _step(placed: Placed, q: Array, columns: Ints, which: NDArray[np.bool_], wanted: Array) -> Array | None:
    place, by_q = placed.linearise(q)
    slope, off = by_q[which][..., columns], wanted - place[which]
    return _solved(slope, off) if np.isfinite(slope).all() and np.isfinite(off).all() else None


def _solved(slope: Array, off: Array) -> Array:
    """The least change (k,), by what it moves, that moves points (n, 3, k) by as much as (n, 3)."""
    a = slope.reshape(-1, slope.shape[-1])
    size = np.linalg.norm(a, axis=0)
    size[size == 0] = 1.0
    return np.asarray(np.linalg.lstsq(a / size, off.ravel(), rcond=1e-6)[0] / size)
