"""What is known beforehand, as observations of a free network's shape, and how well they agree with it and each other.

The pictures alone give the shape of the network, up to a similarity. Known places x0 and distances L see it through
one: x0 = S(x) + e, L = |S(a) - S(b)| + e, so that one that is wrong stands out before it can bend the network or throw
out right marks (Baarda 1968; Caspary, "Concepts of network and deformation analysis", 1987, ch. 5). A block b of these
observations is tested by T = e_b^T W_bb^-1 e_b with e = W y, W the weight matrix that is left of the residuals y after
the similarity; chi-square with as many degrees of freedom as others check it in. Without the block, W and the sum of
squares are W - W_b W_bb^-1 W_b^T and less by T: its places are unknowns then.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

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
LINEAR = 1e-3
"""Of rotation and scale: one that is farther from another takes the observations anew; the error is its square."""
HALVINGS = 8
"""Steps in which it is found how far control is off: to half a percent of the largest misfit."""


def chance(total: float, free: int) -> bool:
    """Whether a sum of squares is what so many degrees of freedom leave to chance.

    One that is nothing, as of two equal distances, is by rounding less than that, where there is no probability.
    """
    return free <= 0 or bool(chdtrc(free, max(total, 0.0)) > FALSE)


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
class Seen:
    """Observations of the used control, at one similarity.

    Parameters
    ----------
    fit : the similarity that they were taken at
    y : (M,) known minus seen
    weight : (M, M) what is left of their weights after the unknown similarity
    scale : (M,) their own weights
    block : (M,) which block each is of
    free : degrees of freedom
    count : number of blocks of the control
    """

    fit: Similarity
    y: Array
    weight: Array
    scale: Array
    block: Ints
    free: int
    count: int

    @property
    def total(self) -> float:
        """The misfit of all, chi-square with `free` degrees of freedom."""
        return float(self.y @ self.weight @ self.y)

    @property
    def value(self) -> float:
        """The same over its degrees of freedom."""
        return self.total / max(self.free, 1)

    def blocks(self) -> Blocks:
        """T of each block."""
        e, n = self.weight @ self.y, self.count
        value, dof, p = np.zeros(n), np.zeros(n, np.int64), np.ones(n)
        for b in np.unique(self.block):
            own = np.flatnonzero(self.block == b)
            left, axes = self._left_of(own)
            along = axes.T @ (e[own] / np.sqrt(self.scale[own]))
            value[b], dof[b] = float((along**2 / left).sum()), len(left)
        told = dof > 0
        p[told] = chdtrc(dof[told], value[told])
        return Blocks(value, dof, p)

    def _left_of(self, own: Ints) -> tuple[Array, Array]:
        """Share of the weight of some observations that is left, along the directions that others check."""
        root = np.sqrt(self.scale[own])
        left, axes = np.linalg.eigh(self.weight[np.ix_(own, own)] / np.outer(root, root))
        told = left > CHECKED
        return left[told], axes[:, told]

    def without(self, block: int) -> Seen:
        """The same observations less one block: its places are unknowns then, whose share of the weights goes."""
        own, rest = np.flatnonzero(self.block == block), np.flatnonzero(self.block != block)
        left, axes = self._left_of(own)
        half = (self.weight[np.ix_(rest, own)] / np.sqrt(self.scale[own])) @ axes / np.sqrt(left)
        return Seen(
            self.fit, self.y[rest], self.weight[np.ix_(rest, rest)] - half @ half.T, self.scale[rest],
            self.block[rest], self.free - len(left), self.count,
        )  # fmt: skip


@dataclass(frozen=True)
class Blocks:
    """T, degrees of freedom and probability of each block."""

    value: Array
    dof: Ints
    p: Array


class Test:
    """The control beside one free network."""

    def __init__(self, control: Control, solved: Solved, rough: Similarity) -> None:
        self.control, self.solved, self.rough = control, solved, rough
        self.ends = np.unique(np.concatenate([control.point, control.bar.ravel()]))
        self.cov = joint(solved, self.ends) * solved.scale

    def exchanged(self, a: int, b: int) -> Test:
        """The same with two points in each other's place."""
        point = self.control.point.copy()
        point[[a, b]] = point[[b, a]]
        other = copy(self)
        other.control = replace(self.control, point=point)
        return other

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

    def of(self, used: Mask, more: float = 0.0) -> Seen:
        """The used blocks, at the similarity that fits them; ``more``: 1 sigma that known points are off besides."""
        fit = self.fit(used)
        y, spread, design, block = self._observed(fit)
        mine = used[block]
        y, spread, design, block = y[mine], spread[np.ix_(mine, mine)], design[mine], block[mine]
        spread = spread + np.diag(np.where(block < len(self.control.point), more**2, 0.0))
        weight, rank = _left(spread, design)
        return Seen(fit, y, weight, np.linalg.inv(spread).diagonal(), block, len(y) - rank, len(self.control))

    def without(self, seen: Seen, used: Mask, block: int) -> Seen:
        """The used blocks, those of ``seen`` but one: anew only where the similarity is another without it."""
        return self.of(used) if self.turned(seen, used) else seen.without(block)

    def turned(self, seen: Seen, used: Mask) -> bool:
        """Whether the similarity of the used blocks is another than that of ``seen``."""
        old, new = seen.fit, self.fit(used)
        return bool(max(np.abs(new.rotation - old.rotation).max(), abs(new.scale / old.scale - 1)) > LINEAR)

    def off(self, whole: Seen) -> float:
        """How far known points are off besides their sigmas, 1 sigma per coordinate in length units: what makes all
        misfits chance (Paule & Mandel 1982); 0 where none are known.
        """
        if not len(self.control.point) or whole.free <= 0:
            return 0.0
        every = np.ones(len(self.control), dtype=np.bool_)
        low, high = 0.0, float(np.abs(whole.y[whole.block < len(self.control.point)]).max(initial=0.0))
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            low, high = (middle, high) if self.of(every, middle).value > 1 else (low, middle)
        return (low + high) / 2

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


def joint(solved: Solved, points: Ints, rows: Ints | None = None) -> Array:
    """(3R, 3M) covariance of points (rows) with points of an adjusted network, in squared length units for sigma0 = 1.

    ``rows`` are all of ``points`` by default. Of a free network it is in some datum.
    """
    lay = solved.problem.layout
    columns, d = lay.columns, solved.problem.layout.dense

    def index(of: Ints) -> Ints:
        start = np.where(
            columns.point[of] >= 0, columns.point[of],
            d + 3 * columns.point_block[of] if lay.points_eliminated else -1,
        )  # fmt: skip
        return np.asarray((start[:, None] + np.arange(3)).ravel(), dtype=np.int64)

    own = index(points)
    pick = np.zeros((d + lay.blocks * lay.size, len(own)))
    pick[own, np.arange(len(own))] = 1.0
    return solved.covariance.product(pick)[own if rows is None else index(rows)] * lay.unit**2
