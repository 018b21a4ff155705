"""From a candidate to the labels of a deformed model: fit, predict, label what is clear, until nothing changes.

The rigid search gives a core of right pairs. Pose and deformation from them predict the others with a covariance
that grows with the distance from the core; a marker is labelled where only one spot can be meant, and the field then
reaches farther. Where false spots are dense (rivets) the gate must be small first; what stays unclear stays unlabelled.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.registration._kernels.fit import PRIOR_WORTH, TRIM, TRIM_COST, Markers, Spots
from windmark.registration._kernels.hypothesis import GRAZING
from windmark.registration._kernels.settle import BORDER, FINAL_ROUNDS, GATE, LUCK
from windmark.registration.bent.fit import Bent, Seen, Setting, fit, project, spread_of
from windmark.registration.search.plane import Plane

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

CLEAR = 20.0
"""A new pair must be so many times likelier than a foreign spot there, by the local density of spots ..."""
AHEAD = 9.0
"""... and its squared Mahalanobis distance by so much less than that of any other pair of its marker or its spot."""
HELD_AHEAD = 4.0
"""The same for a pair that is held already, which need not be clear otherwise."""
LEAST_LEFT = 0.025
"""Least part of its variance that a pair leaves to its residual."""
ROUNDS, OPEN_ROUNDS = 30, 20
"""Most rounds; after the second number of them pairs may only go, so that no cycle remains."""
SETTLING = 2
"""After so many rounds the excess must not be more than at first."""
LEAST = 5
"""Fewer pairs are no core."""
ROUNDING = 1e-10
"""A determinant below this part of the product of the variances is lost in rounding."""
FIRST, DOUBT = 4.0, 16.0
"""The excess to start with, and the one expected besides the covariances, are the tolerance divided by these."""


@dataclass(frozen=True)
class Grown:
    """A labelling of a deformed model at rest.

    Parameters
    ----------
    bent : pose, deformation and normal equations
    match : (N,) spot of every marker or -1
    excess, misfit : variances per coordinate in px^2, see `registration.solution.Solution`
    residual, spread : (K, 2) and (K, 3) of the pairs in order of markers
    expected : markers that should be seen
    """

    bent: Bent
    match: NDArray[np.int32]
    excess: float
    misfit: float
    residual: Array
    spread: Array
    expected: int


def grow(plane: Plane, markers: Markers, setting: Setting, bent: Bent, match: NDArray[np.int32]) -> Grown | None:
    """Fit and label until nothing changes; None where it falls apart or never comes to rest.

    Hidden markers are those of ``markers`` that face away.
    """
    tolerance = plane.task.tolerance_px
    match, excess = match.copy(), (tolerance / FIRST) ** 2
    for round_ in range(ROUNDS):
        state = _fitted(plane.spots, setting, bent, match, excess, (tolerance / DOUBT) ** 2, 0.0)
        if state is None:
            return None
        seen, spread, found = state
        if round_ >= SETTLING and found.excess > (tolerance / FIRST) ** 2:
            return None
        new, expected = _label(plane, markers, seen, spread, found, round_ >= OPEN_ROUNDS)
        still = abs(np.sqrt(found.excess) - np.sqrt(excess)) < 0.02 * np.sqrt(found.spread[:, ::2].mean())
        if still and (new == match).all():
            return replace(found, expected=expected)
        match, excess = new, found.excess
    return None


def finish(spots: Spots, setting: Setting, grown: Grown) -> Grown:
    """The same labels with the excess by the residuals alone, as for a rigid solution that is accepted."""
    bent = replace(grown.bent)
    for _ in range(FINAL_ROUNDS):
        state = _fitted(spots, setting, bent, grown.match, grown.excess, 0.0, LUCK)
        if state is None:
            return grown
        found = state[2]
        grown = Grown(bent, found.match, found.excess, found.misfit, found.residual, found.spread, grown.expected)
    return grown


def _fitted(
    spots: Spots, setting: Setting, bent: Bent, match: NDArray[np.int32], excess: float, doubt2: float, luck: float
) -> tuple[Seen, Array, Grown] | None:
    """Fit with a given excess; projections of all markers, their covariance, and the new excess with its weights."""
    marker = np.flatnonzero(match >= 0)
    if len(marker) < LEAST:
        return None
    spot, both = match[marker], np.array([1.0, 0.0, 1.0])
    noise = spots.cov[spot]
    if not fit(setting, bent, marker, spots.p[spot], noise + excess * both):
        return None
    seen = project(setting, bent, np.arange(len(match)))
    spread = spread_of(bent, seen.by_all)
    residual, known = seen.uv[marker] - spots.p[spot], noise + seen.table[marker]
    # What pose and deformation have taken from each residual.
    taken = spread[marker][:, ::2].sum(axis=1) / (known + excess * both)[:, ::2].sum(axis=1)
    redundancy = max(float(2 * (1 - np.minimum(taken, 1.0)).sum()), 0.5)
    excess, misfit = _excess(residual, float(known[:, ::2].mean()), redundancy, doubt2, luck)
    return seen, spread, Grown(bent, match, excess, misfit, residual, known + excess * both, 0)


def _excess(residual: Array, known: float, redundancy: float, doubt2: float, luck: float) -> tuple[float, float]:
    """Variance beyond the ``known`` one, robust as in `_kernels.fit.excess_of`, and that of the residuals."""
    count, squares = len(residual), np.sort((residual**2).sum(axis=1))
    kept = int(np.ceil(TRIM * count))
    # Means of the smallest of so many unit exponentials.
    expected = (np.arange(kept, 0, -1) / np.arange(count, count - kept, -1)).sum()
    robust = 0.5 * squares[:kept].sum() / expected * 2 * count / redundancy
    pooled = (PRIOR_WORTH * (known + doubt2) + redundancy * robust) / (PRIOR_WORTH + redundancy)
    chance = luck * TRIM_COST * np.sqrt(2 * redundancy) / (PRIOR_WORTH + redundancy)
    return max(0.0, float(pooled - known * (1 + chance))), float(squares.sum() / redundancy)


def _label(
    plane: Plane, markers: Markers, seen: Seen, spread: Array, now: Grown, shut: bool
) -> tuple[NDArray[np.int32], int]:
    """Pairs, closest first and one to one, and the number of markers that should be seen; ``shut``: pairs only go."""
    may, must = _visible(plane, markers.normal, seen, spread, now.bent)
    place, loose = _by_others(plane, seen, spread, now)
    m, s = _near_pairs(plane, place, loose + seen.table, now.excess, may)
    distance2, odds = _compare(plane, place, loose + seen.table, now.excess, m, s)
    held = now.match[m] == s
    near = (distance2 < GATE) & (held | (not shut))
    m, s, distance2, odds, held = m[near], s[near], distance2[near], odds[near], held[near]
    ahead = _lead(m, s, distance2) > np.where(held, HELD_AHEAD, AHEAD)
    good = np.flatnonzero(ahead & (held | (odds * np.exp(-0.5 * distance2) > CLEAR)))
    new, taken = np.full(len(now.match), -1, np.int32), np.zeros(len(plane.spots.density), dtype=bool)
    for k in good[np.argsort(distance2[good], kind="stable")]:
        if new[m[k]] < 0 and not taken[s[k]]:
            new[m[k]], taken[s[k]] = s[k], True
    return new, int((must | (new >= 0)).sum())


def _by_others(plane: Plane, seen: Seen, spread: Array, now: Grown) -> tuple[Array, Array]:
    """Where every marker is by all *other* pairs, (N, 2), and the covariance (N, 3) of that.

    A spot that holds the solution has pulled it. Without it the residual r with the covariance N becomes N D^-1 r with
    N D^-1 N, D = N - S, where S is the covariance of the projection. So a pair far from all others, which the
    deformation followed wherever it was, counts as what it is: in a wide gate, with other spots in it.
    """
    held = np.flatnonzero(now.match >= 0)
    spot = plane.spots.p[now.match[held]]
    noise, taken = _square(now.spread), _square(spread[held])
    value, vector = np.linalg.eigh(noise - taken)
    # Kept positive where a pair alone determines part of the solution.
    value = np.maximum(value, LEAST_LEFT * np.trace(noise, axis1=1, axis2=2)[:, None])
    gain = noise @ (vector / value[:, None]) @ vector.transpose(0, 2, 1)
    place, loose = seen.uv.copy(), spread.copy()
    place[held] = spot + (gain @ (seen.uv[held] - spot)[:, :, None])[:, :, 0]
    without = gain @ noise - noise
    loose[held] = np.stack([without[:, 0, 0], without[:, 0, 1], without[:, 1, 1]], axis=1)
    return place, loose


def _square(packed: Array) -> Array:
    """(n, 2, 2) symmetric matrices from xx, xy, yy (n, 3)."""
    return packed[:, [0, 1, 1, 2]].reshape(-1, 2, 2)


def _visible(
    plane: Plane, normal: Array, seen: Seen, spread: Array, bent: Bent
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which markers may be seen, and which must be: well in the image, and in gates that tell them from clutter."""
    camera = plane.task.camera
    sight = -bent.rotation.T @ bent.translation - plane.model.xyz
    cosine = (normal * sight).sum(axis=1) / np.linalg.norm(sight, axis=1)
    cosine[~normal.any(axis=1)] = 1.0
    xy, valid = camera.project(np.column_stack([seen.uv / camera.focal_px, np.ones(len(sight))]))
    with np.errstate(invalid="ignore"):
        edge = BORDER + plane.spots.radius - 0.5
        inside = valid & (xy > edge).all(axis=1) & (xy < np.array(camera.size_px) - 1 - edge).all(axis=1)
    chance = np.pi * spread[:, ::2].sum(axis=1) * len(plane.spots.p) / np.prod(camera.size_px)
    return valid & (cosine > 0), inside & (cosine > GRAZING) & (chance < 1 / CLEAR)


