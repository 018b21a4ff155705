"""A marker on a wall that is not where its table has it, by all instants of a series together.

Where nothing but markers on walls holds cameras that move, one that is off by less than a spot's noise shifts what is
found in every instant by the same. In none of them it can be told; what is left over of it is the same in all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import chance
from windmark.deformation.attached import LIKELIER
from windmark.deformation.equations import Added, Equations
from windmark.deformation.evidence import Evidence, Sums, by_places
from windmark.deformation.few_walls import columns_of, displaced_words
from windmark.errors import g1, g2
from windmark.scene import Doubt

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

FALSE = 2.5e-4
"""Probability that a marker that is where it should be is said not to."""
INSTANTS = 2
"""Instants that are needed: one tells as much by itself."""
TOGETHER = "by all frames together"
MATTERS = 1.0
"""Sigmas by which it must move what is found, for that to be said."""


@dataclass(frozen=True, eq=False)
class WallPlaces:
    """What some instants say of the places of W markers on walls, the same in all of them.

    Parameters
    ----------
    walls : (W,) these among all markers
    score, power, size2, by_place, held : as of `Evidence`, of three unknowns for each of them
    instants : how many
    follow, names, cov : (F, 3 W) how what is free in the last one follows one unit of each, its names, and (F, F)
    """

    walls: Ints
    score: Array
    power: Array
    size2: Array
    by_place: Array
    held: Array
    instants: int
    follow: Array
    names: tuple[str, ...]
    cov: Array

    @staticmethod
    def none(walls: Ints, count: int) -> WallPlaces:
        """Of no instant yet, of these among ``count`` markers."""
        n = 3 * len(walls)
        square = np.zeros((n, n))
        return WallPlaces(
            walls, np.zeros(n), square, np.zeros(n), np.zeros((n, count, 3)), square, 0, np.zeros((0, n)), (),
            np.zeros((0, 0)),
        )  # fmt: skip

    def plus(self, equations: Equations, names: tuple[str, ...], place_cov: Array | None) -> WallPlaces:
        """One instant more, adjusted with ``place_cov`` (N, 3, 3); ``names`` (F,) of what is free in it."""
        added, by_place = equations.added_with_places(columns_of(equations, self.walls))
        size2 = np.where(np.diag(added.power) > 0, added.size**2, 0.0)
        return replace(
            self, score=self.score + added.score, power=self.power + added.power, size2=self.size2 + size2,
            by_place=self.by_place + by_place, held=self.held + by_places(by_place, place_cov),
            instants=self.instants + 1, follow=added.follow, names=names, cov=equations.solved.cov,
        )  # fmt: skip

    def added(self, which: Ints, beside: Ints, place_cov: Array | None) -> Added:
        """The places of some of them, with others free beside these; see `Evidence.added`."""
        sums = Sums(self.score, self.power, self.held, self.by_place, self.size2, self.instants)
        return sums.added(_three(which), _three(beside), place_cov)


@dataclass(frozen=True, eq=False)
class Displaced:
    """Which of them are off, and by how much.

    Parameters
    ----------
    names : of all markers on walls
    sets : those of which one explains it: the likeliest first, others about as well
    value, cov : of each set, (3 n,) and (3 n, 3 n)
    unit : of lengths
    seen : how many of the markers were seen
    """

    names: tuple[str, ...]
    sets: tuple[tuple[int, ...], ...]
    value: tuple[Array, ...]
    cov: tuple[Array, ...]
    unit: str
    seen: int

    @property
    def doubt(self) -> Doubt:
        """As a sentence."""
        named, listed = displaced_words(self.sets)
        one = all(len(s) == 1 for s in self.sets)
        where = "is not where its table has it" if one else "are not where their table has them"
        words = f"{listed} {where}, {TOGETHER}"
        if len(self.sets) > 1:
            words += ", which hardly tell which"
        elif one:
            far = float(np.linalg.norm(self.value[0]))
            along = self.value[0] / max(far, 1e-300)
            sigma = float(np.sqrt(along @ self.cov[0] @ along))
            words += f": it is {g2(far)} ± {g1(sigma)} {self.unit}".rstrip() + " off"
        held = f"; all cameras move, and {self.seen} markers on walls are all that holds them"
        return Doubt(tuple(self.names[k] for k in named), f"{words}{held}", "marker")

    def more(self, follow: Array) -> Array:
        """(F, F) what it adds to the covariance of what is free in an instant, which follows as (F, 3 W)."""
        out = np.zeros((len(follow), len(follow)))
        for which, value, cov in zip(self.sets, self.value, self.cov, strict=True):
            by = follow[:, _three(np.array(which))]
            out += by @ (np.outer(value, value) + cov) @ by.T / len(self.sets)
        return out


def displaced(
    places: WallPlaces, evidence: Evidence, place_cov: Array | None, names: Sequence[str], unit: str,
    *, told: bool = False,
) -> Displaced | None:  # fmt: skip
    """The markers on walls that are off by the same in all instants; None where none is, or where it does not matter.

    Parameters
    ----------
    evidence : what the same instants say of all else
    names : (W,) of the markers
    unit : of lengths
    told : whether it was told before that some are, and need not matter in the last instant, too
    """
    count = len(places.walls)
    if places.instants < INSTANTS:
        return None
    none, every = np.arange(0), [(k,) for k in range(count)]

    def tests(sets: Sequence[tuple[int, ...]], beside: Ints = none) -> dict[tuple[int, ...], tuple[float, int]]:
        each = {s: places.added(np.array(s), beside, place_cov) for s in sets}
        return {s: added.fitted(np.arange(3 * len(s)))[:2] for s, added in each.items()}

    def least(found: dict[tuple[int, ...], tuple[float, int]]) -> float:
        return min((chance(*t, *evidence.beside(t[0])) for t in found.values()), default=1.0)

    found = tests(every)
    if least(found) >= FALSE / count:
        return None
    best = max(found, key=lambda s: found[s][0])
    rest = tests([s for s in every if s != best], np.array(best))
    if count > 3 and least(rest) < FALSE / count:
        found = tests(list(combinations(range(count), 2)))
        best = max(found, key=lambda s: found[s][0])
    sets = sorted((s for s in found if found[s][0] > found[best][0] - LIKELIER), key=lambda s: -found[s][0])
    fitted = [places.added(np.array(s), none, place_cov).fitted(np.arange(3 * len(s)))[2:] for s in sets]
    seen = int(np.count_nonzero(places.size2.reshape(-1, 3).any(axis=1)))
    off = Displaced(tuple(names), tuple(sets), tuple(f[0] for f in fitted), tuple(f[1] for f in fitted), unit, seen)
    matters = np.diag(off.more(places.follow)) > MATTERS**2 * np.diag(places.cov)
    return off if told or matters.any() else None


def _three(which: Ints) -> Ints:
    """The three unknowns of each."""
    return np.asarray((3 * which[:, None] + np.arange(3)).ravel(), dtype=np.int64)
