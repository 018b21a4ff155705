"""Which spots of two pictures of one model are the same markers: candidates judged against each other and chance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.adjust import log_tail
from windmark.errors import g2
from windmark.geometry import DegenerateGeometry
from windmark.geometry.planar import NEEDED, fit_planar, hull_of, inside_hull
from windmark.scene import Detections
from windmark.tasks.align2d.candidates import candidates

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LEVELS_PX = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""How near the spots may be to where the others say they are; the level at which chance is least is taken."""
MAX_LOG10_NFA, MAX_LOG10_NFA_NEAR = -6.0, -3.0
"""Accepted only if chance gives such a matching less often; the second where a largest motion was stated."""
RIVAL = 0.25
"""A rival has at least this part of the best one's pairs,"""
OTHER = 0.2
"""shares at most this part of them with it,"""
LEAD = 12.0
"""and is not behind by so many nats (1 to 160,000) in what tells: precision and spots left out in its midst."""
LN_HOLE = 3.0
"""A spot left out in the midst of a matching: found in the other picture it would be in 19 of 20 cases."""
LOOSE = 0.05
"""Markers of one model lie, 1 sigma per coordinate, within this part of their spacing of where the others say. Two
models painted to one regular plan match as well as one, but for the painter's hand
(tests/tasks/test_align2d_matching.py)."""
FLOOR_PX = 0.02
"""No matching is called more precise than this."""

Cause = Literal["too_few", "nothing", "weak", "ambiguous", "mirrored"]


@dataclass(frozen=True)
class SpotMatching:
    """Pairs of spots.

    Parameters
    ----------
    reference, image : (K,) indices into the detections
    log10_nfa : decimal logarithm of the number of such matchings that chance would give
    sigma_px : robust 1 sigma per coordinate of a pair's place from all others
    rival : (pairs, sigma_px) of the best matching with other pairs, None where none came near
    """

    reference: Ints
    image: Ints
    log10_nfa: float
    sigma_px: float
    rival: tuple[int, float] | None = None


@dataclass(frozen=True)
class NoMatching:
    """Why spots were not matched; falsy."""

    reason: str
    cause: Cause
    count: int = 0
    log10_nfa: float = float("inf")

    def __bool__(self) -> bool:
        return False


@dataclass(frozen=True)
class _Judged:
    """A candidate and what speaks for it."""

    match: Ints
    count: int
    free: int
    sigma_px: float
    holes: int
    log10_nfa: float

    @property
    def evidence(self) -> float:
        """Nats, up to a constant for each pair that all candidates share."""
        return -2 * (self.count - self.free) * float(np.log(self.sigma_px)) - LN_HOLE * self.holes


def match_spots(
    reference: Detections, image: Detections, *, max_shift_px: float | None = None
) -> SpotMatching | NoMatching:
    """Match spots of two pictures of one model by one camera: any shift, turn, scale up to 2, smooth deformation.

    Every way to lay one constellation on the other that grows is judged: by how rarely chance does as well, by how
    precisely each pair's place follows from the other pairs, and by the spots it leaves out in its midst. Spots outside
    its hull say nothing: rows of markers vanish together, in shadow or behind a wall. So a regular layout, which
    explains itself when it is moved by a pitch, is refused, unless irregularities of its markers or a stated largest
    motion tell.

    Parameters
    ----------
    reference, image : spots; false and missing ones are expected
    max_shift_px : no marker has moved farther in the picture

    Returns
    -------
    A `SpotMatching`, or a falsy `NoMatching` with its reason.
    """
    a, b = reference.xy, image.xy
    if min(len(a), len(b)) < 3:
        return NoMatching(
            f"{len(a)} markers in the reference and {len(b)} in the image; at least three in each are needed", "too_few"
        )
    judged = _judged(a, b, max_shift_px)
    limit = MAX_LOG10_NFA if max_shift_px is None else MAX_LOG10_NFA_NEAR
    good = [j for j in judged if j.log10_nfa < limit]
    if not good:
        mirrored = [j for j in _judged(a * [-1.0, 1.0], b, None) if j.log10_nfa < min(limit, MAX_LOG10_NFA)]
        if mirrored and mirrored[0].count >= 5:
            return NoMatching(
                f"{mirrored[0].count} markers match if one picture is mirrored, and none as they are: a mirror image "
                "is no motion; flip the picture first",
                "mirrored", mirrored[0].count, mirrored[0].log10_nfa,
            )  # fmt: skip
        return _none(judged, limit, len(a), len(b), max_shift_px)
    best = good[0]
    rivals = [j for j in judged if j is not best and _other(j, best) and j.count >= RIVAL * best.count]
    real = [j for j in rivals if j.log10_nfa < limit and _lead(best, j) < LEAD]
    if real:
        near = "" if max_shift_px is not None else "; or say how far the markers may have moved (max_shift_px)"
        return NoMatching(
            f"two matchings, of {best.count} and {real[0].count} pairs ({g2(best.sigma_px)} and {g2(real[0].sigma_px)} "
            "px), explain them and neither is chance: the layout looks like itself when it is shifted or turned. "
            f"Give matches by name{near}",
            "ambiguous", best.count, best.log10_nfa,
        )  # fmt: skip
    at = np.flatnonzero(best.match >= 0)
    spacing = _spacing(a[at])
    if best.sigma_px > LOOSE * spacing:
        return NoMatching(
            f"{best.count} markers match, but lie {g2(best.sigma_px)} px from where the others say, "
            f"{100 * best.sigma_px / spacing:.0f} % of their spacing: another model of the same plan, or relief that "
            "moved against its surroundings (then align in 3D); or give matches by name",
            "weak", best.count, best.log10_nfa,
        )  # fmt: skip
    rival = max(rivals, key=lambda j: j.count, default=None)
    return SpotMatching(
        at, best.match[at], best.log10_nfa, best.sigma_px, None if rival is None else (rival.count, rival.sigma_px)
    )


