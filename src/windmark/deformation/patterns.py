"""Misfit by its pattern: do neighbouring residuals of a volume agree, and what does that look like?

What a law cannot do is smooth over its volume: bending, twist, camber, sway in the plane, stretch, shear, each a
polynomial along the volume's longest axis. These are tested as unknowns that the law lacks (`equations`); those that
the data want (Schwarz 1978) are what is left, and how far they move each point goes into the covariances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import chance
from windmark.deformation.equations import Added, Equations
from windmark.deformation.misfit import KINDS, MOST_DEGREE, Misfit, Shapes, carried, length_unit
from windmark.deformation.sighting import MOTION
from windmark.deformation.volumes import Placed
from windmark.errors import g2

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Texts = NDArray[np.str_]

FALSE = 2.5e-4
"""Probability that a pattern is seen where there is none."""
ARM = 0.3
"""Part of half a volume's width: markers nearer to its axis tell no twist."""


@dataclass(frozen=True)
class Pattern:
    """A misfit with the sum of squares that it explains, its number of unknowns, and what it looks like."""

    misfit: Misfit
    test: float
    rank: int
    looks: tuple[tuple[str, str], ...]
    """(volume, words)."""


@dataclass(frozen=True, eq=False)
class Fields:
    """Smooth displacements of all volumes of some markers.

    ``field`` (N, 3, m); ``kind`` and ``volume`` of each column; ``groups`` (G, k) columns of one kind of one volume,
    filled up with -1.
    """

    shapes: tuple[Shapes, ...]
    field: Array
    kind: Texts
    volume: Texts
    groups: Ints

    def group(self, *which: int) -> Ints:
        """The columns of some groups."""
        every = self.groups[list(which)].ravel()
        return every[every >= 0]

    def size(self, *which: int) -> Ints:
        """How many columns some groups have."""
        return np.asarray((self.groups[list(which)] >= 0).sum(axis=1))

    def shape(self, group: int) -> Shapes:
        """The shapes of a group's volume."""
        return next(s for s in self.shapes if s.volume == self.volume[self.groups[group, 0]])


_KNOWN: WeakKeyDictionary[Placed, Fields | None] = WeakKeyDictionary()
"""The same markers are seen in every frame of a series."""


def fields_of(placed: Placed) -> Fields | None:
    """Of these markers; None where they are too few for any."""
    if placed not in _KNOWN:
        names = np.asarray(placed.names)
        volumes = [n for n in np.unique(names).tolist() if n]
        found = (Shapes.of(n, carried(placed.volumes, n), placed.xyz[names == n]) for n in volumes)
        _KNOWN[placed] = _joined(placed, tuple(s for s in found if s is not None))
    return _KNOWN[placed]


def _joined(placed: Placed, shapes: tuple[Shapes, ...]) -> Fields | None:
    if not shapes:
        return None
    field = np.concatenate([s.columns(placed.xyz, np.asarray(placed.names)) for s in shapes], axis=-1)
    kind = np.concatenate([s.kind for s in shapes])
    volume = np.repeat([s.volume for s in shapes], [len(s.kind) for s in shapes])
    groups = np.full((len(shapes) * len(KINDS), MOST_DEGREE + 1), -1)
    for n, (s, k) in enumerate((s, k) for s in shapes for k in KINDS):
        own = np.flatnonzero((kind == k) & (volume == s.volume))
        groups[n, : len(own)] = own
    return Fields(shapes, field, kind, volume, groups)


def pattern_of(equations: Equations) -> Pattern | None:
    """What neighbouring residuals agree in; None for chance."""
    solved = equations.solved
    task = solved.task
    fields = fields_of(task.placed)
    if fields is None:
        return None
    added = equations.added(equations.by_place @ (solved.values[MOTION].rotation @ fields.field))
    chosen = asked_for(added, fields, int(solved.used.sum()), solved.chi2, solved.redundancy)
    if not chosen:
        return None
    which = fields.group(*chosen)
    test, rank, value, cov = added.fitted(which)
    second = second_moment(value, fields.size(*chosen)) + cov
    misfit = Misfit(fields.shapes, which, value, second, added.follow[:, which])
    seen = np.zeros(len(task.markers), bool)
    seen[task.observations.point[solved.used]] = True
    return Pattern(misfit, test, rank, looks_like(equations, fields, chosen, misfit, seen))


def looks_like(
    equations: Equations, fields: Fields, chosen: Sequence[int], misfit: Misfit, seen: NDArray[np.bool_]
) -> tuple[tuple[str, str], ...]:
    """(volume, words) of each of the groups that were found, at the markers (N,) that are seen."""
    task, which, looks = equations.solved.task, misfit.chosen, []
    for g in chosen:
        shape, own = fields.shape(g), np.isin(which, fields.group(g))
        at = seen & (np.asarray(task.placed.names) == shape.volume)
        # Less what the laws and the rigid motion take up of it: the rest is what is left.
        taken = equations.moved(misfit.follow[:, own] @ misfit.value[own])
        amount = (fields.field[..., which[own]] @ misfit.value[own] + taken)[at]
        looks.append(_looks(shape, str(fields.kind[fields.groups[g, 0]]), amount, task.placed.xyz[at],
                            task.markers.name[at], length_unit(task.volumes)))  # fmt: skip
    return tuple(looks)


def asked_for(
    added: Added, fields: Fields, spots: int, chi2: float, redundancy: int, false: float = FALSE
) -> list[int]:
    """The groups that the data want, the most telling one first; ``chi2`` of so many ``spots`` without them.

    ``false``: probability that any of them is wanted where there is none.
    """
    count = len(fields.groups)
    price = np.log(max(2 * spots, 2))
    chosen: list[int] = []
    test, rank = 0.0, 0
    tests, ranks = added.each(fields.groups)
    while True:
        best = None
        for g in range(count):
            if g in chosen:
                continue
            more, together = (tests[g], ranks[g]) if not chosen else added.fitted(fields.group(*chosen, g))[:2]
            gain, unknowns = more - test, together - rank
            if gain <= unknowns * price:
                continue
            if chance(gain, unknowns, chi2 - test, redundancy - rank) < false / count:
                best = max(best or (-np.inf, 0, 0.0, 0), (gain - unknowns * price, g, more, together))
        if best is None:
            return chosen
        chosen.append(best[1])
        test, rank = best[2:]


def second_moment(value: Array, size: Ints) -> Array:
    """Second moment of what is lacking: each kind is as large as it was found, of any course along the volume.

    That of the very course that was found would be nothing where it crosses zero, which it does elsewhere.
    """
    ends = np.cumsum(size)
    mean = [float((value[end - n : end] ** 2).mean()) for end, n in zip(ends, size, strict=True)]
    return np.diag(np.repeat(mean, size))


def _looks(shape: Shapes, kind: str, amount: Array, xyz: Array, names: Texts, unit: str) -> tuple[str, str]:
    """(volume, words) of one kind's displacement (k, 3) at markers."""
    size = amount @ shape.axes[{"sway in its plane": 1, "stretch": 0, "shear": 0}.get(kind, 2)]
    if kind == "twist":
        v = (xyz - shape.centre) @ shape.axes[1]
        turn = np.degrees(size / np.where(np.abs(v) > ARM * shape.half[1], v, np.inf))
        k = int(np.argmax(np.abs(turn)))
        return shape.volume, f"twist of {g2(abs(turn[k]))} deg at {names[k]}"
    k = int(np.argmax(np.abs(size)))
    return shape.volume, f"{kind} of {g2(abs(size[k]))} {unit}".rstrip() + f" at {names[k]}"
