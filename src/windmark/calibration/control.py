"""Does what is known beforehand (control points, held markers, distances) agree with itself and with the pictures?

The pictures alone give the shape of the network, up to a similarity. Known places x0 and distances L see it through
one: x0 = S(x) + e, L = |S(a) - S(b)| + e, so that one that is wrong stands out before it can bend the network or throw
out right marks (Baarda 1968; Caspary, "Concepts of network and deformation analysis", 1987, ch. 5). A block b of these
observations is tested by T = e_b^T W_bb^-1 e_b with e = W y, W the weight matrix that is left of the residuals y after
the similarity; chi-square with as many degrees of freedom as others check it in.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from windmark.calibration.datum import Fixed, Weighted
from windmark.calibration.setup import Job, bars_of
from windmark.calibration.solve import Solved
from windmark.geometry import DegenerateGeometry
from windmark.geometry.rotations import hat
from windmark.geometry.similarity import Similarity, align

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

FALSE = 1e-3
"""Probability that right control is called wrong."""
CHECKED = 1e-6
"""Share of an observation's weight that is left in its residual, below which nothing checks it."""
MOST = 150
"""Points that are tested together, for memory and time; more are tested in groups."""
TRIED = 12
"""Blocks, the worst ones, that are tried as the wrong one at a time."""


@dataclass(frozen=True)
class Control:
    """What is known beforehand, as observations of the network's shape.

    Parameters
    ----------
    point : (K,) markers with known coordinates
    xyz, sigma : (K, 3) these and their 1 sigma; zero where they are held, inf where one is not known
    cov : (3K, 3K) their covariance, zero where one is not known
    bar : (B, 2) markers of the known distances
    length, bar_sigma : (B,)
    distance : (B,) which of the job's distances each one is
    """

    point: Ints
    xyz: Array
    sigma: Array
    cov: Array
    bar: Ints
    length: Array
    bar_sigma: Array
    distance: Ints

    def __len__(self) -> int:
        return len(self.point) + len(self.bar)


@dataclass(frozen=True)
class Verdict:
    """What the test of the control says.

    Parameters
    ----------
    wrong : blocks (markers first, then distances) that contradict all others, with the T that each had
    unclear : blocks of which one is wrong, and which cannot be told; empty where none is or it can
    factor : how many times larger than their sigmas all misfits are where no single block explains it; 1 if they fit
    fit : takes the network onto the right control
    """

    fit: Similarity
    wrong: dict[int, float] = field(default_factory=dict)
    unclear: tuple[int, ...] = ()
    factor: float = 1.0


def control_of(job: Job, seen: Mask) -> Control:
    """The control of a job among the markers that the network has, (N,)."""
    n = len(job.markers)
    sigma = np.full((n, 3), np.inf)
    if isinstance(job.datum, Fixed):
        sigma[job.chosen(job.datum.markers, "datum")] = 0.0
    elif isinstance(job.datum, Weighted):
        sigma = job.known_sigma()
    point = np.flatnonzero(np.isfinite(sigma).any(axis=1) & seen)
    bars = bars_of(job)
    use = np.flatnonzero(seen[bars.first] & seen[bars.second])
    ends = np.stack([bars.first, bars.second], axis=1)[use]
    cov = np.diag(np.where(np.isfinite(sigma[point]), sigma[point], 0.0).ravel() ** 2)
    together = job.known_together(seen)
    if together is not None:
        own = (3 * np.searchsorted(point, together[0])[:, None] + np.arange(3)).ravel()
        cov[np.ix_(own, own)] = together[1].cov
    return Control(point, job.markers.xyz[point], sigma[point], cov, ends, bars.length[use], bars.sigma[use], use)


