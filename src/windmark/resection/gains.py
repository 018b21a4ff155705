"""Relative gain of pictures of one surface, from what several of them see.

Picture i shows I = offset_i + gain_i V at a node whose true value is V. All V are unknowns like the gains: least
squares with errors in every picture, which no picture is the "right" side of. For each node V is eliminated (Schur
complement), so what is solved has two unknowns per picture whatever the number of nodes. Sources: W. E. Deming,
Statistical Adjustment of Data (1943), for errors on both sides; K.-Y. Liang and S. L. Zeger, Biometrika 73 (1986), for
a covariance that holds when neighbours are off together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEAST_OVERLAP = 20
"""Nodes that two pictures must both see well before their gains are compared."""
CUT = 2.4
"""Nodes whose misfit is so many times the usual one count half (Cauchy's weight): markers, dirt, glints."""
GROUPS = 8
"""Regions of the surface that are enough to see how far neighbours are off together."""
NEIGHBOURS = 3
"""Regions nearest to each that are compared with it."""
_CHI_MEDIAN = 0.4549364
"""Median of chi-square with one degree of freedom."""
_SAME = 1e-10


@dataclass(frozen=True)
class Gains:
    """Relative gains of C pictures: value = (grey level - offset) / gain.

    Parameters
    ----------
    gain, offset : (C,) 1 and 0 for the reference
    sigma, offset_sigma : (C,) standard deviations relative to the reference
    cov : (2C, 2C) of gains, then offsets
    linked : (C,) bool, joined to the reference by overlaps; the gain of others is unknown (NaN)
    overlap : (C, C) nodes that two pictures both see well
    reference : which picture the others are brought to
    systematic : part of the value by which calibrated pictures differ beyond their noise and pose (1 sigma of one
        picture, median): light from other sides, shading of lenses, registration. NaN without an overlap
    estimated : whether gains were estimated at all
    """

    gain: Array
    offset: Array
    sigma: Array
    offset_sigma: Array
    cov: Array
    linked: Mask
    overlap: NDArray[np.int64]
    reference: int
    systematic: float
    estimated: bool


def overlap_gains(
    value: Array,
    variance: Array,
    use: Mask,
    region: NDArray[np.int64],
    *,
    place: Array | None = None,
    reference: int | None,
    offset: bool,
    estimate: bool,
) -> Gains:
    """Gains from the nodes that several pictures see.

    Parameters
    ----------
    value, variance : (C, N), NaN where a picture has none
    use : (C, N) seen well
    region : (N,) number of the part of the surface a node lies in
    place : (N, 3) where the nodes are; without it all regions count as independent
    reference : None: of the pictures that are joined by overlaps and see most, the first
    offset : a common grey level of each picture is unknown, too
    estimate : False leaves all gains at 1; overlap and systematic difference are still found
    """
    count = len(value)
    use = use & np.isfinite(value) & (variance >= 0)
    overlap = (use.astype(np.int64)) @ use.T.astype(np.int64)
    group, order = _joined(overlap, use, reference)
    reference = order[0]
    linked = np.ones(count, bool) if not estimate else group
    gain, shift, cov = np.ones(count), np.zeros(count), np.zeros((2 * count, 2 * count))
    if estimate:
        gain = _first_gains(value, use, overlap, order)
        gain, shift, cov = _solve(value, variance, use & linked[:, None], region, gain, reference, offset)
        gain[~linked] = shift[~linked] = np.nan
    systematic = _systematic(value, variance, use & linked[:, None], gain, shift)
    if estimate and systematic > 0:
        # What no gain explains acts over whole regions, and is in the gains as one error of each that is independent.
        free = np.flatnonzero(linked & (np.arange(count) != reference))
        alone = _independent_regions(value, use & linked[:, None], gain, shift, region, place)
        cov[free, free] += 2 * (systematic * gain[free]) ** 2 / alone
    sigma = np.sqrt(np.maximum(np.diag(cov), 0))
    return Gains(gain, shift, np.where(linked, sigma[:count], np.nan), np.where(linked, sigma[count:], np.nan), cov,
                 linked, overlap, reference, systematic, estimate)  # fmt: skip


def _joined(overlap: NDArray[np.int64], use: Mask, reference: int | None) -> tuple[Mask, list[int]]:
    """The pictures joined to the reference, and in which order: each by its widest overlap with one before it."""
    count = len(overlap)

    def grown(first: int) -> list[int]:
        order = [first]
        while len(order) < count:
            rest = [k for k in range(count) if k not in order]
            widest = overlap[np.ix_(rest, order)].max(axis=1)
            if widest.max() < LEAST_OVERLAP:
                break
            order.append(rest[int(np.argmax(widest))])
        return order

    if reference is None:
        parts = [grown(k) for k in range(count)]
        reference = int(np.argmax([use[p].any(axis=0).sum() for p in parts]))
    order = grown(reference)
    linked = np.zeros(count, bool)
    linked[order] = True
    return linked, order


def _first_gains(value: Array, use: Mask, overlap: NDArray[np.int64], order: list[int]) -> Array:
    """Medians of ratios along the chain of widest overlaps."""
    gain = np.ones(len(value))
    for n, k in enumerate(order[1:], start=1):
        before = order[:n]
        j = before[int(np.argmax(overlap[k, before]))]
        both = use[k] & use[j] & (value[j] != 0)
        ratio = float(np.median(value[k, both] / value[j, both])) if both.any() else 1.0
        gain[k] = gain[j] * (ratio if np.isfinite(ratio) and ratio > 0 else 1.0)
    return gain


def _solve(
    value: Array, variance: Array, use: Mask, region: NDArray[np.int64], gain: Array, reference: int, offset: bool
) -> tuple[Array, Array, Array]:
    """Gains, offsets and covariance by Gauss-Newton on the reduced equations."""
    both = np.flatnonzero(use.sum(axis=0) >= 2)
    count = len(value)
    use, i, region = use[:, both], np.where(use[:, both], value[:, both], 0.0), region[both]
    # A perfect picture (variance 0) still needs a finite weight.
    smallest = 1e-12 * float(np.median(i[use] ** 2)) if use.any() else 1.0
    weight = np.where(use, 1 / np.maximum(np.where(use, variance[:, both], 1.0), max(smallest, 1e-300)), 0.0)
    free = np.flatnonzero((np.arange(count) != reference) & use.any(axis=1))
    free = np.concatenate([free, free + count]) if offset else free
    gain, shift = gain.copy(), np.zeros(count)
    cov = np.zeros((2 * count, 2 * count))
    if not len(free):
        return gain, shift, cov
    for _ in range(60):
        w = weight * _trust(i, weight, gain, shift, use)
        normal, right, scores = _reduced(i, w, gain, shift)
        step = np.linalg.lstsq(normal[np.ix_(free, free)], right[free], rcond=None)[0]
        full = np.zeros(2 * count)
        full[free] = step
        gain, shift = np.maximum(gain + full[:count], 0.2 * gain), shift + full[count:]
        if np.abs(full[:count] / gain).max() < _SAME:
            break
    cov[np.ix_(free, free)] = _covariance(normal[np.ix_(free, free)], scores[free], region)
    return gain, shift, cov


def _fit(i: Array, w: Array, gain: Array, shift: Array) -> tuple[Array, Array, Array]:
    """True values (N,), residuals (C, N) and what a node's own equation has on its diagonal (N,)."""
    diagonal = (w * gain[:, None] ** 2).sum(axis=0)
    known = (w * gain[:, None] * (i - shift[:, None])).sum(axis=0) / diagonal
    return known, i - shift[:, None] - gain[:, None] * known, diagonal


def _trust(i: Array, weight: Array, gain: Array, shift: Array, use: Mask) -> Array:
    """(N,) Cauchy's weight of each node, on the scale that the nodes themselves show."""
    _, residual, _ = _fit(i, weight, gain, shift)
    chi = (weight * residual**2).sum(axis=0) / np.maximum(use.sum(axis=0) - 1, 1)
    scale = max(float(np.median(chi)) / _CHI_MEDIAN, 1.0)
    return np.asarray(1 / (1 + chi / (CUT**2 * scale)))


def _reduced(i: Array, w: Array, gain: Array, shift: Array) -> tuple[Array, Array, Array]:
    """Normal matrix (2C, 2C), right side (2C,) and scores (2C, N) of gains and offsets; all V are eliminated."""
    known, residual, diagonal = _fit(i, w, gain, shift)
    own = [(w * known**2).sum(axis=1), (w * known).sum(axis=1), w.sum(axis=1)]
    direct = np.block([[np.diag(own[0]), np.diag(own[1])], [np.diag(own[1]), np.diag(own[2])]])
    coupling = np.concatenate([w * known * gain[:, None], w * gain[:, None]])
    scores = np.concatenate([w * residual * known, w * residual])
    return direct - (coupling / diagonal) @ coupling.T, scores.sum(axis=1), scores


def _covariance(normal: Array, scores: Array, region: NDArray[np.int64]) -> Array:
    """Covariance from the scatter of whole regions' scores, or from the noise alone where that is larger."""
    inverse = np.linalg.pinv(normal, hermitian=True)
    names, of = np.unique(region, return_inverse=True)
    if len(names) < GROUPS:
        return np.asarray(inverse, dtype=float)
    sums = np.stack([np.bincount(of, s, minlength=len(names)) for s in scores])
    spread = inverse @ (sums @ sums.T) @ inverse * len(names) / (len(names) - 1)
    larger = np.sqrt(np.maximum(np.diag(spread), np.diag(inverse)) / np.maximum(np.diag(spread), 1e-300))
    sure = np.isfinite(spread).all() and (np.diag(spread) > 0).all()
    return np.asarray(spread * np.outer(larger, larger) if sure else inverse, dtype=float)


def _systematic(value: Array, variance: Array, use: Mask, gain: Array, shift: Array) -> float:
    """The part s of the value for which the median of d^2 / (var + 2 s^2 V^2) is that of noise; d of two pictures."""
    parts = []
    for a in range(len(value)):
        for b in range(a):
            both = use[a] & use[b]
            if not both.any():
                continue
            va, vb = ((value[k, both] - shift[k]) / gain[k] for k in (a, b))
            var = variance[a, both] / gain[a] ** 2 + variance[b, both] / gain[b] ** 2
            parts.append(np.stack([(va - vb) ** 2, var, 0.5 * (va + vb) ** 2]))
    if not parts:
        return float("nan")
    square, var, size = np.concatenate(parts, axis=1)

    def excess(s: float) -> float:
        expected = np.maximum(var + s**2 * 2 * size, 1e-30 * size)  # perfect pictures have no variance
        ratio = np.divide(square, expected, out=np.zeros(len(square)), where=expected > 0)
        return float(np.median(ratio)) - _CHI_MEDIAN

    if excess(0.0) <= 0:
        return 0.0
    low, high = 0.0, 1e-4
    while excess(high) > 0 and high < 10:
        low, high = high, 2 * high
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return 0.5 * (low + high)


def _independent_regions(
    value: Array, use: Mask, gain: Array, shift: Array, region: NDArray[np.int64], place: Array | None
) -> float:
    """How many of the regions are off independently of each other: a lens that shades is off over all of them alike.

    The correlation r of neighbouring regions is one less the mean square of their differences over twice the variance
    of all (Geary, The Incorporated Statistician 5, 1954); a mean over n regions whose correlation falls by r from one
    to the next, in two directions, has the variance of n ((1 - r) / (1 + r))^2 independent ones.
    """
    seen = use.sum(axis=0) > 1
    count = len(np.unique(region[seen]))
    if place is None or count < GROUPS:
        return float(count)
    from scipy.spatial import cKDTree

    square = beside = 0.0
    for a in range(len(value)):
        for b in range(a):
            both = np.flatnonzero(use[a] & use[b])
            names, of = np.unique(region[both], return_inverse=True)
            if len(names) < GROUPS:
                continue
            va, vb = ((value[k, both] - shift[k]) / gain[k] for k in (a, b))
            off = (va - vb) / np.maximum(0.5 * np.abs(va + vb), 1e-300)
            middle = np.array([np.median(off[of == k]) for k in range(len(names))])
            where = np.array([place[both[of == k]].mean(axis=0) for k in range(len(names))])
            near = cKDTree(where).query(where, k=NEIGHBOURS + 1)[1][:, 1:]
            square += len(names) * float(np.var(middle, ddof=1))
            beside += 0.5 * float(np.mean((middle[near] - middle[:, None]) ** 2)) * len(names)
    if not square > 0:
        return float(count)
    r = min(max(1 - beside / square, 0.0), 1.0)
    return max(1.0, count * ((1 - r) / (1 + r)) ** 2)
