"""Gross errors: found by their own test, named, left out, and taken back when they fit after all.

Each mark is a point with two coordinates. Its residual r has the covariance Q = 1 - J C J^T in units of its own sigma
(the adjustment follows a mark a little), so T = r^T Q^-1 r / sigma0^2 has the chi-square distribution of two degrees
of freedom (Baarda 1968, data snooping). A mark that was left out is tested against its prediction, 1 + J C J^T.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network import NetworkProblem, NetworkState, linear
from windmark.adjust.network._arrays import ROOM
from windmark.adjust.network.covariance import NetworkCovariance

Array = NDArray[np.float64]

LIMIT = 2 * np.log(1000.0)
"""A right mark is above it once in a thousand: the 99.9 % point of chi-square with two degrees of freedom."""
CHUNK = 4_000
"""Marks worked on at a time, for memory."""


def influence(problem: NetworkProblem, state: NetworkState, covariance: NetworkCovariance) -> Array:
    """(O, 2, 2) J C J^T of every mark in units of its variance, in the problem's order."""
    lay, o = problem.layout, len(problem.order)
    jd, je = np.zeros((o, 2, ROOM)), np.zeros((o, 2, lay.size))
    cols, block = np.zeros((o, ROOM), np.int64), np.zeros(o, np.int64)
    linear.jacobian_rows(
        problem.marks, problem.scene(state), problem.units(state), lay.columns, jd, je, cols, block
    )  # fmt: skip
    # Minus the covariance of the eliminated with the dense parameters.
    cross = (covariance.half @ covariance.dense).reshape(lay.blocks, lay.size, -1)
    out = np.zeros((o, 2, 2))
    for start in range(0, o, CHUNK):
        part = slice(start, start + CHUNK)
        u, w, c, b = jd[part], je[part], np.maximum(cols[part], 0), block[part]
        dense = covariance.dense[c[:, :, None], c[:, None, :]]
        out[part] = u @ dense @ u.transpose(0, 2, 1)
        own = np.maximum(b, 0)
        if lay.blocks:
            between = -cross[own[:, None, None], np.arange(lay.size)[:, None], c[:, None, :]]
            mixed = u @ between.transpose(0, 2, 1) @ w.transpose(0, 2, 1)
            both = w @ covariance.blocks[own] @ w.transpose(0, 2, 1) + mixed + mixed.transpose(0, 2, 1)
            out[part] += np.where((b >= 0)[:, None, None], both, 0.0)
    return out


def statistic(residual: Array, influence_: Array, used: NDArray[np.bool_]) -> Array:
    """(O,) T of every mark for sigma0 = 1: against what is left of its noise if it was used, else its prediction."""
    sign = np.where(used, -1.0, 1.0)[:, None, None]
    q = np.eye(2) + sign * influence_
    # A mark that alone determines something has no redundancy and cannot be tested: its residual is zero.
    value, vector = np.linalg.eigh(q)
    along = np.einsum("oij,oi->oj", vector, residual)
    return np.where(value > 1e-6, along**2 / np.maximum(value, 1e-6), 0.0).sum(axis=1)
