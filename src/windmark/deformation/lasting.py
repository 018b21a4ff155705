"""What the laws lack in all instants of a series alike, or in proportion to the load: too little in each to be seen.

A root that gives way a little is taken for a rigid motion, a bending of another course for the law's own; what is left
is a part of either. Together the instants tell it (`Evidence`), and how far it moves what is found in each of them
goes into the covariances.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri

from windmark.adjust import chance
from windmark.deformation.equations import Added, Equations
from windmark.deformation.evidence import Evidence, Instant
from windmark.deformation.loads import loads_of
from windmark.deformation.misfit import Misfit
from windmark.deformation.patterns import FALSE, Fields, asked_for, fields_of, looks_like
from windmark.errors import g1, g2
from windmark.scene import Doubt

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MATTERS = 1.0
"""Sigmas of a marker's place by which it must be off through what the laws lack, for that to be said."""
RIGID = 2
"""Columns of bending or sway, a shift and a tilt along the volume, with which it does not change its shape."""
TOLD = 2
"""Kinds that are named."""
UNLIKELY = 0.01
"""Times as likely as what is told: what is less likely is not thought of."""
EARLY = 4
"""Instants from which on they are judged as any number of them is. Of fewer a series would be asked once more each,
and chance passes where a cause is there to stay."""
SWAY = "sway in its plane"


@dataclass(frozen=True, eq=False)
class Lasting:
    """What is left over in all instants.

    Parameters
    ----------
    column, factor : (k,) which column of `Fields` each part of it is, and in proportion to which of the factors
    value, second : (k,) how much of each, in one unit of the factor, and the second moment of that (k, k)
    factors : (j, 1 + R) what the factors have of 1 and the loads, see `Course`
    doubts : what is to be said of it
    chosen : the groups that the data want, of all factors behind each other
    """

    column: Ints
    factor: Ints
    value: Array
    second: Array
    factors: Array
    doubts: tuple[Doubt, ...] = ()
    chosen: tuple[int, ...] = ()

    @property
    def which(self) -> Ints:
        """(m,) the columns of `Fields` in it."""
        return np.unique(self.column)

    def at(self, load: Array) -> tuple[Array, Array]:
        """How much of `which` there is at loads (R,): (m,), and the second moment of that (m, m), see `Misfit`."""
        size = (self.factors @ np.r_[1.0, load])[self.factor]
        by = (self.which[:, None] == self.column) * size
        return by @ self.value, by @ self.second @ by.T

    def explains(self, own: Misfit, instant: Instant, lacking: Ints) -> bool:
        """Whether what an instant by itself found to be lacking is no more than this, and chance.

        ``lacking``: columns of `Fields` among the unknowns of the instant.
        """
        score, power = instant.score[lacking], instant.power[np.ix_(lacking, lacking)]
        value = np.zeros(len(lacking))
        value[self.which] = self.at(instant.load)[0]
        chi2 = instant.chi2 + float(value @ (2 * score + power @ value))
        size = np.sqrt(np.where(instant.size2[lacking] > 0, instant.size2[lacking], 1.0))
        left = Added(score + power @ value, power, size, instant.follow[:, lacking])
        test, rank = left.fitted(own.chosen)[:2]
        return chance(test, rank, max(chi2, instant.redundancy + test), instant.redundancy) > FALSE

    def only(self, factor: int) -> Lasting:
        """Those parts of it that are in proportion to one of the factors."""
        own = self.factor == factor
        second = self.second[np.ix_(own, own)]
        return replace(self, column=self.column[own], factor=self.factor[own], value=self.value[own], second=second)