def _none(judged: list[_Judged], limit: float, count_a: int, count_b: int, max_shift_px: float | None) -> NoMatching:
    within = "" if max_shift_px is None else f" within {max_shift_px:g} px"
    if not judged:
        return NoMatching(
            f"no piece of the reference's {count_a} markers is found among the image's {count_b}{within}: another "
            "model, or false spots",
            "nothing",
        )  # fmt: skip
    best = judged[0]
    return NoMatching(
        f"the best matching has {best.count} pairs of {count_a} and {count_b} markers{within}, which could be chance "
        f"(false-alarm number 1e{best.log10_nfa:+.1f}, limit 1e{limit:+.1f}): another model, too few markers, or too "
        "many false spots; give matches by name, or say how far the markers may have moved (max_shift_px)",
        "weak", best.count, best.log10_nfa,
    )  # fmt: skip


def _judged(a: Array, b: Array, max_shift_px: float | None) -> list[_Judged]:
    """All candidates, the one that chance makes most rarely first."""
    found = candidates(a, b, max_shift_px)
    judged = [j for match in found.match if (j := _judge(a, b, match, found.tried)) is not None]
    return sorted(judged, key=lambda j: j.log10_nfa)


def _judge(a: Array, b: Array, match: Ints, tried: int) -> _Judged | None:
    at = np.flatnonzero(match >= 0)
    x, y = a[at], b[match[at]]
    best: _Judged | None = None
    for kind in ("similarity", "affine", "spline"):
        if len(at) < NEEDED[kind] + (4 if kind == "spline" else 0):
            continue
        try:
            fit = fit_planar(kind, x, y)
        except DegenerateGeometry:
            continue
        if np.linalg.det(fit.transform.jacobian(x)).min() <= 0:
            continue
        off = np.hypot(*fit.held_out.T)
        free = 2 if kind == "similarity" else 3
        sigma = float(np.hypot(np.median(off) / 1.1774, FLOOR_PX))
        holes = _holes(a, x, at) + _holes(b, y, match[at])
        one = _Judged(match, len(at), free, sigma, holes, _log10_nfa(off, b, y, len(at) + holes, free, tried))
        if best is None or one.log10_nfa < best.log10_nfa:
            best = one
    return best


def _holes(spots: Array, matched: Array, index: Ints) -> int:
    """Spots without a partner well inside the hull of those with one."""
    rest = np.delete(spots, index, axis=0)
    return int(inside_hull(hull_of(matched), rest, -2.0).sum())


def _log10_nfa(off: Array, b: Array, y: Array, expected: int, free: int, tried: int) -> float:
    """Decimal logarithm of how many such matchings chance gives among those tried."""
    corners = hull_of(b)
    area = _area(corners) if len(corners) > 2 else 0.0
    # Spots in a narrow strip: it is at least as wide as the levels that are asked for.
    area = max(area, float(np.ptp(b, axis=0).max()) * 2 * LEVELS_PX[-1])
    density = len(b) / area
    best = np.inf
    for level in LEVELS_PX:
        chance = min(np.pi * level**2 * density, 0.5)
        hits = int((off < level).sum())
        best = min(best, log_tail(hits - free, max(expected - free, 1), chance))
    return (np.log(max(tried, 1) * len(LEVELS_PX)) + best) / np.log(10)


def _other(one: _Judged, best: _Judged) -> bool:
    """Whether two matchings are different ones."""
    same = int(((one.match == best.match) & (best.match >= 0)).sum())
    return same <= OTHER * min(one.count, best.count)


def _lead(best: _Judged, rival: _Judged) -> float:
    """By how many nats the best one is ahead in what tells: precision of the rival's pairs, and spots left out.

    How many pairs there are is not among it, for the rest may be hidden; what the best one leaves out counts for as
    many pairs as the rival has.
    """
    precision = 2 * (rival.count - rival.free) * np.log(rival.sigma_px / best.sigma_px)
    return float(precision + LN_HOLE * (rival.holes - best.holes * rival.count / best.count))


def _spacing(xy: Array) -> float:
    """Usual distance of neighbours (N, 2): of the nearest, or by the area for each, where that is larger."""
    nearest = float(np.median(cKDTree(xy).query(xy, 2)[0][:, 1]))
    corners = hull_of(xy)
    return max(nearest, float(np.sqrt(_area(corners) / len(xy))) if len(corners) > 2 else 0.0)


def _area(corners: Array) -> float:
    x, y = corners.T
    return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))
