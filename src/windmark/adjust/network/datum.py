"""The datum: which points hold the free motions of a network, and covariances with respect to them.

Shape and interior parameters are the same in every datum; coordinates, poses and their covariances are not. A datum
is a condition B^T dx = 0 on the parameters, one for each free motion G; covariances go over with
S = 1 - G (B^T G)^-1 B^T (S-transformation, Baarda 1973).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network.covariance import NetworkCovariance
from windmark.geometry import DegenerateGeometry

Array = NDArray[np.float64]
Ints = NDArray[np.integer]


@dataclass(frozen=True)
class DatumCovariance:
    """Covariances with the free motions held by chosen points.

    Parameters
    ----------
    network : the covariance as it was solved
    change : (D + E b, g) G (B^T G)^-1
    product : (D + E b, g) Q B
    inner : (g, g) B^T Q B
    """

    network: NetworkCovariance
    change: Array
    product: Array
    inner: Array

    def between(self, rows: Ints, columns: Ints, solved: Array) -> Array:
        """Covariance (..., m, n) of parameters by number, (..., m) and (..., n), from the ``solved`` one of them."""
        change, product = self.change, self.product
        left = change[rows] @ product[columns].swapaxes(-1, -2)
        right = product[rows] @ change[columns].swapaxes(-1, -2)
        return np.asarray(solved - left - right + change[rows] @ self.inner @ change[columns].swapaxes(-1, -2))

    def through(self, vectors: Array) -> Array:
        """Covariance times (D + E b, k), with the free motions held here."""
        return np.asarray(self.network.product(vectors) - self.change @ (self.product.T @ vectors))

    def points(self) -> Array:
        """(N, 3, 3) of all points in the squared length unit; zero where a coordinate is held, NaN if never seen."""
        lay, dense = self.network.layout, self.network.dense
        columns, n = lay.columns, len(lay.columns.point)
        out = np.full((n, 3, 3), np.nan)
        out[np.asarray(columns.held.all(axis=1))] = 0.0
        here = columns.point >= 0
        index = columns.point[here][:, None] + np.arange(3)
        out[here] = self.between(index, index, dense[index[:, :, None], index[:, None, :]])
        if lay.points_eliminated:
            here = columns.point_block >= 0
            block = columns.point_block[here]
            index = lay.dense + 3 * block[:, None] + np.arange(3)
            out[here] = self.between(index, index, self.network.blocks[block])
        free = ~columns.held
        out = np.where(free[:, :, None] & free[:, None, :], out, 0.0)
        return out * lay.unit**2

    def dense(self) -> Array:
        """(D, D) of the dense parameters in natural units."""
        return self.some(np.arange(len(self.network.dense)))

    def some(self, index: Ints) -> Array:
        """(m, m) of some of the dense parameters, by number."""
        return self.between(index, index, self.network.dense[np.ix_(index, index)])


def in_datum(network: NetworkCovariance, points: NDArray[np.bool_] | None = None) -> DatumCovariance:
    """Inner constraints over some points: they neither shift, turn nor (where the scale is free) grow on average.

    Parameters
    ----------
    network : the covariance
    points : (N,) the points of the datum; None takes all that are free

    Raises
    ------
    DegenerateGeometry
        When the chosen points cannot hold the free motions (fewer than three, or all on one line).
    """
    lay, motions = network.layout, network.motions
    columns, g = lay.columns, motions.shape[1]
    chosen = np.ones(len(columns.point), dtype=np.bool_) if points is None else points
    index = [columns.point[chosen & (columns.point >= 0)][:, None] + np.arange(3)]
    if lay.points_eliminated:
        block = columns.point_block[chosen & (columns.point_block >= 0)]
        index.append(lay.dense + 3 * block[:, None] + np.arange(3))
    rows = np.concatenate([i.ravel() for i in index])
    condition = np.zeros_like(motions)
    condition[rows] = motions[rows]
    meet = condition.T @ motions
    if g and not np.linalg.cond(meet) < 1e10:
        raise DegenerateGeometry("the datum's points do not hold the free motions: three are needed, not on a line")
    change = motions @ np.linalg.inv(meet)
    product = network.product(condition)
    return DatumCovariance(network, change, product, condition.T @ product)
