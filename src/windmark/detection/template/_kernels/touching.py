"""Discs of neighbours in a marker's window. Private; arrays in, arrays out."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection.template._kernels.model import CENTRE, SHAPE, compare, disc_sums, points_needed
from windmark.geometry._jit import nb

SHARED = 7  # the first unknowns, those of a disc alone: its light is fitted for each window


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _uncoupled(p: Any, multiplicative: float, q: Any) -> float:
    """Parameters with the kernel's centre, the one without the light's coupling; returns (blur^2 + 1/12) / light."""
    light = max(1.0 + multiplicative * (p[8] * p[0] + p[9] * p[1]), 0.05)
    reach = multiplicative * (p[5] * p[5] + 1.0 / 12.0) / light
    for k in range(10):
        q[k] = p[k]
    q[0], q[1] = p[0] - reach * p[8], p[1] - reach * p[9]
    return reach


@nb.njit(cache=True, nogil=True, error_model="numpy")
def take_away(patches: Any, weights: Any, which: Any, params: Any, multiplicative: float) -> None:
    """Take discs away from patches (M, S, S): disc n with parameters (N, 10) from patch which[n], where it is used."""
    size, q = patches.shape[1], np.empty(10)
    g, table = np.empty((10, size, size)), np.empty((8, size + 6))
    for n in range(len(which)):
        patch, weight = patches[which[n]], weights[which[n]]
        _uncoupled(params[n], multiplicative, q)
        disc_sums(q, points_needed(q), CENTRE, table, g)
        center = max(1.0 + multiplicative * (q[8] * q[0] + q[9] * q[1]), 0.05)
        spread = multiplicative * q[6] * (q[5] * q[5] + 1.0 / 12.0)
        for j in range(size):
            for i in range(size):
                light = 1.0 + multiplicative * (q[8] * (i - size // 2) + q[9] * (j - size // 2))
                late = spread * (light / center - 1.0) * (q[8] * g[0, j, i] + q[9] * g[1, j, i])
                if weight[j, i] > 0.0:
                    patch[j, i] += light * q[6] * g[6, j, i] + late


@nb.njit(cache=True, nogil=True, error_model="numpy")
def derivatives(inside: Any, p: Any, multiplicative: float, q: Any, table: Any, res: Any, jac: Any) -> None:
    """Of a model with parameters (10,), as `template.fit.Fitted` has them, into jac (10, S, S); 0 where not inside."""
    reach = _uncoupled(p, multiplicative, q)
    disc_sums(q, points_needed(q), SHAPE, table, jac)
    compare(inside, inside, q, True, 0.0, multiplicative, table, jac, res)
    for j in range(res.shape[0]):
        for i in range(res.shape[0]):
            x, y = jac[0, j, i], jac[1, j, i]
            jac[8, j, i] -= reach * x
            jac[9, j, i] -= reach * y
            if multiplicative > 0.0:
                light = (q[5] * q[5] + 1.0 / 12.0) / reach
                jac[5, j, i] -= 2.0 * q[5] / light * (q[8] * x + q[9] * y)


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _products(jac: Any, other: Any, out: Any) -> None:
    """Sums over the pixels of the products of derivatives (10, P) and (SHARED or more, P)."""
    for a in range(10):
        one = jac[a]
        for b in range(SHARED):
            two, total = other[b], 0.0
            for k in range(one.size):
                total += one[k] * two[k]
            out[a, b] = total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def shared_blocks(
    start: Any, reach: Any, own: Any, owner: Any, seen: Any, multiplicative: float, out: Any
) -> None:  # fmt: skip
    """Blocks A_12 (P, 10, SHARED) of the normal matrices of markers `own` (M, 10) and neighbours `seen` (P, 10) there.

    `owner` (P,) ascending; the markers' windows are the pixels within `reach` (M,) of the places `start` (M, 2).
    """
    size, q, before = 0, np.empty(10), -1
    for n in range(len(seen)):
        m = owner[n]
        if m != before:
            if size != 2 * int(math.ceil(reach[m] + 0.5)) + 1:
                size = 2 * int(math.ceil(reach[m] + 0.5)) + 1
                jac, other, res = np.empty((10, size, size)), np.empty((10, size, size)), np.empty((size, size))
                inside, table = np.empty((size, size)), np.empty((8, size + 6))
            for j in range(size):
                for i in range(size):
                    away = math.hypot(i - size // 2 - start[m, 0], j - size // 2 - start[m, 1])
                    inside[j, i] = 1.0 if away <= reach[m] else 0.0
            derivatives(inside, own[m], multiplicative, q, table, res, jac)
            before = m
        derivatives(inside, seen[n], multiplicative, q, table, res, other)
        _products(jac.reshape((10, size * size)), other.reshape((10, size * size)), out[n])
