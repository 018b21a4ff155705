"""Covariances of an adjusted network, marginal over everything else, in any datum.

With the Schur complement S, Cov_dd = S^-1, Cov_ed = -H_ee^-1 H_ed S^-1, and of each eliminated block Cov_ee is H_ee^-1
and what that adds: all points for one product of matrices. The free motions are held by the dense parameters there;
another datum is another choice of what does not move, and covariances go over by an S-transformation (Baarda 1973;
Teunissen 1985).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

from windmark.adjust.network.linear import single_thread
from windmark.geometry import DegenerateGeometry

if TYPE_CHECKING:
    from windmark.adjust.network.equations import NetworkEquations
    from windmark.adjust.network.layout import Layout

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


STRIP = 256
"""Rows that are mirrored at a time."""


@dataclass(frozen=True)
class NetworkCovariance:
    """Covariance of the natural parameters of a network, the free motions held in some datum.

    Parameters
    ----------
    dense : (D, D) of the dense parameters
    blocks : (E, b, b) of the eliminated ones
    own : (E, b, b) H_ee^-1, what remains of that when the dense parameters are known
    half : (E b, D) H_ee^-1 H_ed: minus the derivative of the eliminated parameters by the dense ones
    motions : (D + E b, g) the free motions
    layout : numbering of the parameters
    """

    dense: Array
    blocks: Array
    own: Array
    half: Array
    motions: Array
    layout: Layout

    def marginal(self, index: Ints) -> Array:
        """(m, m) covariance of some parameters by number; eliminated ones among them must be of one block."""
        d, size = len(self.dense), self.blocks.shape[1]
        away = index >= d
        out = np.empty((len(index), len(index)))
        top, low = index[~away], index[away] - d
        out[np.ix_(~away, ~away)] = self.dense[np.ix_(top, top)]
        if len(low):
            blocks = np.unique(low // size)
            if len(blocks) > 1:
                raise ValueError(f"marginal: eliminated parameters must be of one block, got {len(blocks)}")
            cross = -self.half[low] @ self.dense[:, top]
            out[np.ix_(away, ~away)], out[np.ix_(~away, away)] = cross, cross.T
            out[np.ix_(away, away)] = self.blocks[blocks[0]][np.ix_(low % size, low % size)]
        return out

    def moved(self, rotation: Array, layout: Layout) -> NetworkCovariance:
        """That of the same network in a frame turned, shifted and scaled; ``layout`` is that of the network there.

        In natural units only points' steps have directions of the frame; those of poses are the cameras' own.
        """
        start = layout.columns.point[layout.columns.point >= 0]
        index = (start[:, None] + np.arange(3)).ravel()

        def turned(rows: Array) -> Array:
            return np.asarray((rotation @ rows.reshape(-1, 3, rows.shape[-1])).reshape(rows.shape))

        dense, blocks, own, half, motions = self.dense, self.blocks, self.own, self.half, self.motions.copy()
        motions[index] = turned(motions[index])
        if layout.points_eliminated:
            blocks, own, half = rotation @ blocks @ rotation.T, rotation @ own @ rotation.T, turned(half)
            motions[len(dense) :] = turned(motions[len(dense) :])
        if len(index):
            dense, half = dense.copy(), half.copy()
            dense[index] = turned(dense[index])
            for array in (dense, half):
                array[:, index] = turned(array[:, index].T).T
        return NetworkCovariance(dense, blocks, own, half, motions, layout)

    def product(self, vectors: Array) -> Array:
        """Covariance times (D + E b, k)."""
        upper = self.dense @ self._left(vectors)
        return np.concatenate([upper, self._by_own(vectors) - self.half @ upper])

    def quadratic(self, vectors: Array, rows: Ints) -> tuple[Array, Array]:
        """Some of the first ``rows`` (m,) of `product`, (m, k), and (k, k) vectors^T times all of it."""
        left = self._left(vectors)
        some, out = self.dense[rows] @ left, np.zeros((left.shape[1],) * 2, order="F")
        # One half after the other: of a large network each takes 100 MB.
        for half in (partial(self._root_of_own, vectors), partial(self._root_of_dense, left)):
            out = _with_squares(out, half())
        return some, _mirrored(out)

    def rooted(self, vectors: Array) -> tuple[Array, Array]:
        """Of a root of the covariance times (D + E b, k) the (D, k) and the (E b, k): products of their columns with
        each other are vectors^T times `product`, of any of these.
        """
        return self._root_of_dense(self._left(vectors)), self._root_of_own(vectors)

    def _root_of_own(self, vectors: Array) -> Array:
        """(E b, k): the root of the eliminated parameters' own part."""
        low = vectors[len(self.dense) :]
        if not low.size:
            return low
        try:
            root = np.linalg.cholesky(self.own).transpose(0, 2, 1)
        except np.linalg.LinAlgError:  # as there: a pose that few marks hold, nearly on a line or far away
            value, axes = np.linalg.eigh(self.own)
            root = np.sqrt(np.maximum(value, 0.0))[:, :, None] * axes.transpose(0, 2, 1)
        return np.asarray((root @ low.reshape(*self.own.shape[:2], -1)).reshape(low.shape))

    def _root_of_dense(self, left: Array) -> Array:
        """(D, k): the root of the dense part times `_left` of the vectors, which is overwritten."""
        if not left.size:
            return left
        factor, failed = lapack.dpotrf(self.dense, lower=1, clean=0)
        if not failed:  # a triangle: half of the products
            return np.asarray(blas.dtrmm(1.0, factor, left.T, side=1, lower=1, overwrite_b=1).T)
        value, axes = np.linalg.eigh(self.dense)  # where rounding has left nothing of some direction
        return np.asarray(np.sqrt(np.maximum(value, 0.0))[:, None] * (axes.T @ left))

    def _left(self, vectors: Array) -> Array:
        """(D, k) what the eliminated parameters leave over of vectors."""
        d = len(self.dense)
        out = self.half.T @ vectors[d:]
        return np.subtract(vectors[:d], out, out=out)

    def _by_own(self, vectors: Array) -> Array:
        """(E b, k) the eliminated parameters' own part of `product`."""
        low = vectors[len(self.dense) :]
        return np.asarray((self.own @ low.reshape(*self.own.shape[:2], -1)).reshape(low.shape))


