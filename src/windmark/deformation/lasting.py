"""What the laws lack in the same way in all instants of a series: too little in each of them, and far above its noise.

A root that gives way a little is taken for a rigid motion, a bending of another course for the law's own; what is left
is a part of either. Together the instants tell it (`Evidence`), and how far it moves what is found in each of them
goes into the covariances.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.equations import Equations
from windmark.deformation.evidence import Evidence, Instant
from windmark.deformation.misfit import Misfit
from windmark.deformation.patterns import Fields, asked_for, fields_of, looks_like, second_moment
from windmark.scene import Doubt

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MATTERS = 1.0
"""Sigmas of a marker's place by which it must be off through what the laws lack, for that to be said."""
RIGID = 2
"""Columns of a kind, a shift and a tilt along the volume, with which it does not change its shape."""
TOLD = 2
"""Kinds that are named."""


@dataclass(frozen=True, eq=False)
class Lasting:
    """What is left over in all instants alike.

    Parameters
    ----------
    which : (m,) columns of `Fields`
    value, second : (m,) how much of each, and its second moment (m, m), see `Misfit`
    doubts : what is to be said of it
    """

    which: Ints
    value: Array
    second: Array
    doubts: tuple[Doubt, ...]


def lasting(evidence: Evidence, instant: Instant, equations: Equations, instants: int) -> Lasting | None:
    """What the laws lack in all ``instants`` with wind together, as it is in the last one; None for nothing."""
    solved = equations.solved
    fields, cov = fields_of(solved.task.placed), solved.task.place_cov
    if fields is None or instants < 2:
        return None
    added, finer = evidence.added(evidence.lacking, evidence.poses, cov), _finer(fields)
    every, redundancy = evidence.beside(0.0)
    chosen = asked_for(added, finer, evidence.spots // evidence.instants, every, redundancy)
    if not chosen:
        return None
    which = finer.group(*chosen)
    _, _, value, own = added.fitted(which)
    follow = instant.follow[:, evidence.lacking[which]]
    misfit = Misfit(fields.shapes, which, value, second_moment(value, finer.size(*chosen)) + own, follow)
    if not _matters(equations, fields, misfit):
        return None
    seen = np.zeros(len(solved.task.markers), bool)
    seen[solved.task.observations.point[solved.used]] = True
    kinds = [g for g in range(len(fields.groups)) if np.isin(fields.group(g), which).any()]
    return Lasting(which, value, misfit.second, _doubts(equations, fields, kinds, misfit, seen, instants))


def _finer(fields: Fields) -> Fields:
    """Each kind in two: as a rigid body that is held by its root, and what goes beyond that.

    A root that gives way is the first, and alone it is told from far less.
    """
    groups = np.full((2 * len(fields.groups), fields.groups.shape[1]), -1)
    groups[::2, :RIGID], groups[1::2, :-RIGID] = fields.groups[:, :RIGID], fields.groups[:, RIGID:]
    return replace(fields, groups=groups[(groups >= 0).any(axis=1)])


def _matters(equations: Equations, fields: Fields, misfit: Misfit) -> bool:
    """Whether some marker is off by more than its sigma."""
    by_free = np.stack([equations.moved(e) for e in np.eye(len(misfit.follow))], axis=-1)
    off = fields.field[..., misfit.chosen] @ misfit.value + by_free @ (misfit.follow @ misfit.value)
    cov = by_free @ equations.solved.cov @ by_free.transpose(0, 2, 1)
    size2 = (off**2).sum(axis=1)
    along = np.einsum("ni,nij,nj->n", off, cov, off)  # variance along it, times size2
    return bool((size2**2 > MATTERS**2 * np.maximum(along, 0.0))[size2 > 0].any())


def _doubts(
    equations: Equations, fields: Fields, chosen: list[int], misfit: Misfit, seen: NDArray[np.bool_], instants: int
) -> tuple[Doubt, ...]:
    """By volumes, the most telling first."""
    by_volume: dict[str, list[str]] = {}
    for volume, words in looks_like(equations, fields, chosen, misfit, seen):
        by_volume.setdefault(volume, []).append(words)
    laws = {part.name for part in equations.solved.task.volumes.parts if part.law is not None}
    out = []
    for volume, kinds in by_volume.items():
        more = f" (and {len(kinds) - TOLD} more)" if len(kinds) > TOLD else ""
        why = "its law is too simple, or its root gives way" if volume in laws else "it deforms and has no law"
        out.append(Doubt((volume,), f"the same is left over of {{}} in {instants} frames together: it looks like "
                         f"{' and '.join(kinds[:TOLD])}{more}; {why}", "bent"))  # fmt: skip
    return tuple(out)
