"""What the labels of one camera are worth, in nats against chance, in more than one reading.

A reading says how markers come to be missing and how residuals come to be larger than the noise. A lead over a rival
is evidence only if it holds in every reading: else it rests on a supposition.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import cholesky, forward
from windmark.geometry._jit import nb
from windmark.registration._kernels.evidence import log10_nfa
from windmark.registration.settle._kernels.state import (
    ALONE,
    CLOSED,
    EXCESS,
    EXPECTED,
    LEAD,
    LOG10_NFA,
    PAIRS,
    PIECES,
    SYSTEMATIC,
    Mask,
    Sights,
    State,
)

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

SEEN_LEAST, SEEN_MOST = 0.25, 0.95
"""Between these the chance to see a marker is the solution's own share."""
LINKS, PER_LINK = 4, math.log(3.0)
"""Neighbours of a marker on the model, and nats for each of them on the other side of the edge of what hides: at every
step the edge can go on in about three ways."""
ORDERS = 4
"""Highest order of the smooth misfit, in half waves across the image."""
FEWEST = 6
"""Fewer pairs do not tell a smooth misfit from a random one."""
SMOOTH = (ORDERS + 1) * (ORDERS + 2) // 2 - 1
PARTS = np.array([0.0, 0.5, 0.8, 0.95, 1.0])
"""Parts of the excess that may be smooth."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def worth_kernel(sights: Sights, state: State) -> None:
    """`State.readings` of all cameras; -inf (and an infinite false-alarm number) without three pairs, of a rig without
    one.

    Spots come best first, and a detector may add hundreds of doubtful ones behind the good ones: of the prefixes of
    the list (`Sights.leads`) the best one counts, charged with their number. What a smooth misfit explains better,
    which takes as long as all the rest and only leads are asked for, is left open (NaN), see `smooth_kernel`.
    """  # fmt: skip
    cameras, n = state.match.shape
    residual, spread, dense = np.empty((n, 2)), np.empty((n, 3)), np.empty(n)
    for c in range(cameras):
        # Arrays are taken out of their tuples once: that counts references.
        match, faces, misfit, noise = state.match[c], state.faces[c], state.residual[c], state.spread[c]
        out, leads, density, first = state.readings[c], sights.leads[c], sights.dense, sights.first[c]
        out[:] = -math.inf
        out[LOG10_NFA], best, prefixes = math.inf, -math.inf, (leads > 0).sum()
        expected = int(state.numbers[c, EXPECTED])
        for k in range(prefixes):
            count = 0
            for m in range(n):
                s = match[m]
                if 0 <= s < leads[k]:
                    residual[count, 0], residual[count, 1] = misfit[m, 0], misfit[m, 1]
                    dense[count] = density[k, first + s]
                    for i in range(3):
                        spread[count, i] = noise[m, i]
                    count += 1
            if count < (3 if cameras == 1 else 1):
                continue
            pairs = _pairs(residual[:count], spread[:count], dense[:count])
            alone = _alone(count, expected)
            nfa = log10_nfa(
                residual[:count], dense[:count], expected, n, leads[k], sights.fixed[c], sights.log_share[c, k]
            )  # fmt: skip
            out[LOG10_NFA] = min(out[LOG10_NFA], nfa)
            if pairs + alone > best:
                best = pairs + alone
                out[LEAD] = k
                out[PAIRS], out[ALONE] = pairs - math.log(prefixes), alone
                out[CLOSED] = _alone(count, _facing(faces, match))
                out[PIECES] = _pieces(faces, match, sights.near, leads[k])
        out[LOG10_NFA] += math.log10(prefixes)
        if best > -math.inf:
            out[SYSTEMATIC] = math.nan


@nb.njit(cache=True, nogil=True, error_model="numpy")
def smooth_kernel(sights: Sights, state: State) -> None:
    """The readings that `worth_kernel` leaves open."""
    for c in range(state.match.shape[0]):
        if math.isnan(state.readings[c, SYSTEMATIC]):
            state.readings[c, SYSTEMATIC] = _systematic(sights, state, c)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _pairs(residual: Array, spread: Array, density: Array) -> float:
    """Gaussian misfit of K pairs against the local density of spots."""
    total = 0.0
    for k in range(residual.shape[0]):
        xx, xy, yy, u, v = spread[k, 0], spread[k, 1], spread[k, 2], residual[k, 0], residual[k, 1]
        det = xx * yy - xy * xy
        total -= math.log(2.0 * math.pi * math.sqrt(det) * density[k])
        total -= 0.5 * (yy * u * u - 2.0 * xy * u * v + xx * v * v) / det
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _alone(count: int, expected: int) -> float:
    """Every marker is seen or missing by itself."""
    seen = min(SEEN_MOST, max(SEEN_LEAST, (count + 1.0) / (expected + 2.0)))
    return count * math.log(seen) + (expected - count) * math.log(1.0 - seen)


@nb.njit(cache=True, nogil=True)
def _facing(faces: Mask, match: Ints) -> int:
    count = 0
    for m in range(match.shape[0]):
        count += faces[m] or match[m] >= 0
    return count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _pieces(faces: Mask, match: Ints, near: Ints, lead: int) -> float:
    """What is not seen is hidden in pieces, or beyond the image: charged by the length of the edge, once."""
    n, links = match.shape[0], 0
    reach = min(LINKS, near.shape[1])
    for m in range(n):
        if not (faces[m] or match[m] >= 0):
            continue
        seen = 0 <= match[m] < lead
        for k in range(reach):
            o = near[m, k]
            if faces[o] or match[o] >= 0:
                links += seen != (0 <= match[o] < lead)
    # A link is met from both its ends.
    return -math.log(n) - 0.5 * PER_LINK * links


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _systematic(sights: Sights, state: State, c: int) -> float:
    """How much better (nats) a misfit that is smooth over the image explains the residuals than a random one.

    Lens, bending, a table that drifts: such errors are the same for neighbours, so their many residuals are few facts.
    """
    basis, noise, r = _residuals(sights, state, c)
    excess, best, random = state.numbers[c, EXCESS], 0.0, 0.0
    for part in PARTS if r.shape[0] > 0 else PARTS[:0]:
        score = _of_split(basis, noise + (1.0 - part) * excess, part * excess, r)
        if part == 0.0:
            random = best = score
        best = max(best, score)
    return best - random


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _residuals(sights: Sights, state: State, c: int) -> tuple[Array, Array, Array]:
    """Cosines over the image at the spots of matched markers (K, SMOOTH), the variance of their residuals without the
    excess (K,), and the residuals (K, 2); nothing where there is no excess or too few pairs.
    """  # fmt: skip
    match, residual, spread, xy = state.match[c], state.residual[c], state.spread[c], sights.xy
    n, first, excess = match.shape[0], sights.first[c], state.numbers[c, EXCESS]
    wide, high = sights.size[c, 0], sights.size[c, 1]
    at, count = np.empty(n, np.int64), 0
    for m in range(n):
        if match[m] >= 0:
            at[count] = m
            count += 1
    if excess <= 0.0 or count < FEWEST:
        count = 0
    basis, noise, r = np.empty((count, SMOOTH)), np.empty(count), np.empty((count, 2))
    for k in range(count):
        m = at[k]
        s = first + match[m]
        u = math.pi * (xy[s, 0] + 0.5) / wide
        v = math.pi * (xy[s, 1] + 0.5) / high
        place = 0
        for i in range(ORDERS + 1):
            for j in range(ORDERS + 1 - i):
                if i + j > 0:
                    basis[k, place] = math.cos(i * u) * math.cos(j * v) / (i + j)
                    place += 1
        noise[k] = max(0.5 * (spread[m, 0] + spread[m, 2]) - excess, 1e-9)
        r[k, 0], r[k, 1] = residual[m, 0], residual[m, 1]
    return basis, noise, r


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _of_split(basis: Array, variance: Array, smooth: float, r: Array) -> float:
    """Log likelihood of residuals (K, 2) with a random ``variance`` (K,) and a ``smooth`` one; by Woodbury."""
    size, count = basis.shape[1], r.shape[0]
    total = 0.0
    for k in range(count):
        total -= math.log(variance[k]) + 0.5 * (r[k, 0] ** 2 + r[k, 1] ** 2) / variance[k]
    if smooth <= 0.0:
        return total
    a, g = np.zeros((size, size)), np.zeros((2, size))
    for k in range(count):
        w = smooth / variance[k]
        for i in range(size):
            for q in range(2):
                g[q, i] += math.sqrt(smooth) * basis[k, i] * r[k, q] / variance[k]
            for j in range(i + 1):
                a[i, j] += w * basis[k, i] * basis[k, j]
    for i in range(size):
        a[i, i] += 1.0
    if not cholesky(a, size, 1e-14):
        return -math.inf
    for i in range(size):
        total -= 2.0 * math.log(a[i, i])
    for q in range(2):
        forward(a, g[q], size)
        for i in range(size):
            total += 0.5 * g[q, i] ** 2
    return total
