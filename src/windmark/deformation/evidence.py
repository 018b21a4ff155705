"""What a series says together: the same unknown that the adjustments do not have, over all instants.

What is the same in every instant may be far below the noise of each of them. Beside its adjustment each instant
therefore tells, as in `equations`, score and power of unknowns that would be one and the same in all: how late each
camera takes its pictures, how its pose is off, what the laws lack. Instants are added up; spots are wrong anew in each
of them. What is wrong alike in all of them is not: the markers' own places by their covariance, and spots by a part of
their sigma (`ALIKE`). Either is in the covariance of the sum as what it is.

Poses and what the laws lack may also be in proportion to the load. To each of these unknowns belong some more, one for
each load (`loads_of`), which have a share of it in an instant as large as the load is then.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.equations import CHECKED, Added, Equations
from windmark.deformation.loads import Course, loads_of
from windmark.deformation.patterns import fields_of
from windmark.deformation.sighting import LAW, MOTION
from windmark.deformation.solve import free_names
from windmark.deformation.volumes import Placed

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUNDING = 1e-10
"""Of eigenvalues over the largest one."""
LEAST = 1e-6
"""Share of an unknown that adjustments and other unknowns leave over, below which it is not to be told from these."""
BLOCKS = 64
"""Parts of a series at most between which a step of a camera's lateness is looked for."""
ALIKE = 0.15
"""Part of a spot's sigma by which it is wrong alike in all instants: by its place between pixels, lens and light."""


@dataclass(frozen=True, eq=False)
class Instant:
    """What one instant says of n unknowns that the series would share.

    Parameters
    ----------
    score, power : (n,) B^T r and (n, n) B^T Q B, see `equations`
    size2 : (n,) squared length of the columns B
    by_place : (n, N, 3) B^T Q times the derivative by the markers' own places, in the model's frame
    follow : (F, n) how what is free in it follows one unit of each
    names : (F,) of that
    chi2, redundancy, spots : of the instant
    place : (N, 3) its markers in the tunnel
    load, load_cov : (R,) how large the loads are in it, and their covariance (R, R)
    """

    score: Array
    power: Array
    size2: Array
    by_place: Array
    follow: Array
    names: tuple[str, ...]
    chi2: float
    redundancy: int
    spots: int
    place: Array
    load: Array
    load_cov: Array


def instant_of(
    equations: Equations, views: tuple[str, ...], moving: Array | None, wind_off: bool = False
) -> Instant:
    """What an adjusted instant says of what a series would share.

    Parameters
    ----------
    equations : of the instant
    views : the cameras of the series; unknowns are the lateness of each, in the unit of ``moving``, then six of each
        one's pose, then what the laws lack (`Fields`)
    moving : (N, 3) how far the markers move in the tunnel in one unit of time; None where that is not known
    wind_off : it is one of those that the markers' places are of, in which the laws lack nothing
    """
    added, by_place = equations.added_with_places(_columns(equations, views, moving, wind_off))
    solved, loads = equations.solved, loads_of(equations.solved.task.placed)
    cov, own = np.zeros((loads.shape[1],) * 2), solved.problem.slices.get(LAW)
    if own is not None:
        cov = solved.cov[own, own]
    return Instant(
        added.score, added.power, added.size**2, by_place, added.follow, free_names(solved.problem), solved.chi2,
        solved.redundancy, int(solved.used.sum()), equations.place, loads @ solved.values[LAW], loads @ cov @ loads.T,
    )  # fmt: skip


def _columns(equations: Equations, views: tuple[str, ...], moving: Array | None, wind_off: bool) -> Array:
    """(P, 2 V, n) derivatives of the pixels by all unknowns of the series."""
    count, by_place = len(views), equations.by_place
    late, pose = np.zeros((*by_place.shape[:2], count)), np.zeros((*by_place.shape[:2], count, 6))
    for v, view in enumerate(equations.solved.task.views):
        k, own = views.index(view.name), slice(2 * v, 2 * v + 2)
        pose[:, :, k] = equations.by_pose(v)
        if moving is not None:
            late[:, own, k] = -(by_place[:, own] @ moving[:, :, None])[..., 0]
    fields = fields_of(equations.solved.task.placed)
    lacking = np.zeros((*by_place.shape[:2], 0 if fields is None else fields.field.shape[-1]))
    if fields is not None and not wind_off:
        lacking = by_place @ (equations.solved.values[MOTION].rotation @ fields.field)
    return np.concatenate([late, pose.reshape(*pose.shape[:2], -1), lacking], axis=-1)


