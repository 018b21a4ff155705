"""Unknowns that might be missing: how much of the misfit they explain, without solving again.

With the whitened residuals r, their cofactors Q = 1 - J C J^T and the columns B of unknowns b that the adjustment does
not have, these are -(B^T Q B)^-1 B^T r, and the sum of squares would fall by T = (B^T r)^T (B^T Q B)^-1 B^T r
(Baarda 1967; Teunissen, "Testing theory", 2000, ch. 4).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.sighting import LAW, MOTION, by_place, in_tunnel, pose_block
from windmark.deformation.solve import Solved
from windmark.geometry import Pose
from windmark.geometry.rotations import hat

Array = NDArray[np.float64]

CHECKED = 1e-4
"""Share of a direction of unknowns that the adjustment's own leave over, below which it cannot be told from them."""


class Equations:
    """The linearised equations of an adjusted instant."""

    def __init__(self, solved: Solved) -> None:
        found = solved.sighting.raw_jacobian(solved.values)
        assert found is not None  # the engine never stands where the model has no prediction
        self.solved, self._whitener = solved, solved.sighting.whitener
        self.residual = (self._whitener @ found[0][..., None])[..., 0]
        self.jacobian = (self._whitener @ found[1]).reshape(self.residual.size, -1)

    @cached_property
    def _cov(self) -> Array:
        """(F, F); law parameters that ended at a bound stay there."""
        held, names = self.solved.at_bound, self.solved.task.volumes.names
        if not held:
            return self.solved.cov
        free = np.ones(len(self.solved.cov))
        free[: len(names)] = [n not in held for n in names]  # the laws come first
        return self.solved.cov * np.outer(free, free)

    @cached_property
    def place(self) -> Array:
        """(P, 3) where the markers are in the tunnel."""
        task, values = self.solved.task, self.solved.values
        return in_tunnel(task.placed.place(values[LAW]), task.wall, values[MOTION])

    @cached_property
    def _by_law(self) -> Array:
        """(P, 3, K) derivative of the markers' places in the model by the laws' parameters."""
        return np.asarray(self.solved.task.placed.linearise(self.solved.values[LAW])[1])

    def moved(self, change: Array) -> Array:
        """(P, 3) displacement of the markers in the model's frame for a change (F,) of all that is free.

        The model's rigid motion is part of it, that of the cameras is not.
        """
        task, values, slices = self.solved.task, self.solved.values, self.solved.problem.slices
        out = np.zeros((len(task.placed.xyz), 3))
        if LAW in slices:
            out += self._by_law @ change[slices[LAW]]
        if MOTION in slices and len(change[slices[MOTION]]):
            turn, shift = change[slices[MOTION]].reshape(2, 3)
            out += (np.cross(turn, self.place) + shift) @ values[MOTION].rotation
        return np.where(task.wall[:, None], 0.0, out)

    @cached_property
    def by_place(self) -> Array:
        """(P, 2 V, 3) derivative of the pixels by the markers' places in the tunnel."""
        return by_place(self.solved.sighting.sights, self.solved.values, self.place)

    def by_pose(self, view: int) -> Array:
        """(P, 2 V, 6) derivative of the pixels by one view's pose."""
        pose: Pose = self.solved.values[pose_block(self.solved.task.views[view].name)]
        own = slice(2 * view, 2 * view + 2)
        change = np.concatenate([-hat(pose.apply(self.place)), np.tile(np.eye(3), (len(self.place), 1, 1))], axis=-1)
        out = np.zeros((*self.by_place.shape[:2], 6))
        out[:, own] = self.by_place[:, own] @ pose.rotation.T @ change
        return out

    def added(self, columns: Array) -> Added:
        """Unknowns with derivatives of the pixels (P, 2 V, m)."""
        b = (self._whitener @ columns).reshape(self.residual.size, -1)
        return self._added(b, self.jacobian, self.residual.ravel())

    def added_with_places(self, columns: Array) -> tuple[Added, Array]:
        """`added`, and the derivatives of its score (m, P, 3) by the markers' own places in the frame they are of."""
        task, turn = self.solved.task, self.solved.values[MOTION].rotation
        b = self._whitener @ columns
        own = self._whitener @ (self.by_place @ np.where(task.wall[:, None, None], np.eye(3), turn))
        added = self._added(b.reshape(self.residual.size, -1), self.jacobian, self.residual.ravel())
        by_free = np.swapaxes(self.jacobian.reshape(*self.residual.shape, -1), 1, 2) @ own
        by_place = np.swapaxes(b, 1, 2) @ own + added.follow.T @ by_free
        return added, np.swapaxes(by_place, 0, 1)

    def held(self, which: NDArray[np.int64]) -> Added:
        """Law parameters (by number) that the adjustment holds at their bounds; the laws come first."""
        return self._added(self.jacobian[:, which], self.jacobian, self.residual.ravel())

    def laws_of(self, view: int) -> Added:
        """Changes of the laws' parameters that one view alone sees."""
        rows, laws = slice(2 * view, 2 * view + 2), len(self.solved.task.volumes.names)
        own = self.jacobian.reshape(*self.residual.shape, -1)[:, rows].reshape(-1, self.jacobian.shape[1])
        return self._added(own[:, :laws], own, self.residual[:, rows].ravel())  # the laws come first

    def _added(self, b: Array, jacobian: Array, residual: Array) -> Added:
        """Unknowns that move whitened residuals (R,) by ``b`` (R, m), with the derivatives of these (R, F)."""
        cross = jacobian.T @ b
        follow = -self._cov @ cross
        size = np.sqrt((b**2).sum(axis=0))
        return Added(b.T @ residual, b.T @ b + cross.T @ follow, np.where(size > 0, size, 1.0), follow)


@dataclass(frozen=True)
class Added:
    """Unknowns beside those of the adjustment.

    Parameters
    ----------
    score : (m,) B^T r
    power : (m, m) B^T Q B
    size : (m,) length of the columns of B
    follow : (F, m) how the adjustment's own unknowns follow one unit of each
    """

    score: Array
    power: Array
    size: Array
    follow: Array

    def fitted(self, which: NDArray[np.int64]) -> tuple[float, int, Array, Array]:
        """T, the number of unknowns that can be told, their values (k,) and covariance (k, k), of some of them.

        What can hardly be told fades out, and so T is rather too small than too large.
        """
        size = self.size[which]
        value, vector = np.linalg.eigh(self.power[np.ix_(which, which)] / np.outer(size, size))
        value, vector = np.maximum(value, 0.0), vector / size[:, None]
        soft = value + CHECKED
        along = vector.T @ self.score[which]
        rank = int(np.ceil((value / soft).sum()))
        return float((along**2 / soft).sum()), rank, -(vector / soft) @ along, (vector * value / soft**2) @ vector.T

    def each(self, groups: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
        """T (G,) and the number of unknowns (G,) of groups of them (G, k) by themselves; -1 fills a group up."""
        there = groups >= 0
        both = there[:, :, None] & there[:, None, :]
        size = self.size[groups]
        power = self.power[groups[:, :, None], groups[:, None, :]] / (size[:, :, None] * size[:, None, :])
        value, vector = np.linalg.eigh(np.where(both, power, 0.0))
        value = np.maximum(value, 0.0)
        along = np.einsum("gij,gi->gj", vector, np.where(there, self.score[groups] / size, 0.0))
        soft = value + CHECKED
        return (along**2 / soft).sum(axis=1), np.ceil((value / soft).sum(axis=1)).astype(np.int64)
