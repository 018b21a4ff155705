"""How far an adjustment follows its observations, as numba kernels. Private to the adjust room."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network._arrays import ROOM
from windmark.adjust.network._projection_kernels import FAST
from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def influences(
    jd: Array, je: Array, cols: Ints, block: Ints, dense: Array, cross: Array, blocks: Array, out: Array
) -> None:
    """J C J^T (O, 2, 2) of every observation from the rows of `jacobian_rows`.

    ``dense`` (D, D), ``cross`` (E b, D) and ``blocks`` (E, b, b) are the covariances of the dense parameters, of the
    eliminated with these, and of each eliminated block.
    """
    size, used, u = je.shape[2], np.empty(ROOM, np.int64), np.empty((2, ROOM))
    for o in range(jd.shape[0]):
        count, e = 0, block[o]
        for k in range(cols.shape[1]):
            if cols[o, k] >= 0:
                used[count], u[0, count], u[1, count] = cols[o, k], jd[o, 0, k], jd[o, 1, k]
                count += 1
        s00, s01, s11 = 0.0, 0.0, 0.0
        for a in range(count):
            # Below the diagonal twice: it is symmetric.
            column, t0, t1 = used[a], 0.0, 0.0
            for b in range(a):
                d = dense[column, used[b]]
                t0 += d * u[0, b]
                t1 += d * u[1, b]
            d, u0, u1 = dense[column, column], u[0, a], u[1, a]
            s00 += u0 * (2.0 * t0 + d * u0)
            s01 += u0 * t1 + u1 * (t0 + d * u0)
            s11 += u1 * (2.0 * t1 + d * u1)
        for a in range(size if e >= 0 else 0):
            row, t0, t1 = e * size + a, 0.0, 0.0
            for b in range(count):
                c = cross[row, used[b]]
                t0 += c * u[0, b]
                t1 += c * u[1, b]
            w0, w1 = je[o, 0, a], je[o, 1, a]
            s00 += 2.0 * t0 * w0
            s01 += t0 * w1 + t1 * w0
            s11 += 2.0 * t1 * w1
            for b in range(size):
                c = blocks[e, a, b]
                s00 += w0 * c * je[o, 0, b]
                s01 += w0 * c * je[o, 1, b]
                s11 += w1 * c * je[o, 1, b]
        out[o, 0, 0], out[o, 0, 1], out[o, 1, 0], out[o, 1, 1] = s00, s01, s01, s11


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def gather(
    jd: Array, je: Array, cols: Ints, block: Ints, b: Array, factor: Array, of: Ints, group: Ints, dense: Array,
    eliminated: Array,
) -> None:  # fmt: skip
    """Add J^T b of groups of observations, from the rows of `jacobian_rows`; group -1: of none.

    b is b (O, 2, K) times each of the M factors (N, M) in the row ``of`` (O,): to ``dense`` (D, G, K M) and
    ``eliminated`` (E b, G, K M).
    """
    size, many = je.shape[2], factor.shape[1]
    for o in range(jd.shape[0]):
        g, first, f = group[o], block[o] * size, of[o]
        if g < 0:
            continue
        for k in range(cols.shape[1]):
            row, x, y = cols[o, k], jd[o, 0, k], jd[o, 1, k]
            if row >= 0 and many == 1:  # the longer loop is the inner one
                x, y = x * factor[f, 0], y * factor[f, 0]
                for n in range(b.shape[2]):
                    dense[row, g, n] += x * b[o, 0, n] + y * b[o, 1, n]
            elif row >= 0:
                for n in range(b.shape[2]):
                    z, to = x * b[o, 0, n] + y * b[o, 1, n], n * many
                    for m in range(many):
                        dense[row, g, to + m] += z * factor[f, m]
        for k in range(size if first >= 0 else 0):
            for n in range(b.shape[2]):
                z, to = je[o, 0, k] * b[o, 0, n] + je[o, 1, k] * b[o, 1, n], n * many
                for m in range(many):
                    eliminated[first + k, g, to + m] += z * factor[f, m]
