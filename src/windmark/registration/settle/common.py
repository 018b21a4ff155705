"""The lead of one labelling over another from the spots that both explain, where what is beyond the table is none."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from windmark.registration import rules
from windmark.registration.settle._kernels.label import GATE
from windmark.registration.settle._kernels.places import places_kernel

if TYPE_CHECKING:
    from windmark.registration.settle.solution import Solution

Array = NDArray[np.float64]


def is_too_loose(solution: Solution, c: int) -> bool:
    """Whether a camera's misfit fills the neighbourhood of the search, so that other labels might fit, too."""
    return rules.MISFIT * float(solution.misfit_px[c]) > solution.views.planes[c].task.tolerance_px


def other_labels(a: Solution, b: Solution, part: float) -> bool:
    """Whether a labelling of nearly as many spots, this part at least, is mostly another one."""
    return bool(b.count >= part * a.count and a.shared(b) <= rules.SAME_SHARE)


def goes_on(a: Solution, b: Solution, c: int) -> bool:
    """Whether a regular layout goes on beyond its table in a picture that one solution explains, and another one.

    A board that is larger than its table shows as many spots under a labelling that is shifted by a row: those beyond
    the table, which the one explains and the other does not. They are no chance, so how many each of the two finds is
    no evidence; nor is it where the border of the picture cuts the board and few are left. What a solution explains
    whose misfit is as wide as the neighbourhood of the search is chance.
    """
    if not other_labels(a, b, rules.AS_MANY) or is_too_loose(b, c):
        return False
    spot_a, (spot_b, marker_b) = a.pairs(c)[0], b.pairs(c)
    only_a, only_b = np.setdiff1d(spot_a, spot_b), np.flatnonzero(~np.isin(spot_b, spot_a))
    if len(only_b) > 1 and 2 * len(only_b) >= len(only_a):
        return True
    only_b = only_b[_away(a, c, spot_b[only_b])]
    return not _by_chance(b, c, marker_b, only_b, len(a.views.planes[c].task.xy) - len(spot_a))


def of_both(a: Solution, b: Solution, c: int) -> float:
    """The lead (nats) of one solution over another from the spots of a camera that both explain."""
    (spot_a, marker_a), (spot_b, marker_b) = a.pairs(c), b.pairs(c)
    _, at_a, at_b = np.intersect1d(spot_a, spot_b, assume_unique=True, return_indices=True)
    return float(_worth_of(a, c, marker_a[at_a]).sum() - _worth_of(b, c, marker_b[at_b]).sum())


def _away(a: Solution, c: int, spot: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(K,) spots near which a solution has no free marker: one that its misfit drops is in the table, not beyond it."""
    task, places = a.views.planes[c].task, places_kernel(a.views.sights, a.state, c)
    free = places[(a.state.match[c] < 0) & np.isfinite(places[:, 0])]
    far = np.linalg.norm(free[None] - task.xy[spot][:, None], axis=2).min(axis=1, initial=np.inf)
    return np.asarray(far > task.tolerance_px)


def _by_chance(b: Solution, c: int, marker: NDArray[np.int64], rest: NDArray[np.int64], spare: int) -> bool:
    """Whether so many of some ``spare`` spots, anywhere in the picture, may be where ``b`` has more markers.

    Poisson's law, of as many places as ``b`` has markers in view besides those whose spots another one explains, too.
    """
    if not len(rest):
        return True
    xx, xy, yy = b.state.spread[c, marker[rest]].T
    gate = math.pi * GATE * float(np.sqrt(xx * yy - xy * xy).mean())
    expected = b.state.must[c] | (b.state.match[c] >= 0)
    places = int(expected.sum()) - (len(marker) - len(rest))
    mean = places * spare * gate / math.prod(b.views.planes[c].task.camera.size_px)
    return bool(len(rest) * math.log(mean) - math.lgamma(len(rest) + 1) > -rules.NO_CHANCE)


def _worth_of(solution: Solution, c: int, marker: NDArray[np.int64]) -> Array:
    """(K,) logarithm of the density of each residual."""
    r, (xx, xy, yy) = solution.state.residual[c, marker], solution.state.spread[c, marker].T
    det = xx * yy - xy * xy
    square = (yy * r[:, 0] ** 2 - 2 * xy * r[:, 0] * r[:, 1] + xx * r[:, 1] ** 2) / det
    return np.asarray(-np.log(2 * np.pi * np.sqrt(det)) - 0.5 * square)
