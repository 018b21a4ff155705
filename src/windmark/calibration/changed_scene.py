"""Whether markers stand elsewhere in the later pictures than in the earlier ones: the model bent, or moved in a part.

All pictures are taken of one thing. Where that changed in between, each marker gets a place between its two, the
residuals grow a little everywhere, and what is nearest explains them in part: a focal length, a principal point. So the
change itself is a hypothesis (`hypotheses`), for each place in the order of the pictures where it may have been: the
markers of the later ones are displaced by a field d(x) = sum of c_m phi_m(x), polynomials of first or second degree in
the places. What of that is a motion of everything is one of the cameras, and is not told.

Errors of a lens differ from picture to picture, too, and the later pictures show other ones than the earlier do. They
do so in any division of the pictures, and in all of them at once. So a change of the scene has to explain clearly more
than the same field does for divisions by lot, and to leave these nothing but chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from windmark.calibration.agreement import FALSE
from windmark.calibration.hypotheses import chance_beside, gathered
from windmark.calibration.setup import Job, frames_of
from windmark.calibration.solve import Solved
from windmark.calibration.view_changes import explained, most_explained
from windmark.errors import g2
from windmark.geometry.similarity import align
from windmark.scene import Doubt

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

CAUSE = "scene"
LEAST = 2
"""Pictures, or instants of a rig, before and after a change: one alone is `foreign`."""
BLOCKS = 24
"""Consecutive pictures are taken together where there are more than so many."""
LOTS = 12
"""Divisions by lot at least."""
ALIKE = 0.5
"""Correlation with the division that is asked for, from which one by lot is no other one."""
UNLIKELY = FALSE / 3
"""Probability that a change is said where there is none."""
LEAST_MARKERS = 10
SURE = 2 * np.log(1 / FALSE)
"""Of twice the logarithm of a likelihood, by which one is told from another."""
FIRST = 4
"""Polynomials up to the first degree in three coordinates."""
USUAL = 0.01
"""Probability of what a division by lot explains beside the change, above which half of them have to be."""


@dataclass(frozen=True)
class Changed:
    """A change of the scene.

    Parameters
    ----------
    before, after : names of the pictures between which it happened
    marker : that is moved most
    most, rms : how far that one moved, and all of them, in the markers' unit; no motion of all together
    lead : as of `view_changes.Asked`
    """

    before: str
    after: str
    marker: str
    most: float
    rms: float
    lead: float

    def doubt(self, unit: str) -> Doubt:
        """In words."""
        most, rms = (f"{g2(size)} {unit}".rstrip() for size in (self.most, self.rms))
        words = (
            f"markers stand elsewhere from {{}} on than up to {{}}: some {rms} (rms), {{}} {most}, as if the model had "
            "bent or a part of it had moved in between; no marker's place is that of either state"
        )
        return Doubt((self.after, self.before, self.marker), words, CAUSE)


def changed_scene(job: Job, solved: Solved) -> Changed | None:
    """The change of the scene that the marks ask for most, if they do; None also where it cannot be told."""
    views = np.unique(solved.problem.marks.views[solved.used[solved.problem.order]])
    instants = frames_of(job)[1][views]
    times = np.unique(instants)  # in the order in which they were given
    points = np.unique(solved.problem.marks.points)
    if len(times) < 2 * LEAST or len(points) < LEAST_MARKERS or solved.redundancy <= 0:
        return None
    block = np.full(len(job.views), -1)
    ends = np.array_split(times, min(len(times), BLOCKS))
    of_time = np.repeat(np.arange(len(ends)), [len(some) for some in ends])
    block[views] = of_time[np.searchsorted(times, instants)]
    splits = [k for k in range(1, len(ends)) if LEAST <= sum(map(len, ends[:k])) <= len(times) - LEAST]
    field = _field(solved, points)
    every = _Divided.of(solved, field, points, block)
    all_splits = every.splits()
    best: tuple[float, int] | None = None
    unknowns = np.arange(3 * field.shape[1]).reshape(3, -1)
    for kinds in (unknowns[:, :FIRST].ravel(), unknowns.ravel()):
        (_, test, count), k = all_splits.some(kinds).most(splits)
        lead = float(test / solved.scale - count * np.log(2 * solved.used.sum()) - 2 * np.log(len(splits)))
        if not chance_beside(test, count, solved) < UNLIKELY / (2 * len(splits)) or (best and lead < best[0]):
            continue
        if every.some(kinds).by_nothing_else(np.arange(len(ends)) >= k, test, count):
            best = lead, k
    if best is None:
        return None
    lead, k = best
    change = all_splits.explained(k)[0].reshape(3, -1)  # by all: the nearest to it
    moved = solved.problem.layout.unit * field @ change.T
    edge = views[instants == ends[k - 1][-1]][-1], views[instants == ends[k][0]][0]
    return _described(job, solved.state.points[points], moved, points, edge, lead)


@dataclass(frozen=True)
class _Divided:
    """Of a field's K unknowns in each of B blocks of pictures, so that those of any division of them are sums of these.

    Of three directions, each with the M polynomials of the field.

    Parameters
    ----------
    power, score : (B, K, K), (B, K) b^T b and b^T r
    rooted : (n, B, K), (m, B, K) what `NetworkCovariance.rooted` makes of J^T b
    """

    solved: Solved
    power: Array
    score: Array
    rooted: tuple[Array, ...]

    @classmethod
    def of(cls, solved: Solved, field: Array, points: Ints, block: Ints) -> _Divided:
        """Of a field (N, M) at the ``points`` (N,); ``block`` (V,) of each view, -1 of none."""
        problem, marks, order = solved.problem, solved.problem.marks, solved.problem.order
        group = np.where(solved.used[order], block[marks.views], -1)
        at, place = np.searchsorted(points, marks.points), _by_place(solved)
        count, many = int(group.max()) + 1, field.shape[1]
        cross = gathered(solved, place, group, count, field, at)
        # What a field does is told by sums over the marks of each marker: of its derivatives' products, and residuals.
        used = group >= 0
        cell, place, r = group[used] * len(points) + at[used], place[used], solved.residual[order][used]
        rest = np.concatenate([place, r[..., None]], axis=2)
        sums = np.empty((3, 4, count, len(points)))
        for j, k in np.ndindex(3, 4):
            product = (place[:, :, j] * rest[:, :, k]).sum(axis=1)
            sums[j, k] = np.bincount(cell, product, count * len(points)).reshape(count, -1)
        pairs = (field[:, :, None] * field[:, None, :]).reshape(len(points), -1)
        power = (sums[:, :3].reshape(-1, len(points)) @ pairs).reshape(3, 3, count, many, many)
        power = power.transpose(2, 0, 3, 1, 4).reshape(count, 3 * many, -1)
        score = (sums[:, 3] @ field).transpose(1, 0, 2).reshape(count, -1)
        rooted = solved.covariance.rooted(cross.reshape(problem.size, -1))
        return cls(solved, power, score, tuple(half.reshape(len(half), count, -1) for half in rooted))

    def some(self, kinds: Ints) -> _Divided:
        """Of some of the unknowns alone."""
        k, each = kinds, np.ix_(np.arange(len(self.power)), kinds, kinds)
        return _Divided(self.solved, self.power[each], self.score[:, k], tuple(half[..., k] for half in self.rooted))

    def explained(self, *divisions: Mask) -> tuple[Array, float, int]:
        """The field's unknowns for divisions of the blocks, what they explain together, and how many are told."""
        halves = [np.concatenate([half[:, later].sum(axis=1) for later in divisions], axis=1) for half in self.rooted]
        power = np.block([[self.power[one & other].sum(axis=0) for other in divisions] for one in divisions])
        score = np.concatenate([self.score[later].sum(axis=0) for later in divisions])
        return _explained(power - sum(half.T @ half for half in halves), np.diagonal(power), score)

    def splits(self) -> _Splits:
        """Of the divisions into the blocks from each one on, and those before it."""
        power, score = (np.cumsum(each[::-1], axis=0)[::-1] for each in (self.power, self.score))
        left = power.copy()
        for half in self.rooted:
            total = np.zeros((len(half), half.shape[2]))
            for n in range(len(left) - 1, -1, -1):
                total += half[:, n]
                left[n] -= total.T @ total
        return _Splits(np.diagonal(power, axis1=1, axis2=2), left, score)

    def by_nothing_else(self, later: Mask, test: float, count: int) -> bool:
        """Whether divisions by lot explain clearly less, and beside this one nothing but chance."""
        lots = _lots(later)
        if max((self.explained(lot)[1] for lot in lots), default=0.0) > test - SURE * self.solved.scale:
            return False
        free = self.solved.redundancy - count
        left = (self.solved.sigma0**2 * self.solved.redundancy - test) / max(free, 1)
        both = [self.explained(later, lot) for lot in lots]
        chances = [chdtrc(max(n - count, 1), max(more - test, 0.0) / left) for _, more, n in both]
        return bool(chances) and float(np.median(chances)) > USUAL


