"""Growing a lattice from a seed: predict the next cell from its neighbours, take the spot that is there.

A cell's place is predicted by a quadratic in column and row through the labelled cells round it, with a prior on the
curvature: perspective and lens bend a lattice smoothly. The fit also says how far to trust it, so that cells
with many neighbours come first and the others wait. All distances are in cells: the local steps are the unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.calibration.board.seeds import Seed

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

REACH = 3  # cells to each side that predict a cell
_ROOM = 400  # columns and rows to each side of the seed
NOISE = 0.03  # 1 sigma of a spot's place, cells: it only has to be small
_CURVATURE = 0.10  # 1 sigma of the second differences, cells: a board seen at 60 degrees that fills the picture
_BEND = 0.004  # 1 sigma of what a quadratic leaves, times distance^3
_SURE = 0.12  # smaller sigma is good enough at once
_MORE = 1.15  # an empty cell is tried again once it has so many times the neighbours
_TRUST = 0.16  # larger sigma of a prediction waits for more neighbours
_GATE = (0.12, 0.30)  # least and largest distance from the prediction
_RIVAL = 2.0  # another spot must be so many times farther off

_OFFSETS = np.array(
    [(u, v) for u in range(-REACH, REACH + 1) for v in range(-REACH, REACH + 1) if (u, v) != (0, 0)], dtype=np.int64
)
_u, _v = _OFFSETS.T.astype(float)
_DESIGN = np.stack([np.ones_like(_u), _u, _v, _u * _u / 2, _u * _v, _v * _v / 2], axis=1)
_WEIGHT = 1 / (NOISE**2 + (_BEND * np.hypot(_u, _v) ** 3) ** 2)
_PRIOR = np.diag([1e-4, 1e-2, 1e-2, *(1 / _CURVATURE**2,) * 3])
_OUTER = np.einsum("k,ki,kj->kij", _WEIGHT, _DESIGN, _DESIGN).reshape(len(_OFFSETS), 36)


class Prediction(NamedTuple):
    """Where cells should be.

    Parameters
    ----------
    xy : (M, 2) pixels
    steps : (M, 2, 2) pixels per column and per row, as rows
    sigma : (M,) 1 sigma, cells
    """

    xy: Array
    steps: Array
    sigma: Array

    def distance(self, xy: Array) -> Array:
        """(M, ...) distance of pixels (M, ..., 2) from the places, in cells."""
        (ax, ay), (bx, by) = self.steps[:, 0].T, self.steps[:, 1].T
        det = ax * by - ay * bx
        det = np.where(np.abs(det) > 1e-9, det, 1e-9)
        shape = (-1,) + (1,) * (xy.ndim - 2)
        dx, dy = np.moveaxis(xy - self.xy.reshape(*shape, 2), -1, 0)
        ax, ay, bx, by, det = (w.reshape(shape) for w in (ax, ay, bx, by, det))
        return np.hypot((dx * by - dy * bx) / det, (dy * ax - dx * ay) / det)


@dataclass
class Lattice:
    """Spots on the cells of a lattice while it grows.

    Parameters
    ----------
    xy : (N, 2) all spots
    table : (S, S) spot of each cell, -1 for none; the seed is in the middle
    cell : (N, 2) place of each spot in the table, -1 for none
    """

    xy: Array
    table: Ints
    cell: Ints

    @staticmethod
    def start(xy: Array, seed: Seed) -> Lattice:
        """The seed alone."""
        size = 2 * min(_ROOM, len(xy)) + 2 * REACH + 1
        lattice = Lattice(xy, np.full((size, size), -1, dtype=np.int64), np.full((len(xy), 2), -1, dtype=np.int64))
        lattice.put(np.array([[size // 2, size // 2]]), np.array([seed.spot]))
        return lattice

    def put(self, cells: Ints, spots: Ints) -> None:
        """Spots onto cells."""
        self.table[cells[:, 0], cells[:, 1]] = spots
        self.cell[spots] = cells

    def drop(self, spots: Ints) -> None:
        """Take spots off."""
        cells = self.cell[spots]
        self.table[cells[:, 0], cells[:, 1]] = -1
        self.cell[spots] = -1

    @property
    def spots(self) -> Ints:
        """Labelled spots."""
        return np.flatnonzero(self.cell[:, 0] >= 0)

    def neighbours(self, cells: Ints) -> Ints:
        """(M, 48) spots of the cells round each, -1 for none."""
        return self.table[cells[:, 0, None] + _OFFSETS[:, 0], cells[:, 1, None] + _OFFSETS[:, 1]]

    def predict(self, cells: Ints) -> Prediction:
        """Where cells should be, from their neighbours alone."""
        near = self.neighbours(cells)
        there = (near >= 0).astype(float)
        normal = (there @ _OUTER).reshape(-1, 6, 6) + _PRIOR
        middle = (self.xy[near] * there[..., None]).sum(axis=1) / np.maximum(there.sum(axis=1), 1)[:, None]
        values = (self.xy[near] - middle[:, None]) * (there * _WEIGHT)[..., None]
        inverse = np.linalg.inv(normal)
        fit = inverse @ np.einsum("ki,mkc->mic", _DESIGN, values)
        return Prediction(fit[:, 0] + middle, fit[:, 1:3], np.sqrt(inverse[:, 0, 0]))

    def beside(self, cells: Ints, reach: int = 1) -> Ints:
        """Empty cells at most so many steps along columns and rows from one of these, each once."""
        size = len(self.table)
        beside = np.concatenate([cells + s for s in _OFFSETS[np.abs(_OFFSETS).sum(axis=1) <= reach]])
        beside = beside[((beside >= REACH) & (beside < size - REACH)).all(axis=1)]
        beside = beside[self.table[beside[:, 0], beside[:, 1]] < 0]
        return np.stack(np.divmod(np.unique(beside[:, 0] * size + beside[:, 1]), size), axis=1)


def grow(xy: Array, tree: cKDTree, seed: Seed) -> Lattice:
    """The lattice that a seed belongs to."""
    lattice = Lattice.start(xy, seed)
    middle = lattice.cell[seed.spot]
    around = np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1], [1, -1], [-1, 1]])
    places = xy[seed.spot] + around @ seed.steps
    start = Prediction(places, np.broadcast_to(seed.steps, (8, 2, 2)), np.full(8, 0.1))
    chosen, spots = take(lattice, tree, start, _GATE)
    lattice.put((middle + around)[chosen], spots)
    fill(lattice, tree, _GATE)
    return lattice


def fill(lattice: Lattice, tree: cKDTree, gate: tuple[float, float]) -> None:
    """Label what is beside the labelled cells, the surest first, until nothing is left."""
    support = np.zeros(lattice.table.shape, dtype=np.int16)  # neighbours at the last attempt
    rim = lattice.beside(lattice.cell[lattice.spots])
    while True:
        count = (lattice.neighbours(rim) >= 0).sum(axis=1)
        new = count > _MORE * support[rim[:, 0], rim[:, 1]]
        cells, count = rim[new], count[new]
        if not len(cells):
            return
        at = lattice.predict(cells)
        sure = at.sigma <= np.clip(1.3 * at.sigma.min(), _SURE, _TRUST)
        if not sure.any():
            return
        cells, at = cells[sure], Prediction(*(value[sure] for value in at))
        support[cells[:, 0], cells[:, 1]] = count[sure]
        chosen, spots = take(lattice, tree, at, gate)
        lattice.put(cells[chosen], spots)
        rim = np.concatenate([rim, lattice.beside(cells[chosen])])
        rim = rim[lattice.table[rim[:, 0], rim[:, 1]] < 0]
        rim = np.unique(rim, axis=0) if len(chosen) else rim


def take(lattice: Lattice, tree: cKDTree, at: Prediction, gate: tuple[float, float]) -> tuple[Ints, Ints]:
    """Places that have one spot near enough, and that spot; no spot twice."""
    k = min(4, len(lattice.xy))
    near = tree.query(at.xy, k=np.arange(1, k + 1))[1]
    distance = at.distance(lattice.xy[near])
    distance[lattice.cell[near, 0] >= 0] = np.inf
    order = np.argsort(distance, axis=1)
    distance, near = np.take_along_axis(distance, order, 1), np.take_along_axis(near, order, 1)
    good = distance[:, 0] < np.clip(3 * at.sigma, *gate)
    if k > 1:
        good &= distance[:, 1] > _RIVAL * distance[:, 0]
    chosen = np.flatnonzero(good)
    chosen = chosen[np.argsort(distance[chosen, 0], kind="stable")]
    spots, first = np.unique(near[chosen, 0], return_index=True)
    return chosen[first], spots
