"""Is what was identified to be believed? The residuals as a whole, their pattern, markers and views that lost marks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from windmark.deformation.attached import unattached
from windmark.deformation.bounds import Bounds, at_bounds
from windmark.deformation.equations import Equations
from windmark.deformation.few_walls import displaced_wall, unchecked_walls
from windmark.deformation.lost import lost
from windmark.deformation.misfit import Misfit
from windmark.deformation.moved import candidates, moved, price
from windmark.deformation.own_state import MOMENTS, OwnState, asked_for, two_moments
from windmark.deformation.patterns import Pattern, pattern_of
from windmark.deformation.priors import contradicted
from windmark.deformation.result import NotIdentified
from windmark.deformation.solve import Solved
from windmark.errors import g2
from windmark.scene import Doubt

Array = NDArray[np.float64]

FALSE = 2.5e-4
"""Probability that residuals as large as stated are called too large."""
TOLD = 2
"""Kinds of what a law lacks that are named, the most telling first; how many more there are is said."""
WORTH = 0.1
"""Residuals that are larger than those of so many right instants are worth the test of the cameras."""


@dataclass(frozen=True)
class Verdict:
    """What is to be said.

    Parameters
    ----------
    scale : factor of the covariances, 1 where the residuals are as large as stated
    misfit : what the laws lack, None for nothing
    doubts : sentences
    unchecked : what the images do not tell, and the covariances do not contain
    other : (F, F) what other explanations add to the covariance; None for nothing
    bounds : what parameters at their bounds may have done, or priors that are contradicted; None where there are none
    suspect : names of markers, views and volumes that contradict the rest
    """

    scale: float = 1.0
    misfit: Misfit | None = None
    doubts: tuple[Doubt, ...] = ()
    unchecked: tuple[Doubt, ...] = ()
    bounds: Bounds | None = None
    other: Array | None = None

    @property
    def suspect(self) -> tuple[str, ...]:
        """All that the doubts name."""
        return tuple(dict.fromkeys(n for d in self.doubts for n in d.names))


def judge(solved: Solved, free_moved: bool) -> tuple[Solved, Verdict] | NotIdentified:
    """Judge an adjusted instant; where a camera moved, with ``free_moved``, it is the one with that pose free."""
    judged = _judge(solved, free_moved)
    if isinstance(judged, NotIdentified):
        return judged
    found, verdict = judged
    if (displaced := displaced_wall(found)) is None:
        return found, replace(verdict, unchecked=(*verdict.unchecked, *unchecked_walls(found)))
    doubt, more = displaced
    said = tuple(d for d in verdict.doubts if not (d.cause == "marker" and set(d.names) <= set(doubt.names)))
    return found, replace(verdict, doubts=(doubt, *said), other=more)


def _judge(solved: Solved, free_moved: bool) -> tuple[Solved, Verdict] | NotIdentified:
    """The same but for markers on walls that cannot check each other."""
    beside, unchecked = unattached(solved)
    doubts, unknown = [*beside, *lost(solved)], tuple(unchecked)
    chi2, redundancy = solved.chi2, solved.redundancy
    equations = Equations(solved) if redundancy >= 1 else None
    bounds = None if equations is None else at_bounds(equations, FALSE)
    if bounds is not None and bounds.doubts:
        # What else does not fit need not be at fault: the bound bends everything.
        chi2, redundancy = chi2 - bounds.test, redundancy - bounds.rank
        scale = chi2 / redundancy if chdtrc(redundancy, chi2) < FALSE else 1.0
        return solved, Verdict(scale, None, bounds.doubts, unknown, bounds)
    off = None if equations is None else contradicted(equations, FALSE)
    if off is not None:
        if off.doubts:
            return solved, Verdict(1.0, None, (*doubts, *off.doubts), unknown, off)
        # Of no consequence; nor are the spots worse for it.
        bounds, chi2, redundancy = off, chi2 - off.test, redundancy - off.rank
    # Residuals as small as stated may hide two pictures of different moments, and no more than these.
    if equations is None or (chi2 <= redundancy and not doubts and asked_for(equations) is None):
        return solved, Verdict(doubts=tuple(doubts), unchecked=unknown, bounds=bounds)
    pattern = pattern_of(equations) if chi2 > redundancy else None
    best = price(solved, pattern)
    apart = two_moments(equations, best, pattern is not None)
    views = {v.name for v in solved.task.views}
    suspect = tuple(n for d in doubts for n in d.names if n in views)
    if free_moved and (pattern is not None or suspect or chdtrc(redundancy, chi2) < WORTH):
        found = moved(solved, candidates(equations, suspect), best if apart is None else apart.price)
        if isinstance(found, NotIdentified):
            return found
        if found is not None:
            healed, doubt = found
            own = at_bounds(Equations(healed), FALSE) if healed.at_bound else None
            said = (doubt, *lost(healed), *(own.doubts if own is not None else ()))
            return healed, Verdict(doubts=said, unchecked=unknown, bounds=own)
    if pattern is not None:
        chi2, redundancy = chi2 - pattern.test, redundancy - pattern.rank
        doubts += _lacking(solved, pattern) if apart is None else []
    if apart is not None:
        doubts += _of_two_moments(solved, apart, doubts)
    scale = 1.0
    if chdtrc(redundancy, chi2) < FALSE:
        scale = chi2 / redundancy
        besides = " besides" if doubts else ""
        doubts.append(Doubt((), f"residuals are {g2(np.sqrt(scale))} times as large as stated{besides} (sigma0): "
                            "spots or the table of markers are less certain, or the laws too simple",
                            "noise"))  # fmt: skip
    return solved, Verdict(scale, pattern.misfit if pattern else None, tuple(doubts), unknown, bounds)


def _lacking(solved: Solved, pattern: Pattern) -> list[Doubt]:
    """What the laws lack, by volumes."""
    out, by_volume = [], dict[str, list[str]]()
    for volume, words in pattern.looks:
        by_volume.setdefault(volume, []).append(words)
    laws = {part.name for part in solved.task.volumes.parts if part.law is not None}
    for volume, kinds in by_volume.items():
        head = "law of {} too simple" if volume in laws else "{} deforms and has no law"
        more = f" (and {len(kinds) - TOLD} more)" if len(kinds) > TOLD else ""
        out.append(Doubt((volume,), f"{head}: what is left looks like {' and '.join(kinds[:TOLD])}{more}", "bent"))
    return out


def _of_two_moments(solved: Solved, apart: OwnState, doubts: Sequence[Doubt]) -> list[Doubt]:
    """That a view shows another state, unless it is said already."""
    name = solved.task.views[apart.view].name
    said = any(MOMENTS in doubt.words for doubt in doubts)
    return [] if said else [Doubt((name,), f"{{}} shows another state: {apart.words}", "picture")]
