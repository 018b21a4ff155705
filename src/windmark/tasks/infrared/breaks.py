"""Breaks in the course of temperatures that no heat makes: frames that are lost, a camera's pattern that changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.tasks.infrared.windows import frames_round, size, spread

Array = NDArray[np.float64]

USUAL = 6.0
"""Times the film's usual one that a break is."""
SUDDEN = 3.0
"""Times the changes of the steps round it that a break is. Of a wall that takes heat in it is 2.5 where heat sets in,
and 2.9 at most where it comes and goes within two frames, at whatever instants."""
PART = 0.1
"""Part of the steps beside it that a break is at least."""
GAP = 1.7
"""Times the steps beside it that a step over lost frames is: heat that sets in over steps that grow by no more than
half makes 1.5."""
RATES = (1 / 3, 1.5)
"""The step behind lost frames over the one before them."""
MOST = 30
"""Frames that are lost in one place at most: of more the course before says nothing."""
LIKE = 0.5
"""A jump where the heating begins is none of heat where the nodes differ in it by less than this part of what they
differ by in the heating, or where so large a part of it is not as they are heated later."""
LIKELY = 1.5
"""Times the best number's misfit that another number of lost frames may leave."""


@dataclass(frozen=True)
class Break:
    """One break.

    Parameters
    ----------
    after : the frame before it
    kelvin : scatter of the change over the nodes; of lost frames the middle of what is too much
    lost : how many frames, from and to; None where it is a pattern that changes
    """

    after: int
    kelvin: float
    lost: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class _Look:
    """Five steps (5, N) round a frame, the third being asked: what that is beyond the two beside it (N,)."""

    steps: Array
    beyond: Array

    @property
    def changes(self) -> Array:
        """(4, N) from step to step before it, behind it, over it, and of the two behind over the two before."""
        s = self.steps
        return np.array([s[1] - s[0], s[4] - s[3], s[3] - s[1], s[4] + s[3] - s[1] - s[0]])

    @property
    def rate(self) -> Array:
        """(N,) of the steps but the third."""
        return np.asarray(self.steps[[0, 1, 3, 4]].mean(axis=0))


def breaks_of(values: Sequence[Array | None], times: Array) -> list[Break]:
    """Breaks of a history of F frames.

    Lost frames whose successors have their numbers make every node's temperature go on by so many of its own steps at
    once. A new pattern of offsets (non-uniformity correction) moves each node by something, and for good. Heat that
    sets in, or comes and goes, changes the steps before or behind as well: of a wall that takes it in, whose surface
    follows the root of time.

    Parameters
    ----------
    values : (N,) of each frame, of nodes on thick walls, NaN where unknown; None where the camera has no picture
    times : (F,) seconds; what lies beside a pause is not asked
    """
    looks = _looks(values, times)
    if not looks:
        return []
    noise = float(np.median([spread(look.beyond) for look in looks.values()]))
    level = float(np.median([abs(np.median(look.beyond)) for look in looks.values()]))
    change = float(np.median([spread(c) for look in looks.values() for c in look.changes]))
    out = []
    for k, look in looks.items():
        if _lost(look, noise, level):
            out.append(Break(k, float(np.median(look.beyond)), _count(look)))
        elif _pattern(look, noise, change):
            out.append(Break(k, spread(look.beyond)))
    return out


def unlike_heat(values: Sequence[Array | None], k: int, level: bool) -> bool:
    """Whether what jumps behind frame k, where the heating begins, is surely no heat.

    Heat comes suddenly there, but to each node by a share of its own, and much as it comes later. Where that is nearly
    the same for all nodes a level is not told from it.

    Parameters
    ----------
    level : asked as one of all nodes, else as a pattern
    """
    last = next((v for v in reversed(values) if v is not None), None)
    four = [v for v in values[max(k - 1, 0) : k + 3] if v is not None]
    if last is None or len(four) < 4:
        return False
    steps, rise = np.diff(np.array(four), axis=0), last - four[2]
    on = np.isfinite(steps).all(axis=0) & np.isfinite(rise)
    if not on.any():
        return False
    beyond, rise = (steps[1] - 0.5 * (steps[0] + steps[2]))[on], rise[on]
    if level:
        even, heated = (spread(a) / max(abs(float(np.median(a))), 1e-12) for a in (beyond, rise))
        return bool(even < LIKE * heated)
    basis = np.stack([steps[2][on], rise], axis=1)
    rest = beyond - basis @ np.linalg.lstsq(basis, beyond, rcond=None)[0]
    return bool(np.median(np.abs(rest)) > LIKE * np.median(np.abs(beyond)))


def _looks(values: Sequence[Array | None], times: Array) -> Mapping[int, _Look]:
    """Frame -> steps, where six frames in a row have them."""
    out = {}
    for k, six in frames_round(values, times, 2, 3):
        steps = np.diff(six, axis=0)
        out[k] = _Look(steps, steps[2] - 0.5 * (steps[1] + steps[3]))
    return out


def _pattern(look: _Look, noise: float, change: float) -> bool:
    """Whether the nodes go apart in one step by more than noise, and by more than heat does that changes."""
    here = spread(look.beyond)
    by_heat = np.sqrt(max(max(spread(c) ** 2 for c in look.changes) - change**2, 0.0))
    beside = float(np.abs(np.median(look.steps[[1, 3]], axis=1)).max())
    return bool(here > max(USUAL * noise, SUDDEN * by_heat, PART * beside))


def _lost(look: _Look, noise: float, level: float) -> bool:
    """Whether all nodes go on by a multiple of their own step, rather than by something that is the same for all."""
    before, step, behind = np.median(look.steps[1:4], axis=1)
    beyond = float(np.median(look.beyond))
    first, last = np.abs(np.median(look.changes[:2], axis=1))
    known = 1.25 * noise / np.sqrt(look.steps.shape[1])
    if abs(beyond) < max(USUAL * level, noise, SUDDEN * first, SUDDEN * last):
        return False
    if min(abs(before), abs(behind)) < 5 * known or not RATES[0] < behind / before < RATES[1]:
        return False
    if step / before < GAP or step / behind < GAP:
        return False
    n = beyond / float(np.median(look.rate))
    # Of six frames of equal noise: beyond and rate have parts of it in common.
    own = noise**2 * (1 + 0.3 * n + 0.05 * n**2)
    as_lost = size(look.beyond - n * look.rate) ** 2 - own
    return bool(0 < n < MOST and as_lost < spread(look.beyond) ** 2 - noise**2)


def _count(look: _Look) -> tuple[int, int]:
    """How many frames are lost: with so many the middle of the nodes has the smoothest course."""
    course = np.append(0.0, np.cumsum(np.median(look.steps, axis=1)))
    by_rate = float(np.median(look.beyond)) / float(np.median(look.rate))
    misfit = []
    for n in range(1, 2 * int(np.ceil(by_rate)) + 1):
        at = np.arange(6.0) + n * (np.arange(6) > 2)
        basis = np.vander(at / at[-1], 4)
        misfit.append(float(np.linalg.norm(course - basis @ np.linalg.lstsq(basis, course, rcond=None)[0])))
    likely = np.flatnonzero(np.array(misfit) <= LIKELY * min(misfit)) + 1
    return int(likely[0]), int(likely[-1])