def _near_pairs(plane: Plane, place: Array, cov: Array, excess: float, may: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Markers and spots that lie within each other's widest gate (a square)."""
    spots, marker = plane.spots, np.flatnonzero(may)
    widest = cov[marker, ::2].sum(axis=1) + 2 * excess + spots.cov[:, ::2].sum(axis=1).max()
    reach = np.sqrt(GATE * widest)[:, None]
    near = np.abs(place[marker, None, 0] - spots.p[None, :, 0]) < reach
    near &= np.abs(place[marker, None, 1] - spots.p[None, :, 1]) < reach
    row, s = np.nonzero(near)
    return marker[row], s


def _compare(plane: Plane, place: Array, cov: Array, excess: float, m: Ints, s: Ints) -> tuple[Array, Array]:
    """Squared Mahalanobis distance of pairs, and how much likelier the marker's spot is there than a foreign one.

    Far from the core a place may be known to thousands of pixels along one line; where rounding leaves no covariance,
    the distance is infinite.
    """
    xx, xy, yy = (plane.spots.cov[s] + cov[m] + excess * np.array([1.0, 0.0, 1.0])).T
    (u, v), det = (place[m] - plane.spots.p[s]).T, xx * yy - xy * xy
    det = np.where(det > ROUNDING * xx * yy, det, np.nan)
    distance2 = (yy * u * u - 2 * xy * u * v + xx * v * v) / det
    return np.nan_to_num(distance2, nan=np.inf), 1 / (2 * np.pi * np.sqrt(det) * plane.spots.density[s])


def _lead(m: Ints, s: Ints, distance2: Array) -> Array:
    """By how much a pair is nearer than every other one of its marker and of its spot; -inf if it is not."""
    lead = np.full(len(m), np.inf)
    for key in (m, s):
        order = np.lexsort((distance2, key))
        key_, d = key[order], distance2[order]
        first = np.r_[True, key_[1:] != key_[:-1]]
        next_ = np.where(np.r_[first[1:], True], np.inf, np.r_[d[1:], np.inf])
        lead[order] = np.minimum(lead[order], np.where(first, next_ - d, -np.inf))
    return lead