@dataclass(frozen=True, eq=False)
class Evidence:
    """The sum of some instants.

    Parameters
    ----------
    views : the cameras of the series
    score, power, by_place, chi2, redundancy, spots : see `Instant`; behind its n unknowns come the poses and what the
        laws lack once more for each load, and last the cameras' lateness and poses once more, in proportion to the time
    products : (1 + R, 1 + R, n) sum of `Instant.size2` times the products of 1 and the loads
    held : what the markers' own places have in ``power``, instant for instant
    course : of the loads
    alone : (V,) sum of squares that the cameras' lateness explains where it may be another one in every instant
    lacking_chi2, lacking_redundancy : of the instants that tell what the laws lack
    instants, moved : how many, and how many of them tell lateness
    drift2 : (7 V,) sum of `Instant.size2` of the lateness and the poses that grow with the time
    blocks : (B, 3, V) score and power of the cameras' lateness of some instants, and when the first of these was
    begin, time : when the first one was, and how long after it the last one
    """

    views: tuple[str, ...]
    score: Array
    power: Array
    products: Array
    by_place: Array
    held: Array
    course: Course
    alone: Array
    chi2: float = 0.0
    lacking_chi2: float = 0.0
    lacking_redundancy: int = 0
    redundancy: int = 0
    spots: int = 0
    instants: int = 0
    moved: int = 0
    drift2: Array = field(default_factory=lambda: np.zeros(0))
    blocks: Array = field(default_factory=lambda: np.zeros((0, 3, 0)))
    begin: float = float("nan")
    time: float = 0.0

    @staticmethod
    def none(views: tuple[str, ...], placed: Placed) -> Evidence:
        """Of no instant yet of these markers."""
        fields, loads = fields_of(placed), len(loads_of(placed))
        one = 6 * len(views) + (0 if fields is None else fields.field.shape[-1])
        n = 8 * len(views) + (1 + loads) * one
        return Evidence(
            views, np.zeros(n), np.zeros((n, n)), np.zeros((1 + loads, 1 + loads, len(views) + one)),
            np.zeros((n, len(placed.xyz), 3)), np.zeros((n, n)), Course.none(loads), np.zeros(len(views)),
            drift2=np.zeros(7 * len(views)), blocks=np.zeros((0, 3, len(views))),
        )  # fmt: skip

    @property
    def late(self) -> Ints:
        """The cameras' lateness among the unknowns."""
        return np.arange(len(self.views))

    @property
    def drift(self) -> Ints:
        """By how much that grows in one unit of time."""
        return np.arange(len(self.score) - 7 * len(self.views), len(self.score) - 6 * len(self.views))

    @property
    def drifting_poses(self) -> Ints:
        """By how much their poses change in one unit of time."""
        return np.arange(len(self.score) - 6 * len(self.views), len(self.score))

    @property
    def poses(self) -> Ints:
        """Their poses, the same in all instants."""
        return np.arange(len(self.views), 7 * len(self.views))

    @property
    def lacking(self) -> Ints:
        """What the laws lack in the same way in all instants."""
        return np.arange(7 * len(self.views), self.products.shape[-1])

    def with_loads(self, which: Ints) -> Ints:
        """Poses or what the laws lack, and then for each load as much of them as belongs to it."""
        one = self.products.shape[-1] - len(self.views)
        return np.concatenate([which + k * one for k in range(len(self.products))])

    @property
    def size2(self) -> Array:
        """Squared lengths of the columns of all unknowns, see `Instant`."""
        late, every = len(self.views), np.arange(len(self.products))
        return np.concatenate([self.products[0, 0, :late], self.products[every, every, late:].ravel(), self.drift2])

    def by_factors(self, factors: Array) -> Evidence:
        """The same with some combinations (k, 1 + R) of 1 and the loads in place of these; the first of them is 1."""
        late = len(self.views)
        rest = np.kron(factors, np.eye(self.products.shape[-1] - late))
        by = np.zeros((len(rest) + 8 * late, len(self.score)))
        by[:late, :late], by[-7 * late :, -7 * late :] = np.eye(late), np.eye(7 * late)
        by[late : -7 * late, late : -7 * late] = rest
        return replace(
            self, score=by @ self.score, power=by @ self.power @ by.T, held=by @ self.held @ by.T,
            by_place=np.tensordot(by, self.by_place, axes=1),
            products=np.einsum("ij,jkn,lk->iln", factors, self.products, factors),
        )  # fmt: skip

    def beside(self, test: float) -> tuple[float, int]:
        """Sum of squares and its redundancy, beside which something explains ``test`` of it.

        Residuals may be larger than stated; smaller ones, as of frames that the table was corrected by, make nothing
        more likely.
        """
        return max(self.chi2, self.redundancy + test), self.redundancy

    def plus(
        self, instant: Instant, place_cov: Array | None, wind_off: bool = False, when: float = 0.0
    ) -> Evidence:
        """One instant more, adjusted with ``place_cov`` (N, 3, 3); ``wind_off`` where the places are of it."""
        begin = self.begin if np.isfinite(self.begin) else when
        time = when - begin
        late = self.late
        power, told = instant.power[late, late], instant.power[late, late] > LEAST * instant.size2[late]
        tells = bool(np.diag(instant.power)[self.lacking].any())
        course = self.course.plus(instant.load, instant.load_cov, wind_off) if wind_off or tells else self.course
        own = np.r_[1.0, instant.load]
        rest = np.arange(len(late), len(instant.score))
        grow = np.arange(7 * len(late))
        which = np.r_[late, np.tile(rest, len(own)), grow]
        share = np.r_[np.ones(len(late)), np.repeat(own, len(rest)), np.full(len(grow), time)]
        held = by_places(instant.by_place, place_cov)
        return replace(
            self, alone=self.alone + np.where(told, instant.score[late] ** 2 / np.where(told, power, 1.0), 0.0),
            moved=self.moved + bool(told.any()), score=self.score + share * instant.score[which],
            power=self.power + np.outer(share, share) * instant.power[np.ix_(which, which)],
            products=self.products + np.multiply.outer(np.outer(own, own), instant.size2),
            by_place=self.by_place + share[:, None, None] * instant.by_place[which],
            held=self.held + np.outer(share, share) * held[np.ix_(which, which)], course=course,
            chi2=self.chi2 + instant.chi2, redundancy=self.redundancy + instant.redundancy,
            lacking_chi2=self.lacking_chi2 + instant.chi2 * tells,
            lacking_redundancy=self.lacking_redundancy + instant.redundancy * tells,
            spots=self.spots + instant.spots, instants=self.instants + 1,
            drift2=self.drift2 + time**2 * instant.size2[grow], begin=begin, time=time,
            blocks=_blocks(self.blocks, np.array([instant.score[late], power, np.full(len(late), when)])),
        )  # fmt: skip

    def added(self, which: Ints, beside: Ints, place_cov: Array | None) -> Added:
        """Some unknowns with others free beside them, as `Equations.added` has those of one instant.

        Power is the inverse covariance of what the sum tells: with b' = b - P_b,beside P_beside^-1 b_beside of score
        and power, b = -P'^-1 s' has the covariance P'^-1 C P'^-1, C that of s'.
        """
        sums = Sums(self.score, self.power, self.held, self.by_place, self.size2, self.instants)
        return sums.added(which, beside, place_cov)


