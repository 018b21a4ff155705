"""Ways to lay one picture's constellation of spots on another's: what could be a matching, good or not.

Two pictures of one model by one camera differ by a motion and a little deformation: locally they are alike up to turn,
scale and shift. So a spot with one neighbour is laid on every such pair of the other picture; what takes the other
neighbours onto spots too is a seed, and from it a matching grows from spot to spot, each predicted by its matched
neighbours with an affine map (`epipolar.constellation`). Then all pairs together predict the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.epipolar.constellation import patches
from windmark.epipolar.constellation.patches import Neighbours
from windmark.geometry import DegenerateGeometry
from windmark.geometry.planar import NEEDED, PlanarTransform, fit_planar

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

SCALE = 2.0
"""Change of size either way."""
ARMS, NEAR_A, NEAR_B = 4, 12, 20
"""Neighbours that make frames, that test them, and spots of b that may be theirs."""
SEED_TOLERANCE, NOISE_PX = 0.08, 1.5
"""How far a neighbour may lie off, as part of its distance, and besides."""
GROW_TOLERANCE = 0.1
SEED_SPOTS = 120
"""Spots of the reference that are tried, spread over the picture."""
GROWN = 24
"""Matchings that are grown at most."""
CLEAR = 2.0
"""A spot is taken if the next one is so many times farther from the prediction."""
STEPS = 8
"""Neighbours of a spot whose partner it tries in place of its own: a regular layout moved by a pitch."""


@dataclass(frozen=True)
class Candidates:
    """Matchings (C, A): spot of b for each spot of a, or -1; and how many frames were compared to find them."""

    match: Ints
    tried: int


def candidates(a: Array, b: Array, max_shift_px: float | None) -> Candidates:
    """Matchings of spots (A, 2) of the reference and (B, 2) of the image, the most telling seeds first.

    Parameters
    ----------
    a, b : places, pixels
    max_shift_px : no spot has moved farther; None for any motion
    """
    from windmark.tasks.align2d import _kernels as kernels

    nothing = np.zeros((0, len(a)), np.int64)
    if min(len(a), len(b)) < 3:
        return Candidates(nothing, 0)
    near = Neighbours(np.ascontiguousarray(a), np.ascontiguousarray(b), _near(a, NEAR_A), _near(b, NEAR_B))
    allowed = np.zeros((0, 0), np.bool_)
    if max_shift_px is not None:
        allowed = np.linalg.norm(a[:, None] - b[None], axis=2) <= max_shift_px
    first = _spread(a)
    met, offset, turn, tried = kernels.seed_turns(
        near.a, near.na, near.b, near.nb, first, ARMS, allowed, SCALE, SEED_TOLERANCE, NOISE_PX
    )  # fmt: skip
    taken = np.zeros(met.shape, np.bool_)
    row = np.full(len(a), -1)
    row[first] = np.arange(len(first))
    found: list[Ints] = []
    for s, q in _ranked(met, offset):
        if taken[s, q]:
            continue
        z = turn[s, q]
        grown = grow(near, patches.seeded(near, int(first[s]), q, np.array([[z[0], -z[1]], [z[1], z[0]]])), allowed)
        known = np.flatnonzero((grown >= 0) & (row >= 0))
        taken[row[known], grown[known]] = taken[s, q] = True
        _add(found, grown)
        if len(found) == GROWN:
            break
    for match in list(found[:2]):
        for other in _moved_by_a_pitch(near, match, allowed):
            _add(found, other)
    return Candidates(np.array(found) if found else nothing, int(tried))


def grow(near: Neighbours, start: Ints, allowed: Mask) -> Ints:
    """A matching grown from a few pairs: locally, then all together until nothing joins."""
    from windmark.epipolar.constellation import _kernels as kernels

    match = start
    if len(allowed):
        wrong = (match >= 0) & ~allowed[np.arange(len(match)), match]
        match = np.where(wrong, -1, match)
    if (match >= 0).sum() > 3:
        match = kernels.grow(near.a, near.na, near.b, near.nb, match, GROW_TOLERANCE, NOISE_PX, allowed)
    for _ in range(4):
        more = _completed(near, match, allowed)
        if (more == match).all():
            break
        match = more
    return match


def predictor(a: Array, b: Array) -> PlanarTransform | None:
    """The most flexible transformation that so many pairs bear without a check; None for fewer than two."""
    for kind in ("spline", "affine", "similarity"):
        if len(a) >= NEEDED[kind] + (kind == "spline") * 4:
            try:
                return fit_planar(kind, a, b).transform
            except DegenerateGeometry:
                continue
    return None


def _completed(near: Neighbours, match: Ints, allowed: Mask) -> Ints:
    """The matching once more from where its pairs together say that every spot must be."""
    known = np.flatnonzero(match >= 0)
    if len(known) < 3:
        return match
    transform = predictor(near.a[known], near.b[match[known]])
    if transform is None:
        return match
    place = transform.apply(near.a)
    away = cKDTree(near.a[known]).query(near.a, 2)[0]
    far = np.where(match >= 0, away[:, 1], away[:, 0])
    distance, index = cKDTree(near.b).query(place, 2)
    good = (distance[:, 0] < GROW_TOLERANCE * far + NOISE_PX) & (distance[:, 1] > CLEAR * distance[:, 0])
    if len(allowed):
        good &= allowed[np.arange(len(place)), index[:, 0]]
    # Known pairs stay unless their own spot is claimed better by another one; new ones join free spots.
    new = match.copy()
    used = set(match[known].tolist())
    for k in np.argsort(distance[:, 0]):
        if good[k] and new[k] < 0 and int(index[k, 0]) not in used:
            new[k] = index[k, 0]
            used.add(int(index[k, 0]))
    return new


def _moved_by_a_pitch(near: Neighbours, match: Ints, allowed: Mask) -> list[Ints]:
    """What grows when a spot in the middle of a matching takes the partner of one of its neighbours."""
    known = np.flatnonzero(match >= 0)
    if len(known) < 5:
        return []
    inner = (match[near.na[known]] >= 0).sum(axis=1)
    off = np.linalg.norm(near.a[known] - np.median(near.a[known], axis=0), axis=1)
    middle = int(known[np.lexsort((off, -inner))[0]])
    out = []
    for step in near.na[middle, :STEPS]:
        around = near.na[step][match[near.na[step]] >= 0]
        if match[step] < 0 or len(around) < 3:
            continue
        slope = np.linalg.pinv(near.a[around] - near.a[step]) @ (near.b[match[around]] - near.b[match[step]])
        if np.linalg.det(slope) > 0:
            out.append(grow(near, patches.seeded(near, middle, int(match[step]), slope.T), allowed))
    return out


def _add(found: list[Ints], match: Ints) -> None:
    """One more matching, unless it is too small or (nearly) one of those there."""
    count = int((match >= 0).sum())
    if count < 3:
        return
    for k, other in enumerate(found):
        same = int(((match == other) & (match >= 0)).sum())
        if same > 0.8 * min(count, int((other >= 0).sum())):
            if count > (other >= 0).sum():
                found[k] = match
            return
    found.append(match)


def _ranked(met: Ints, offset: Array) -> list[tuple[int, int]]:
    """Seeds that meet at least half of what the best one meets, the most telling first."""
    s, q = np.nonzero(met >= max(2, 0.5 * met.max(initial=0)))
    order = np.lexsort((offset[s, q], -met[s, q]))
    return [(int(s[o]), int(q[o])) for o in order]


def _near(xy: Array, count: int) -> Ints:
    count = min(count, len(xy) - 1)
    return np.ascontiguousarray(cKDTree(xy).query(xy, count + 1)[1][:, 1:], dtype=np.int64)


def _spread(xy: Array) -> Ints:
    """At most `SEED_SPOTS` spots all over the picture."""
    if len(xy) <= SEED_SPOTS:
        return np.arange(len(xy))
    order = np.lexsort((xy[:, 1], xy[:, 0]))
    return order[np.linspace(0, len(xy) - 1, SEED_SPOTS).astype(int)].astype(np.int64)
