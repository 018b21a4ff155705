"""Whether the lengths of a rig are those of the table: it was measured in another unit, or with another scale bar.

Then no camera is where it is said, and all are wrong by one number. Of two cameras that looks like one that is moved
along the line between them; of more, each alone explains a part of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2, g3
from windmark.geometry import Pose
from windmark.registration.judge.first_order import FirstOrder
from windmark.registration.judge.source import CONFIRMED
from windmark.registration.search.pool import Candidate
from windmark.registration.settle._kernels.doubt import doubt_kernel
from windmark.registration.settle._kernels.state import EXPECTED
from windmark.registration.settle.settling import copied, settle
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import Views, doubted_place
from windmark.registration.task import MIN_COUNT
from windmark.scene.units import mixed_units, spelt

STEPS = 5
"""Of Gauss-Newton for the one factor."""
FOUND = 0.1
"""Of its sigma: so near the factor is found."""


@dataclass(frozen=True, eq=False)
class Lengths:
    """What explains the spots with all lengths of a rig multiplied by one number.

    Parameters
    ----------
    solution : with them
    factor : the number
    evidence : nats of the solution, less the price of the number
    """

    solution: Solution
    factor: float
    evidence: float

    @property
    def words(self) -> str:
        """What is wrong of them."""
        off, units = 100 * (self.factor - 1), ""
        by = f"{g2(abs(off))} % {'larger' if off > 0 else 'smaller'}"
        if not 0.5 < self.factor < 2:
            by = f"{g3(self.factor)} times as large"
            likely = mixed_units(self.factor, self.solution.views.planes[0].task.markers.length_unit)
            units = "" if likely is None else f" (the table in {spelt(likely[0])}, the rig in {spelt(likely[1])}?)"
        shown = " and ".join(f"{n} of {int(of)}" for n, of in zip(
            self.solution.counts, self.solution.state.numbers[:, EXPECTED], strict=True
        ))  # fmt: skip
        return (
            f"the lengths of cam_from_rig are not those of the table{units}: if they were {by}, the cameras would show "
            f"{shown} markers and leave a misfit of {g2(self.solution.misfit_px.max())} px"
        )


def other_lengths(base: Solution, seen: Sequence[Candidate | None]) -> Lengths | None:
    """The best explanation with other lengths of the rig; None where none holds together.

    It is looked for from a solution with the given ones; and from what each camera by itself sees best (``seen``) where
    some see more than that solution has.
    """
    found = [_settled(base, 1.0, base.rig_from_model, base.state.match)]
    if sees_more(base, seen) and (factor := _by_centres(base.views, seen)) is not None:
        c = max(range(len(seen)), key=lambda c: _score(seen[c]))
        own, place = seen[c], _times(base.views.cam_from_rig[c], factor)
        match = np.stack([base.state.match[c] if s is None else s.match for c, s in enumerate(seen)])
        if own is not None:
            found.append(_settled(base, factor, place.inverse() @ own.cam_from_model, match))
    return max((f for f in found if f is not None), key=lambda f: f.evidence, default=None)


def sees_more(base: Solution, seen: Sequence[Candidate | None]) -> bool:
    """Whether a camera by itself sees clearly more than a solution has of it."""
    return any(s is not None and s.score > CONFIRMED + own for s, own in zip(seen, base.scores, strict=True))


def _settled(base: Solution, factor: float, rig_from_model: Pose, match: NDArray[np.int32]) -> Lengths | None:
    """Settled with lengths from ``factor`` on, which is found with all else; None where it falls apart."""
    given, solution, told, step = base.views.cam_from_rig, None, 0.0, 0.0
    start = base.views.layout.frame.unit(rig_from_model)
    for _ in range(STEPS):
        views = base.views
        for c, place in enumerate(given):
            views = views.with_place(c, _times(place, factor))
        if (solution := settle(views, *start, match, anywhere=True)) is None:
            return None
        step, told = _first_order(solution)
        if abs(step) * math.sqrt(told) < FOUND:
            break
        factor *= math.exp(np.clip(step, -0.5, 0.5))
        start, match = (solution.state.rotation, solution.state.translation), solution.state.match
    return Lengths(solution, factor, solution.evidence - 0.5 * math.log1p(told)) if solution is not None else None


def _first_order(solution: Solution) -> tuple[float, float]:
    """By how much (relative) the lengths of the rig would have to change, and what the spots tell of that."""
    views = solution.views.opened([doubted_place(1.0, 1.0)] * len(solution.views.planes))
    normal, side = doubt_kernel(views.sights, copied(views, solution.state))
    columns = solution.views.loose.shape[2]
    asked = np.array([6 + c * (columns + 6) + columns + k for c in range(len(views.planes)) for k in range(3, 6)])
    return FirstOrder(normal, side, np.sort(asked)).along(views.sights.translation.ravel())


def _times(place: Pose, factor: float) -> Pose:
    return Pose(place.rotation, factor * place.translation)


def _score(seen: Candidate | None) -> float:
    return -math.inf if seen is None else seen.score


def _by_centres(views: Views, seen: Sequence[Candidate | None]) -> float | None:
    """How many times as far apart the cameras are as the rig says, by where each sees itself."""
    know = [c for c, s in enumerate(seen) if s is not None and s.count >= MIN_COUNT]
    there = np.array([s.cam_from_model.center for c in know if (s := seen[c]) is not None])
    given = np.array([views.cam_from_rig[c].center for c in know])
    if len(know) < 2:
        return None
    size, wanted = (float(np.linalg.norm(xyz - xyz.mean(axis=0))) for xyz in (given, there))
    return wanted / size if size > 0 and wanted > 0 else None
