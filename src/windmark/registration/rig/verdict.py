"""Accept or refuse what several cameras say together: the rules of one camera, and that no camera contradicts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import bdtr

from windmark.registration.budget import Budget
from windmark.registration.criteria import (
    LOOSE_AND_SPARSE,
    MISSED,
    ambiguity,
    is_loose,
    misfit_of,
    wrong_focal,
)
from windmark.registration.register import MIN_COUNT
from windmark.registration.result import Cause, RunnerUp
from windmark.registration.rig.joint import Joint
from windmark.registration.rig.search import CONFIRMED, RigSearch
from windmark.registration.search.plane import Plane
from windmark.registration.search.pool import Candidate
from windmark.registration.solution import SAME_SHARE, Solution, settle
from windmark.registration.task import Limits

ELSEWHERE = 50.0
"""A camera that does not confirm the solution contradicts it if it has so much evidence (nats) for another one, ..."""
UNLIKELY = 1e-3
"""... or where so few pairs are less likely than this by what the other cameras see, ..."""
SEEN_LEAST, SEEN_MOST = 0.25, 0.95
"""... at least and at most this part of the markers."""


@dataclass(frozen=True, eq=False)
class RigVerdict:
    """The best solution, the best distinct other one, and why it is refused (None: accepted)."""

    best: Joint | None
    runner_up: RunnerUp | None
    cause: Cause | None
    reason: str


class RigJudge:
    """Weighs the joint solutions of a search. ``names`` are the cameras' numbers as the user counts them."""

    def __init__(self, search: RigSearch, names: list[int], limits: Limits, budget: Budget) -> None:
        self._search, self._names, self._limits, self._budget = search, names, limits, budget
        self._planes = search.cameras.planes
        self._challenged: list[Joint] = []
        self._unchallenged = False  # the time was over before all rivals had been looked for

    def verdict(self) -> RigVerdict:
        """Look for rivals of the best solution, and decide."""
        self._challenge()
        solutions = self._search.solutions
        if not solutions:
            return RigVerdict(None, None, "nothing", f"no pose explains the spots of any camera; {self._likely()}")
        best, runner_up = solutions[0], None
        if len(solutions) > 1:
            other = solutions[1]
            same = best.shared(other) > SAME_SHARE
            runner_up = RunnerUp(other.evidence.score, other.cam_from_model, other.count, same)
        cause, reason = self._refusal(best, runner_up)
        if cause is None and self._unchallenged:
            cause = "time"
            reason = f"whether another solution is as good as one of {best.count} of {best.expected} markers is unknown"
        return RigVerdict(best, runner_up, cause, reason)

    def _challenge(self) -> None:
        """Look for rivals until the best solution has none better, or the time is over."""
        while self._search.solutions and not self._unchallenged:
            best = self._search.solutions[0]
            if any(best.same_as(old) for old in self._challenged):
                return
            self._challenged.append(best)
            self._unchallenged = not self._search.rivals(best, lambda: self._budget.exhausted)

    def _refusal(self, best: Joint, runner_up: RunnerUp | None) -> tuple[Cause | None, str]:
        limits, evidence = self._limits, best.evidence
        least = self._least(best)
        seen = f"the best solution matches {best.count} of {best.expected} markers in view of all cameras"
        if not (evidence.log10_nfa < limits.log10_nfa and evidence.score > least):
            return "weak", (
                f"{seen}, which could be chance: false-alarm number 1e{evidence.log10_nfa:+.1f} (limit "
                f"1e{limits.log10_nfa:+.1f}), evidence {evidence.score:.0f} nats (at least {least:.0f}); "
                f"{self._likely()}"
            )
        for name, plane, view in self._parts(best):
            if reason := self._contradiction(plane, view, best):
                return "misfit", f"{seen}, but camera {name} {reason}"
            taken = float(best.state.taken[self._names.index(name)])
            if view.count and (reason := misfit_of(plane, limits, view, taken)):
                return "misfit", f"{seen}, but in camera {name} {reason}, or a wrong cam_from_rig"
        if runner_up is not None and evidence.score - runner_up.score < limits.margin:
            return "ambiguous", ambiguity(best, runner_up, "a prior pose")
        for name, plane, view in self._parts(best):
            if view.count >= MIN_COUNT and (reason := wrong_focal(plane, _alone(plane, view))):
                return "wrong_focal", f"in camera {name} {reason}; correct it"
        return None, ""

    def _least(self, best: Joint) -> float:
        """Evidence that a solution must have: more where residuals are larger than they should be (see `verdict`)."""
        least = self._limits.score + float(np.log(self._planes[0].task.prior_share))
        loose = [view for _, plane, view in self._parts(best) if view.count and is_loose(plane, view)]
        if loose:
            sparse = 2 * best.count < best.expected
            missed = sum(view.expected - view.count for view in loose)
            least += max(LOOSE_AND_SPARSE if sparse else 0.0, MISSED * missed)
        return least

    def _parts(self, best: Joint) -> Iterator[tuple[int, Plane, Solution]]:
        return zip(self._names, self._planes, best.views, strict=True)

    def _contradiction(self, plane: Plane, view: Solution, best: Joint) -> str:
        """Why a camera cannot have seen the model where the others see it; empty if it can."""
        c = best.views.index(view)
        if len(plane.task.xy) < MIN_COUNT or best.scores[c] > CONFIRMED:
            return ""
        shows = f"shows {view.count} of {view.expected} markers among its {len(plane.task.xy)} spots"
        wrong = "its cam_from_rig or focal length is wrong"
        for other in self._search.solutions[1:]:
            if other.scores[c] > ELSEWHERE:
                seen = other.views[c]
                return f"{shows} and would show {seen.count} of {seen.expected} with the model elsewhere: {wrong}"
        could, count, expected = (
            min(view.expected, len(plane.task.xy)),
            best.count - view.count,
            best.expected - view.expected,
        )
        share = min(SEEN_MOST, max(SEEN_LEAST, (count + 1) / (expected + 2)))
        if could == 0 or expected == 0 or bdtr(view.count, could, share) > UNLIKELY:
            return ""
        return (
            f"{shows} where the others see {count} of {expected}: {wrong}, or its view is blocked; leave it out if so"
        )

    def _likely(self) -> str:
        spots = ", ".join(str(len(plane.task.xy)) for plane in self._planes)
        return (
            f"likely too few spots ({spots} for {len(self._planes[0].task.markers)} markers), too much clutter, a "
            "wrong focal length, a wrong cam_from_rig, or another model"
        )


def _alone(plane: Plane, view: Solution) -> Solution:
    """The same labels with the pose that fits this camera best."""
    candidate = Candidate(view.cam_from_model, view.focal_px, 0.0, view.count, view.state.match)
    return settle(plane, candidate) or view