@dataclass(frozen=True)
class _Splits:
    """Divisions of B blocks of pictures into those from one on, and those before: of a field's K unknowns for each.

    Parameters
    ----------
    power : (B, K) diagonal of b^T b
    left : (B, K, K) b^T Q b, what the network's unknowns leave over
    score : (B, K) b^T r
    """

    power: Array
    left: Array
    score: Array

    def some(self, kinds: Ints) -> _Splits:
        """Of some of the unknowns alone."""
        each = np.ix_(np.arange(len(self.power)), kinds, kinds)
        return _Splits(self.power[:, kinds], self.left[each], self.score[:, kinds])

    def explained(self, split: int) -> tuple[Array, float, int]:
        """See `_Divided.explained`."""
        return _explained(self.left[split], self.power[split], self.score[split])

    def most(self, splits: list[int]) -> tuple[tuple[Array, float, int], int]:
        """What the field explains (see `_Divided.explained`) at that of some splits where it is most, and which.

        Of what is explained there is an upper bound, and so most need no eigenvectors.
        """
        bound = {k: most_explained(*_scaled(self.left[k], self.power[k], self.score[k])[:2]) for k in splits}
        first, *others = sorted(splits, key=lambda k: -bound[k])
        best, at = self.explained(first), first
        for k in others:
            if bound[k] >= best[1] and (found := self.explained(k))[1] > best[1]:
                best, at = found, k
        return best, at


