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
from windmark.calibration.view_changes import explained
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
"""Divisions by lot."""
UNLIKELY = FALSE / 3
"""Probability that a change is said where there is none."""
LEAST_MARKERS = 10
SURE = 2 * np.log(1 / FALSE)
"""Of twice the logarithm of a likelihood, by which one is told from another."""
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
    for n, some in enumerate(ends):
        block[views[np.isin(instants, some)]] = n
    splits = [k for k in range(1, len(ends)) if LEAST <= sum(map(len, ends[:k])) <= len(times) - LEAST]
    best: tuple[float, int] | None = None
    for degree in (1, 2):
        field = _field(solved, points, degree)
        tried = _Divided.of(solved, field[np.searchsorted(points, solved.problem.marks.points)], block)
        (_, test, count), k = max(((tried.explained(np.arange(len(ends)) >= k), k) for k in splits), key=_most)
        lead = float(test / solved.scale - count * np.log(2 * solved.used.sum()))
        if not chance_beside(test, count, solved) < UNLIKELY / (2 * len(splits)) or (best and lead < best[0]):
            continue
        if tried.by_nothing_else(np.arange(len(ends)) >= k, test, count):
            best = lead, k
    if best is None:
        return None
    lead, k = best
    moved = solved.problem.layout.unit * field @ tried.explained(np.arange(len(ends)) >= k)[0].reshape(-1, 3)
    edge = views[instants == ends[k - 1][-1]][-1], views[instants == ends[k][0]][0]
    return _described(job, solved.state.points[points], moved, points, edge, lead)


def _most(found: tuple[tuple[Array, float, int], int]) -> float:
    """What a split explains."""
    return found[0][1]


@dataclass(frozen=True)
class _Divided:
    """Sums over blocks of pictures: J^T b (D + E b, B, K), b^T b and b^T r of a field's K unknowns."""

    solved: Solved
    cross: Array
    power: Array
    score: Array

    @classmethod
    def of(cls, solved: Solved, field: Array, block: Ints) -> _Divided:
        """Of a field (O, M) at the marks' markers; ``block`` (V,) of each view, -1 of none."""
        problem, order = solved.problem, solved.problem.order
        used = solved.used[order]
        b = np.einsum("oij,om->oimj", _by_place(solved), field).reshape(len(order), 2, -1)
        b[~used] = 0.0
        group = np.where(used, block[problem.marks.views], -1)
        count = int(group.max()) + 1
        power, score = np.zeros((count, b.shape[2], b.shape[2])), np.zeros((count, b.shape[2]))
        for n in range(count):
            mine = b[group == n].reshape(-1, b.shape[2])
            power[n], score[n] = mine.T @ mine, mine.T @ solved.residual[order][group == n].ravel()
        return cls(solved, gathered(solved, b, group, count), power, score)

    def explained(self, *divisions: Mask) -> tuple[Array, float, int]:
        """The field's unknowns for divisions of the blocks, what they explain together, and how many are told."""
        cross = [self.cross[:, later].sum(axis=1) for later in divisions]
        through = self.solved.covariance.quadratic(np.concatenate(cross, axis=1))[1]
        power = np.block([[self.power[one & other].sum(axis=0) for other in divisions] for one in divisions])
        score = np.concatenate([self.score[later].sum(axis=0) for later in divisions])
        size = np.sqrt(np.maximum(np.diagonal(power), np.finfo(float).tiny))
        change, test, count = explained((power - through) / np.outer(size, size), score / size)
        return -change / size, test, count

    def by_nothing_else(self, later: Mask, test: float, count: int) -> bool:
        """Whether divisions by lot explain clearly less, and beside this one nothing but chance."""
        lots = _lots(len(later), int((~later).sum()))
        if max((self.explained(lot)[1] for lot in lots), default=0.0) > test - SURE * self.solved.scale:
            return False
        free = self.solved.redundancy - count
        left = (self.solved.sigma0**2 * self.solved.redundancy - test) / max(free, 1)
        both = [self.explained(later, lot) for lot in lots]
        chances = [chdtrc(max(n - count, 1), max(more - test, 0.0) / left) for _, more, n in both]
        return not chances or float(np.median(chances)) > USUAL


def _by_place(solved: Solved) -> Array:
    """(O, 2, 3) derivatives of the whitened residuals by the marker's place, in natural units; 0 of held ones."""
    lay, points = solved.problem.layout, solved.problem.marks.points
    dense, eliminated, _, _ = solved.problem.jacobian(solved.state)
    out = eliminated.copy() if lay.points_eliminated else np.zeros((*dense.shape[:2], 3))
    tied = lay.columns.point[points] >= 0
    out[tied] = dense[tied][:, :, -3:]
    return out


def _field(solved: Solved, points: Ints, degree: int) -> Array:
    """(N, M) polynomials up to a degree at the markers, along the axes of their extent."""
    x = solved.state.points[points]
    x = (x - x.mean(axis=0)) @ np.linalg.svd(x - x.mean(axis=0), full_matrices=False)[2].T
    x = x / np.maximum(x.std(axis=0), 1e-9 * x.std())
    a, b = np.triu_indices(3)
    return np.column_stack([np.ones(len(x)), x] + ([x[:, a] * x[:, b]] if degree > 1 else []))


def _lots(count: int, later: int) -> list[Mask]:
    """Divisions of the blocks by lot, ``later`` of them in the one part; none that has few exchanged."""
    rng, out = np.random.default_rng(0), list[Mask]()
    straight = np.arange(count) >= later
    for _ in range(LOTS):
        lot = rng.permutation(straight)
        same = (lot == straight).mean()
        if 0.25 < same < 0.75:
            out.append(lot)
    return out


def _described(job: Job, xyz: Array, moved: Array, points: Ints, edge: tuple[int, int], lead: float) -> Changed:
    """How far the markers at ``xyz`` moved, without what is a motion of all of them."""
    far = np.linalg.norm(align(xyz, xyz + moved, scale=True).apply(xyz) - xyz - moved, axis=1)
    names, worst = [str(job.views[v].name) for v in edge], int(far.argmax())
    rms = float(np.sqrt((far**2).mean()))
    return Changed(names[0], names[1], str(job.markers.name[points[worst]]), float(far[worst]), rms, lead)