def network_covariance(system: NetworkEquations, layout: Layout) -> NetworkCovariance:
    """Covariance at the minimum; raises as `covariance_and_cross` does."""
    return covariance_and_cross(system, layout)[0]


def covariance_and_cross(system: NetworkEquations, layout: Layout) -> tuple[NetworkCovariance, Array]:
    """Covariance at the minimum, and (E b, D) that of the eliminated parameters with the dense ones.

    Which is as large as anything there is: not kept for those who need it no more.

    Raises
    ------
    DegenerateGeometry
        When a direction other than the free motions is not determined at all.
    """
    with single_thread(len(system.g_d)):
        factored = system.factor(0.0)
        if factored is None:
            raise DegenerateGeometry("the observations do not determine all free parameters", ())
        lower, w, _, s = factored
        e, b = lower.shape[:2]
        inverse = np.linalg.inv(np.tril(lower))
        half = (inverse.transpose(0, 2, 1) @ w.reshape(e, b, -1)).reshape(e * b, -1)
        del factored, w
        dense = np.asarray(_mirrored(lapack.dpotri(s, lower=1, overwrite_c=1)[0] if s.size else s))
        cross = half @ dense
    np.negative(cross, out=cross)
    own = inverse.transpose(0, 2, 1) @ inverse
    blocks = own - half.reshape(e, b, -1) @ cross.reshape(e, b, -1).transpose(0, 2, 1)
    motions = np.concatenate([system.gauge.dense, system.gauge.blocks])
    return NetworkCovariance(dense, blocks, own, half, motions, layout), cross


def _with_squares(out: Array, rows: Array) -> Array:
    """The lower triangle of ``out`` (k, k) and the products of the columns of (n, k); half of the sums do for it."""
    return np.asarray(blas.dsyrk(1.0, rows.T, beta=1.0, c=out, lower=1, overwrite_c=1)) if rows.size else out


def _mirrored(lower: Array) -> Array:
    """The symmetric matrix of a lower triangle, in its place: of a large network every copy would be 72 MB."""
    for k in range(0, len(lower), STRIP):
        rows = slice(k, k + STRIP)
        lower[rows, k + STRIP :] = lower[k + STRIP :, rows].T
        corner = lower[rows, rows]
        corner[:] = np.tril(corner) + np.tril(corner, -1).T
    return lower