def lasting(
    evidence: Evidence, instant: Instant, equations: Equations, instants: int, told: Lasting | None = None
) -> Lasting | None:
    """What the laws lack in all ``instants`` with wind together, told by the last one; None for nothing.

    ``told``: what was told before. It is not one of many any more, and must be likely by itself only.
    """
    solved = equations.solved
    fields, cov = fields_of(solved.task.placed), solved.task.place_cov
    if fields is None or instants < 2:
        return None
    factors, lacking, finer = evidence.course.factors, evidence.lacking, _finer(fields)
    every = evidence.by_factors(factors)
    added = every.added(every.with_loads(lacking), every.with_loads(every.poses), cov)
    # Those without wind fit too well beside these: the markers' places were corrected by them.
    chi2 = max(evidence.lacking_chi2, evidence.lacking_redundancy)
    shared = replace(finer, groups=_shifted(finer.groups, len(factors), len(lacking)))
    spots, false = evidence.spots // evidence.instants, _false(instants)
    chosen = asked_for(added, shared, spots, chi2, evidence.lacking_redundancy, false)
    if not chosen and told is not None and max(told.chosen) < len(shared.groups):
        test, rank = added.fitted(shared.group(*told.chosen))[:2]
        if chance(test, rank, chi2, evidence.lacking_redundancy) < FALSE:
            chosen = list(told.chosen)
    if not chosen:
        return None
    found = _averaged(added, shared, [chosen], np.ones(1), lacking, factors)
    follow = instant.follow[:, lacking[found.which]]
    misfit = Misfit(fields.shapes, found.which, *found.at(evidence.course.largest), follow)
    if not _matters(equations, fields, misfit):
        return None
    doubts = _doubts(equations, fields, found, evidence, instant, instants)
    price, scale = float(np.log(max(2 * spots, 2))), chi2 / max(evidence.lacking_redundancy, 1)
    likely = _likely(added, shared, chosen, price, scale)
    return replace(_averaged(added, shared, *likely, lacking, factors), doubts=doubts, chosen=tuple(chosen))


def _likely(
    added: Added, fields: Fields, chosen: list[int], price: float, scale: float
) -> tuple[list[list[int]], Array]:
    """What explains about as much as the groups that were chosen, another one in place of the last, and how likely.

    A root that gives way and a bending of another course leave much the same, and move all else by very different
    amounts. Likelihoods are those of Schwarz (1978), as unknowns are wanted by (`asked_for`).
    """
    sets = [[*chosen[:-1], g] for g in range(len(fields.groups)) if g not in chosen[:-1]]
    tests = (added.fitted(fields.group(*s))[:2] for s in sets)
    worth = np.array([(test / scale - price * rank) / 2 for test, rank in tests])
    weight = np.exp(worth - worth.max())
    own = np.flatnonzero(weight > UNLIKELY)
    return [sets[k] for k in own], weight[own] / weight[own].sum()