def judge(control: Control, solved: Solved, rough: Similarity) -> Verdict:
    """Test the control against a free network, leave out what contradicts the rest.

    ``rough`` takes the network near the control, where that itself cannot say.
    """
    groups = max(-(-len(control.point) // MOST), 1)
    out = Verdict(rough)
    for g in range(groups):
        part = _group(control, g, groups)
        found = _judged(part, solved, rough)
        at = np.concatenate([np.arange(g, len(control.point), groups), len(control.point) + np.arange(len(part.bar))])
        out = Verdict(
            found.fit if g == 0 else out.fit, out.wrong | {int(at[b]): t for b, t in found.wrong.items()},
            (*out.unclear, *(int(at[b]) for b in found.unclear)), max(out.factor, found.factor),
        )  # fmt: skip
    return out


def _group(control: Control, g: int, groups: int) -> Control:
    """Every so-many-th point from the g-th on; the distances are with the first."""
    part, bars = slice(g, None, groups), slice(None) if g == 0 else slice(0, 0)
    own = np.arange(control.xyz.size).reshape(-1, 3)[part].ravel()
    return Control(
        control.point[part], control.xyz[part], control.sigma[part], control.cov[np.ix_(own, own)],
        control.bar[bars], control.length[bars], control.bar_sigma[bars], control.distance[bars],
    )  # fmt: skip


def _judged(control: Control, solved: Solved, rough: Similarity) -> Verdict:
    """One block at a time: the one without which all others fit. Where several would do, none can be told."""
    used = np.ones(len(control), dtype=np.bool_)
    wrong: dict[int, float] = {}
    test = _Test(control, solved, rough)
    while True:
        whole, blocks = test(used)
        if _fits(whole, blocks, used):
            return Verdict(test.fit(used), wrong)
        order = np.argsort(np.where(used & (blocks.dof > 0), blocks.p, 2.0), kind="stable")[:TRIED]
        tried = [int(b) for b in order if used[b] and blocks.dof[b]]
        heals = [b for b in tried if test.without(used, b)]
        if len(heals) > 1 and not wrong:
            return Verdict(test.fit(used), {}, tuple(sorted(heals)))
        # Several that could be wrong beside one that is: bad sigmas are the simpler explanation.
        if len(heals) > 1 or (not heals and (not tried or 3 * (len(wrong) + 1) > len(control))):
            every = np.ones(len(control), dtype=np.bool_)
            return Verdict(test.fit(every), factor=float(np.sqrt(max(test(every)[0].value, 1.0))))
        worst = heals[0] if heals else tried[0]
        used[worst] = False
        wrong[worst] = float(blocks.value[worst])


def _fits(whole: _Whole, blocks: _Blocks, used: Mask) -> bool:
    """Whether what is used fits each other, as a whole and one by one."""
    return whole.good and bool((blocks.p[used] > FALSE / max(used.sum(), 1)).all())


@dataclass(frozen=True)
class _Whole:
    """Misfit of all: chi-square over its degrees of freedom, and whether that is chance."""

    value: float
    good: bool


@dataclass(frozen=True)
class _Blocks:
    """T, degrees of freedom and probability of each block."""

    value: Array
    dof: Ints
    p: Array


class _Test:
    """The control beside one free network."""

    def __init__(self, control: Control, solved: Solved, rough: Similarity) -> None:
        self.control, self.solved, self.rough = control, solved, rough
        self.ends = np.unique(np.concatenate([control.point, control.bar.ravel()]))
        self.cov = _joint(solved, self.ends) * solved.scale

    def fit(self, used: Mask) -> Similarity:
        """The similarity from the network to the used control: of the points, else the scale of the distances."""
        control, points = self.control, self.solved.state.points
        own = used[: len(control.point)] & np.isfinite(control.sigma).all(axis=1)
        scale_free = self.solved.covariance.motions.shape[1] == 7
        if own.sum() >= 3:
            # Held points have no sigma of their own: there what counts is how the network knows them.
            spread = np.sqrt(np.maximum(self._own(control.point[own]), 1e-30) + (control.sigma[own] ** 2).mean(axis=1))
            try:
                return align(points[control.point][own], control.xyz[own], weights=1 / spread**2, scale=scale_free)
            except DegenerateGeometry:  # on one line, or mirrored
                return self.rough
        bars = used[len(control.point) :]
        if not (scale_free and bars.any()) or len(control.point):
            return self.rough
        away = points[control.bar[bars, 0]] - points[control.bar[bars, 1]]
        ratio = float(np.median(control.length[bars] / np.linalg.norm(away, axis=1)))
        return Similarity(ratio, self.rough.rotation, ratio / self.rough.scale * self.rough.translation)

    def __call__(self, used: Mask) -> tuple[_Whole, _Blocks]:
        """The test of the used blocks."""
        fit = self.fit(used)
        y, spread, design, block = self._observed(fit)
        mine = used[block]
        y, spread, design, block = y[mine], spread[np.ix_(mine, mine)], design[mine], block[mine]
        weight, rank = _left(spread, design)
        e = weight @ y
        n = len(self.control)
        value, dof, p = np.zeros(n), np.zeros(n, np.int64), np.ones(n)
        scale = np.linalg.inv(spread).diagonal()
        for b in np.unique(block):
            own = block == b
            own_value, vector = np.linalg.eigh(weight[np.ix_(own, own)] / np.sqrt(np.outer(scale[own], scale[own])))
            along = vector.T @ (e[own] / np.sqrt(scale[own]))
            told = own_value > CHECKED
            value[b], dof[b] = float((along[told] ** 2 / own_value[told]).sum()), int(told.sum())
            if dof[b]:
                p[b] = chi2.sf(value[b], dof[b])
        free = len(y) - rank
        total = float(y @ e)
        return _Whole(total / max(free, 1), free <= 0 or chi2.sf(total, free) > FALSE), _Blocks(value, dof, p)

    def without(self, used: Mask, block: int) -> bool:
        """Whether all others fit each other without one block."""
        rest = used.copy()
        rest[block] = False
        return _fits(*self(rest), rest)

    def _own(self, point: Ints) -> Array:
        """(K,) mean variance per coordinate of points in the free network."""
        at = 3 * np.searchsorted(self.ends, point)[:, None] + np.arange(3)
        return np.asarray(self.cov.diagonal()[at].mean(axis=1))

    def _observed(self, fit: Similarity) -> tuple[Array, Array, Array, Ints]:
        """y, its covariance, the similarity's columns, and the block of each row."""
        control, ends = self.control, self.ends
        xyz = fit.apply(self.solved.state.points[ends])
        turn = np.kron(np.eye(len(ends)), fit.scale * fit.rotation)
        cov = turn @ self.cov @ turn.T
        k, known = len(control.point), np.isfinite(control.sigma)
        at = np.searchsorted(ends, control.point)
        by_point = np.zeros((3 * k + len(control.bar), 3 * len(ends)))
        by_point[np.arange(3 * k), (3 * at[:, None] + np.arange(3)).ravel()] = 1.0
        design = np.zeros((len(by_point), 7))
        arm = xyz[at] - xyz.mean(axis=0)
        design[: 3 * k, :3], design[: 3 * k, 3:6] = -hat(arm).reshape(-1, 3), np.tile(np.eye(3), (k, 1))
        scale_free = self.solved.covariance.motions.shape[1] == 7
        design[: 3 * k, 6] = scale_free * arm.ravel()
        a, b = np.searchsorted(ends, control.bar[:, 0]), np.searchsorted(ends, control.bar[:, 1])
        away = xyz[a] - xyz[b]
        there = np.linalg.norm(away, axis=1)
        for n, (i, j) in enumerate(zip(a, b, strict=True)):
            by_point[3 * k + n, 3 * i : 3 * i + 3] = away[n] / there[n]
            by_point[3 * k + n, 3 * j : 3 * j + 3] = -away[n] / there[n]
        design[3 * k :, 6] = scale_free * there
        y = np.concatenate([(control.xyz - xyz[at]).ravel(), control.length - there])
        rows = np.concatenate([known.ravel(), np.ones(len(control.bar), np.bool_)])
        spread = by_point @ cov @ by_point.T
        spread[: 3 * k, : 3 * k] += control.cov
        spread[3 * k :, 3 * k :] += np.diag(control.bar_sigma**2)
        block = np.concatenate([np.repeat(np.arange(k), 3), k + np.arange(len(control.bar))])
        return y[rows], spread[np.ix_(rows, rows)], design[rows], block[rows]


def _left(spread: Array, design: Array) -> tuple[Array, int]:
    """Weights that are left of the residuals after the unknown similarity, and its rank.

    The network's covariance lacks the motions that the similarity has: with a large variance for these added it has an
    inverse, and the residuals' statistics stay as they are.
    """
    size = np.sqrt((design**2).sum(axis=0))
    a = design[:, size > 0] / size[size > 0]
    full = spread + (a @ a.T) * max(float(spread.diagonal().max()), 1e-30) * len(spread)
    full += np.eye(len(full)) * 1e-12 * float(full.diagonal().max())
    inverse = np.linalg.inv(full)
    u, s, _ = np.linalg.svd(a, full_matrices=False)
    u = u[:, s > 1e-9 * s.max(initial=1e-30)]
    inner = u.T @ inverse @ u
    weight = inverse - inverse @ u @ np.linalg.solve(inner, u.T @ inverse)
    return (weight + weight.T) / 2, u.shape[1]


def _joint(solved: Solved, points: Ints) -> Array:
    """(3M, 3M) covariance of points in a free network, in some datum, in squared length units for sigma0 = 1."""
    lay = solved.problem.layout
    columns, d = lay.columns, solved.problem.layout.dense
    start = np.where(
        columns.point[points] >= 0, columns.point[points],
        d + 3 * columns.point_block[points] if lay.points_eliminated else -1,
    )  # fmt: skip
    index = (start[:, None] + np.arange(3)).ravel()
    pick = np.zeros((d + lay.blocks * lay.size, len(index)))
    pick[index, np.arange(len(index))] = 1.0
    return solved.covariance.product(pick)[index] * lay.unit**2