def _blocks(blocks: Array, instant: Array) -> Array:
    """Those and an instant (3, V) more; pairs of them where there are too many."""
    if len(blocks) == BLOCKS:
        blocks = np.stack([blocks[::2, 0] + blocks[1::2, 0], blocks[::2, 1] + blocks[1::2, 1], blocks[::2, 2]], axis=1)
    return np.concatenate([blocks, instant[None]])


class Sums(NamedTuple):
    """The sum over some instants of what they say of n unknowns, see `Evidence`."""

    score: Array
    power: Array
    held: Array
    by_place: Array
    size2: Array
    instants: int

    def added(self, which: Ints, beside: Ints, place_cov: Array | None) -> Added:
        """Some of them with others free beside them, see `Evidence.added`."""
        both, n = np.concatenate([which, beside]), len(which)
        power = self.power[np.ix_(both, both)]
        cov = power * (1 + ALIKE**2 * self.instants) - self.held[np.ix_(both, both)]
        cov += by_places(self.by_place[both], place_cov)
        size2 = self.size2[both]
        scale = np.sqrt(np.where(size2 > 0, size2, 1.0))
        power, cov = power / np.outer(scale, scale), cov / np.outer(scale, scale)
        taken = -power[:n, n:] @ np.linalg.pinv(power[n:, n:], CHECKED, hermitian=True)
        by = np.concatenate([np.eye(n), taken], axis=1)
        score, cov, power = by @ (self.score[both] / scale), by @ cov @ by.T, power[:n, :n] + taken @ power[n:, :n]
        value, vector = np.linalg.eigh(power)
        told = value > LEAST
        value, vector = value[told], vector[:, told]
        weight = value[:, None] * np.linalg.pinv(vector.T @ cov @ vector, ROUNDING, hermitian=True)
        back = vector * scale[:n, None]
        told_by = back @ (weight * value) @ back.T
        size = np.sqrt(np.diag(told_by))
        return Added(
            back @ (weight @ (vector.T @ score)), told_by, np.where(size > 0, size, 1.0), np.zeros((0, n))
        )


def by_places(by_place: Array, place_cov: Array | None) -> Array:
    """(n, n) covariance of scores with derivatives (n, N, 3) by the markers' places."""
    if place_cov is None:
        return np.zeros((len(by_place), len(by_place)))
    flat = (by_place[:, :, None, :] @ place_cov).reshape(len(by_place), -1)
    return np.asarray(flat @ by_place.reshape(len(by_place), -1).T)