def _averaged(
    added: Added, fields: Fields, sets: list[list[int]], weight: Array, lacking: Ints, factors: Array
) -> Lasting:
    """Mean and second moment of how much there is of some sets of groups, each with its weight.

    That of one of them is what it was found to be and its covariance, and no more: all instants together tell it.
    """
    which = np.unique(np.concatenate([fields.group(*s) for s in sets]))
    mean, second = np.zeros(len(which)), np.zeros((len(which), len(which)))
    for own, part in zip(sets, weight, strict=True):
        columns = fields.group(*own)
        _, _, value, cov = added.fitted(columns)
        at = np.searchsorted(which, columns)
        mean[at] += part * value
        second[np.ix_(at, at)] += part * (np.outer(value, value) + cov)
    return Lasting(which % len(lacking), which // len(lacking), mean, second, factors)


def _false(instants: int) -> float:
    """Probability of what is told of some instants by chance: a series is asked again with every one that comes.

    The first looks get little of it, as in O'Brien and Fleming (1979): the limit of the sum over instants is the same.
    """
    return float(chdtrc(1, chdtri(1, FALSE) * max(1.0, EARLY / instants)))


def _shifted(groups: Ints, factors: int, columns: int) -> Ints:
    """Groups (G, k) of columns once more for each factor, (factors G, k)."""
    return np.concatenate([np.where(groups < 0, -1, groups + columns * k) for k in range(factors)])


def _finer(fields: Fields) -> Fields:
    """What each volume does as a rigid body that its root lets turn, and of each kind what goes beyond that.

    A root that gives way is the first, and alone it is told from far less. Out of the volume's plane it may turn about
    any axis in it; bending without the twist that belongs to it would be taken for less than it is.
    """
    width = fields.groups.shape[1] + 1
    groups = []
    for volume in dict.fromkeys(fields.volume.tolist()):
        rest = _root(fields, volume)
        groups.append(rest)
        for g in (g for g in range(len(fields.groups)) if fields.volume[fields.groups[g, 0]] == volume):
            own = fields.group(g)
            if fields.kind[own[0]] == SWAY:
                groups.append(own[:RIGID])
                own = own[RIGID:]
            groups.append(own[~np.isin(own, rest)])
    filled = [np.pad(g, (0, width - len(g)), constant_values=-1) for g in groups if len(g)]
    return replace(fields, groups=np.array(filled))


def _root(fields: Fields, volume: str) -> Ints:
    """(3,) columns of a volume's shift out of its plane and of its turns about the axes in it."""
    own = [np.flatnonzero((fields.volume == volume) & (fields.kind == kind)) for kind in ("bending", "twist")]
    return np.r_[own[0][:RIGID], own[1][:1]]


def _matters(equations: Equations, fields: Fields, misfit: Misfit) -> bool:
    """Whether some marker is off by more than its sigma."""
    by_free = np.stack([equations.moved(e) for e in np.eye(len(misfit.follow))], axis=-1)
    off = fields.field[..., misfit.chosen] @ misfit.value + by_free @ (misfit.follow @ misfit.value)
    cov = by_free @ equations.solved.cov @ by_free.transpose(0, 2, 1)
    size2 = (off**2).sum(axis=1)
    along = np.einsum("ni,nij,nj->n", off, cov, off)  # variance along it, times size2
    return bool((size2**2 > MATTERS**2 * np.maximum(along, 0.0))[size2 > 0].any())


def _doubts(
    equations: Equations, fields: Fields, found: Lasting, evidence: Evidence, instant: Instant, instants: int
) -> tuple[Doubt, ...]:
    """By volumes; of each what is the same in all instants, and what grows with which load."""
    task, load = equations.solved.task, evidence.course.largest
    seen = np.zeros(len(task.markers), bool)
    seen[task.observations.point[equations.solved.used]] = True
    laws = {part.name for part in task.volumes.parts if part.law is not None}
    out = []
    for factor in dict.fromkeys(found.factor.tolist()):
        part = found.only(factor)
        follow = instant.follow[:, evidence.lacking[part.which]]
        misfit = Misfit(fields.shapes, part.which, *part.at(load), follow)
        kinds = list(dict.fromkeys(g for c in part.column for g in range(len(fields.groups)) if c in fields.group(g)))
        by_volume: dict[str, list[str]] = {}
        for volume, words in looks_like(equations, fields, kinds, misfit, seen):
            by_volume.setdefault(volume, []).append(words)
        grows = _grows_with(equations, found.factors[factor], evidence) if factor else None
        for volume, looks in by_volume.items():
            more = f" (and {len(looks) - TOLD} more)" if len(looks) > TOLD else ""
            like = f"it looks like {' and '.join(looks[:TOLD])}{more}"
            why = "it deforms and has no law"
            if volume in laws:
                why = "its law is too simple, or its root gives way" + _by_how_much(fields, volume, part, load, grows)
            head = f"the same is left over of {{}} in {instants} frames together: {like}"
            if grows is not None:
                at = f"{g2(grows.value)} {grows.unit}".rstrip()
                head = (f"what is left over of {{}} grows with {grows.name}, by {instants} frames together: where that "
                        f"is {at}, {like}")  # fmt: skip
            out.append(Doubt((volume,), f"{head}; {why}", "bent"))
    return tuple(out)


class _Grows(NamedTuple):
    """A parameter of the laws that a factor grows with, and its change since wind-off where the loads are largest."""

    name: str
    unit: str
    value: float


def _grows_with(equations: Equations, factor: Array, evidence: Evidence) -> _Grows:
    """The parameter with the largest part in a factor (1 + R,)."""
    task, course, loads = equations.solved.task, evidence.course, loads_of(equations.solved.task.placed)
    change = np.linalg.pinv(loads) @ (course.largest - course.zero)
    k = int(np.argmax(np.abs(factor[1:] @ loads * change)))
    return _Grows(task.volumes.names[k], task.volumes.parameters[k].unit, float(change[k]))


def _by_how_much(fields: Fields, volume: str, part: Lasting, load: Array, grows: _Grows | None) -> str:
    """By which turn of the root, where it is no more than a turn of the volume; "" where its shape is another one."""
    root = _root(fields, volume)
    if not np.array_equal(part.which[fields.volume[part.which] == volume], np.sort(root)):
        return ""
    at = np.searchsorted(part.which, root[1:])
    half = fields.shape(next(g for g in range(len(fields.groups)) if fields.groups[g, 0] == root[0])).half
    value, second = part.at(load)
    cov = (second - np.outer(value, value))[np.ix_(at, at)] / np.outer(half, half)
    slope = value[at] / half
    turn = float(np.linalg.norm(slope))
    sigma = float(np.sqrt(np.maximum(slope @ cov @ slope, 0.0))) / max(turn, 1e-300)
    turn, sigma = np.degrees([turn, sigma]).tolist()
    if grows is None:
        return f" by about {g2(turn)} ± {g1(sigma)} deg"
    per, size = f"{grows.unit} of {grows.name}" if grows.unit else f"unit of {grows.name}", abs(grows.value)
    return f" by about {g2(turn / size)} ± {g1(sigma / size)} deg per {per}"