def _explained(left: Array, power: Array, score: Array) -> tuple[Array, float, int]:
    """Unknowns (K,), what they explain, how many are told; from (K, K) b^T Q b, the diagonal of b^T b, and b^T r."""
    *scaled, size = _scaled(left, power, score)
    change, test, count = explained(*scaled)
    return -change / size, test, count


def _scaled(left: Array, power: Array, score: Array) -> tuple[Array, Array, Array]:
    """The same in units of the sizes of b, and these."""
    size = np.sqrt(np.maximum(power, np.finfo(float).tiny))
    return left / np.outer(size, size), score / size, size


def _by_place(solved: Solved) -> Array:
    """(O, 2, 3) derivatives of the whitened residuals by the marker's place, in natural units; 0 of held ones."""
    lay, points = solved.problem.layout, solved.problem.marks.points
    dense, eliminated, columns, _ = solved.problem.jacobian(solved.state)
    out = eliminated.copy() if lay.points_eliminated else np.zeros((*dense.shape[:2], 3))
    first = lay.columns.point[points]
    o, k = np.nonzero((columns == first[:, None]) & (first >= 0)[:, None])
    out[o] = dense[o[:, None], :, k[:, None] + np.arange(3)].transpose(0, 2, 1)
    return out


def _field(solved: Solved, points: Ints) -> Array:
    """(N, M) polynomials at the markers, along the axes of their extent: the `FIRST` up to the first degree."""
    x = solved.state.points[points]
    x = (x - x.mean(axis=0)) @ np.linalg.svd(x - x.mean(axis=0), full_matrices=False)[2].T
    x = x / np.maximum(x.std(axis=0), 1e-9 * x.std())
    a, b = np.triu_indices(3)
    return np.column_stack([np.ones(len(x)), x, x[:, a] * x[:, b]])


def _lots(later: Mask) -> list[Mask]:
    """Divisions of the blocks by lot, with as many in the smaller part: each block is in that of one of them.

    None that shares half of its variance or more with the division that is asked for.
    """
    rng, few = np.random.default_rng(0), int(min(later.sum(), (~later).sum()))
    out = list[Mask]()
    for _ in range(LOTS):
        order = rng.permutation(len(later))
        starts = range(0, len(order), few) if 2 * few < len(order) else (0,)  # of two halves each is the other's
        for lot in (np.isin(np.arange(len(order)), order[min(k, len(order) - few) :][:few]) for k in starts):
            if abs(np.corrcoef(lot, later)[0, 1]) < ALIKE:
                out.append(lot)
        if len(out) >= LOTS:
            break
    return out


def _described(job: Job, xyz: Array, moved: Array, points: Ints, edge: tuple[int, int], lead: float) -> Changed:
    """How far the markers at ``xyz`` moved, without what is a motion of all of them."""
    far = np.linalg.norm(align(xyz, xyz + moved, scale=True).apply(xyz) - xyz - moved, axis=1)
    names, worst = [str(job.views[v].name) for v in edge], int(far.argmax())
    rms = float(np.sqrt((far**2).mean()))
    return Changed(names[0], names[1], str(job.markers.name[points[worst]]), float(far[worst]), rms, lead)
