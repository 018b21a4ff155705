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
    size, used = je.shape[2], np.empty(ROOM, np.int64)
    for o in range(jd.shape[0]):
        count, e = 0, block[o]
        for k in range(cols.shape[1]):
            if cols[o, k] >= 0:
                used[count] = k
                count += 1
        s00, s01, s11 = 0.0, 0.0, 0.0
        for a in range(count):
            column, t0, t1 = cols[o, used[a]], 0.0, 0.0
            for b in range(count):
                d = dense[column, cols[o, used[b]]]
                t0 += d * jd[o, 0, used[b]]
                t1 += d * jd[o, 1, used[b]]
            u0, u1 = jd[o, 0, used[a]], jd[o, 1, used[a]]
            s00 += u0 * t0
            s01 += u0 * t1
            s11 += u1 * t1
        for a in range(size if e >= 0 else 0):
            row, t0, t1 = e * size + a, 0.0, 0.0
            for b in range(count):
                c = cross[row, cols[o, used[b]]]
                t0 += c * jd[o, 0, used[b]]
                t1 += c * jd[o, 1, used[b]]
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
    jd: Array, je: Array, cols: Ints, block: Ints, b: Array, group: Ints, dense: Array, eliminated: Array
) -> None:
    """Add J^T b of groups of observations, from the rows of `jacobian_rows` and b (O, 2, K); group -1: of none.

    To ``dense`` (D, G, K) and ``eliminated`` (E b, G, K).
    """
    size = je.shape[2]
    for o in range(jd.shape[0]):
        g, first = group[o], block[o] * size
        if g < 0:
            continue
        for k in range(cols.shape[1]):
            if cols[o, k] >= 0:
                x, y = jd[o, 0, k], jd[o, 1, k]
                for n in range(b.shape[2]):
                    dense[cols[o, k], g, n] += x * b[o, 0, n] + y * b[o, 1, n]
        for k in range(size if first >= 0 else 0):
            x, y = je[o, 0, k], je[o, 1, k]
            for n in range(b.shape[2]):
                eliminated[first + k, g, n] += x * b[o, 0, n] + y * b[o, 1, n]
