"""Accept or refuse: the false-alarm number, the evidence, and the margin to the best other solution.

The count of matched markers decides nothing here. On near-regular rows a shifted labelling may match all markers
in view, so a solution is accepted only when others were looked for on purpose and are clearly worse.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from windmark.registration.bent.solution import Bender, BentSolution
from windmark.registration.budget import SETTLE, SETTLE_PAIR, Budget
from windmark.registration.criteria import (
    FEW_PAIRS,
    ambiguity,
    beyond_prior,
    is_loose,
    least_evidence,
    misfit_of,
    other_focal_explains,
    wrong_focal,
)
from windmark.registration.final import is_bent
from windmark.registration.labels import contradiction
from windmark.registration.result import Cause, RunnerUp
from windmark.registration.search.fixed import FixedSearch
from windmark.registration.search.pool import Candidate
from windmark.registration.search.quads import POOL, QuadSearch
from windmark.registration.search.ransac import Search
from windmark.registration.solution import SAME_SHARE, Solution, settle
from windmark.registration.task import Limits
from windmark.registration.twins import told_by_table_errors

SETTLED = 5
"""Candidates that are refined with the full camera model, best first."""
FEW_SPOTS, FEW_PART, CLUTTERED = 8, 0.2, 6.0
"""Fewer spots than so many, or than this part of the markers, are few; more than this times the markers are clutter."""
WORTH_A_LOOK = 60.0
"""Candidates whose search score is this much (nats) below the best are no rivals."""
DOUBTFUL: tuple[Cause | None, ...] = ("nothing", "weak", "misfit", "ambiguous", "time")
"""Of the best solution; as opposed to a clear one with something wrong about it."""
BENT = 5
"""Candidates from which a deformed model is grown."""
MOSTLY = 0.7
"""In clutter a deformed model must label so many of the markers in view: with dirt everywhere some of it lies where a
deformation of a partly right labelling would have the rest. So it must with an unknown focal length: a wrong one and a
deformation together explain much of a wrong labelling."""
SPARSE = 0.35
"""And everywhere so many: a quarter of many markers, bent, can look right while the rigid model has twice as many."""
ONE_WRONG = 40.0
"""So much (nats) below the best a solution cannot owe to one wrong pair."""
BENT_LEAD = 5.0
"""How much better (nats) it must be than a rigid solution that is accepted."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """The best solution, the best distinct other one, and why it is refused (None: accepted)."""

    best: Solution | None
    runner_up: RunnerUp | None
    cause: Cause | None
    reason: str


class Judge:
    """Weighs the candidates of a search; refined solutions are kept, so asking again costs little."""

    def __init__(self, search: Search | QuadSearch, limits: Limits, budget: Budget) -> None:
        self._search, self._limits, self._budget = search, limits, budget
        self._plane, self._task = search.plane, search.plane.task
        self._settled: dict[Candidate, Solution | None] = {}
        self._kept: dict[Solution, Solution] = {}
        self._explained: dict[BentSolution, bool] = {}
        # A lens that must be moved with a free focal length is not refined together with a deformation.
        moving = self._task.free_focal and (is_bent(self._task.camera) or self._task.camera.cov is not None)
        self._bender = None if moving or not limits.deformation > 0 else Bender(self._plane, limits.deformation, budget)
        self._challenged: list[Candidate] = []
        self._unchallenged = False  # the time was over before all rivals had been looked for

    @property
    def _cluttered(self) -> bool:
        return len(self._task.xy) > CLUTTERED * len(self._task.markers)

    def verdict(self, *, deformed: bool = True) -> Verdict:
        """Look for rivals of the best candidate, refine the best few, and decide.

        Where the rigid model is refused as `DOUBTFUL`, a deformed one is tried only if asked for.
        """
        self._challenge()
        rigid = self._rigid()
        if self._bender is None or rigid.cause == "labels" or (rigid.cause in DOUBTFUL and not deformed):
            return rigid
        if rigid.cause is None and rigid.best is not None and not self._bender.signs(rigid.best):
            return rigid
        return self._deformed(rigid, self._bender)

    def _rigid(self) -> Verdict:
        """The verdict on the rigid model."""
        # Turned ones that a prior rules out may stand before all others.
        solutions = self._solutions(self._search.top(SETTLED)) or self._solutions(self._search.top(POOL))
        if isinstance(self._search, FixedSearch) and (labels := self._contradicted(self._search, solutions)):
            return labels
        if not solutions:
            reason = beyond_prior(self._task, self._search.best, self._limits.score)
            reason = reason or f"no pose explains the neighbourhood of any three markers{self._hint()}"
            return Verdict(None, None, "nothing", reason)
        best, others = solutions[0], solutions[1:]
        runner_up = _runner_up(best, others[0]) if others else None
        cause, reason = self._refusal(best, others)
        if cause is None and self._unchallenged:
            cause = "time"
            reason = f"whether another solution is as good as one of {best.count} of {best.expected} markers is unknown"
        return Verdict(best, runner_up, cause, reason)

    def _deformed(self, rigid: Verdict, bender: Bender) -> Verdict:
        """The verdict on a deformed model if that explains the spots clearly better, otherwise the rigid one.

        A wrong focal length looks like a smooth deformation, too: the simpler explanation goes first. And where a
        rigid model is accepted, a deformed one must label more markers: smooth errors of the table or of the lens
        could be had as a deformation as well, and would take the pose with them.
        """
        candidates = _close(self._search.top(BENT))
        verdict = self._of_deformed(rigid, bender, bender.solutions(candidates))
        if verdict is rigid:
            return rigid
        # Before one is accepted, the others must have had their turn.
        verdict = self._of_deformed(rigid, bender, bender.solutions(candidates, in_a_hurry=False))
        return verdict if bender.all_tried(candidates) else rigid

    def _of_deformed(self, rigid: Verdict, bender: Bender, found: list[BentSolution]) -> Verdict:
        """The verdict on the best of some deformed solutions, best first; the rigid one if it is no better."""
        if not found or self._budget.over:
            return rigid
        best, lead = found[0], 0.0 if rigid.cause else BENT_LEAD
        if rigid.best is not None and best.evidence.score < rigid.best.evidence.score + lead:
            return rigid
        if rigid.cause is None and rigid.best is not None and best.count <= rigid.best.count:
            return rigid
        if best.count < (MOSTLY if self._cluttered or self._task.free_focal else SPARSE) * best.expected:
            return rigid
        solutions = [*found[1:], *self._solutions(self._search.top(SETTLED))]
        others = sorted((s for s in solutions if not s.same_as(best)), key=lambda s: -s.evidence.score)
        if bender.largest(best) > self._limits.deformation or self._refusal(best, others)[0] is not None:
            return rigid
        if best.count <= FEW_PAIRS and self._better_with_one_less(best):
            return rigid
        if self._focal_explains(best):
            return rigid
        return Verdict(best, _runner_up(best, others[0]) if others else None, None, "")

    def _focal_explains(self, best: BentSolution) -> bool:
        """Whether another focal length explains what a deformation does."""
        if self._task.free_focal:
            return False
        if best not in self._explained:
            self._explained[best] = other_focal_explains(self._plane, best)
        return self._explained[best]

    def _better_with_one_less(self, best: Solution) -> bool:
        """Whether a rigid model that explains all pairs but one, nearly, is better than a deformed one of all."""
        return any(other.evidence.score > best.evidence.score for other in self._with_one_less(best))

    def _with_one_less(self, solution: Solution) -> Iterator[Solution]:
        """Rigid solutions that begin without one of the pairs."""
        for marker in solution.marker.tolist():
            match = solution.state.match.copy()
            match[marker] = -1
            self._budget.spend(SETTLE + SETTLE_PAIR * solution.count)
            start = Candidate(solution.cam_from_model, solution.focal_px, 0.0, solution.count - 1, match)
            if (other := settle(self._plane, start)) is not None:
                yield other

    def _checked(self, solution: Solution) -> Solution:
        """The solution without a wrong pair: one among few opens the gates for itself, it must be worth its place."""
        if solution not in self._kept:
            few = solution.count <= FEW_PAIRS and is_loose(self._plane, solution)
            others = self._with_one_less(solution) if few else ()
            self._kept[solution] = max([solution, *others], key=lambda s: s.evidence.score)
        return self._kept[solution]

    def _challenge(self) -> None:
        """Look for rivals until the best candidate has none better, or the time is over."""
        while (best := self._search.best) is not None and not self._unchallenged:
            if any(best.like(old) for old in self._challenged):
                return
            self._challenged.append(best)
            self._unchallenged = not self._search.rivals(best, lambda: self._budget.exhausted)

    def _solutions(self, candidates: list[Candidate], *, labelled: bool = True) -> list[Solution]:
        """Distinct refined solutions, best first; with the fixed labels, or (if not ``labelled``) any."""
        close = _close(candidates)
        for candidate in close:
            if candidate not in self._settled:
                self._budget.spend(SETTLE + SETTLE_PAIR * candidate.count)
                self._settled[candidate] = settle(self._plane, candidate)
        settled = [s for c in close if (s := self._settled[c]) is not None]
        least = max((s.evidence.score for s in settled), default=0.0) - ONE_WRONG
        settled = [self._checked(s) if s.evidence.score > least else s for s in settled]
        found = [s for s in settled if not labelled or self._task.keeps(s.state.match)]
        distinct: list[Solution] = []
        for solution in sorted(found, key=lambda s: -s.evidence.score):
            if not any(solution.same_as(better) for better in distinct):
                distinct.append(solution)
        return distinct

    def _contradicted(self, search: FixedSearch, kept: list[Solution]) -> Verdict | None:
        """The verdict where a solution without the labels is clearly better than the best with them.

        One that is about equally good is what labels are there to rule out.
        """
        candidates = [*search.top(SETTLED), *search.contradictions(SETTLED)]
        others = [s for s in self._solutions(candidates, labelled=False) if not self._task.keeps(s.state.match)]
        if not others:
            return None
        best, score = others[0], kept[0].evidence.score if kept else -np.inf
        if best.evidence.score < score + self._limits.margin or not self._beyond_chance(best):
            return None
        if kept and told_by_table_errors(self._plane, best, kept[0], self._limits.margin):
            return None
        having = f"{kept[0].count} of {kept[0].expected}" if kept else "no solution"
        return Verdict(best, _runner_up(best, kept[0]) if kept else None, "labels", (
            f"fixed labels contradict the spots: {best.count} of {best.expected} markers in view are matched without "
            f"them, {having} with them; {contradiction(self._task, best)}"
        ))  # fmt: skip

    def _beyond_chance(self, best: Solution) -> bool:
        return best.evidence.log10_nfa < self._limits.log10_nfa and best.evidence.score > self._limits.score

    def _refusal(self, best: Solution, others: Sequence[Solution]) -> tuple[Cause | None, str]:
        limits, evidence = self._limits, best.evidence
        # A label rules out all markers but one.
        known = len(self._task.fixed) * float(np.log(len(self._task.markers)))
        loose = is_loose(self._plane, best)
        share, cluttered = self._task.prior_share, self._cluttered
        least = least_evidence(limits, share, best.count, best.expected, loose, cluttered=cluttered) - known
        if not (evidence.log10_nfa < limits.log10_nfa and evidence.score > least):
            return "weak", (
                f"the best solution matches {best.count} of {best.expected} markers in view, which could be chance: "
                f"false-alarm number 1e{evidence.log10_nfa:+.1f} (limit 1e{limits.log10_nfa:+.1f}), "
                f"evidence {evidence.score:.0f} nats (at least {least:.0f}){self._hint()}"
            )
        if misfit := misfit_of(self._plane, limits, best):
            return "misfit", f"the best solution matches {best.count} of {best.expected} markers in view, but {misfit}"
        if others and evidence.score - others[0].evidence.score < limits.margin:
            return "ambiguous", ambiguity(best, _runner_up(best, others[0]))
        for other in others:
            if told_by_table_errors(self._plane, best, other, limits.margin):
                return "ambiguous", ambiguity(best, _runner_up(best, other), by_table_errors=True)
        if self._task.free_focal:
            sigma = best.focal_sigma
            if sigma > limits.focal_sigma:
                return "focal", (
                    f"the labelling is clear, but this view fixes the focal length only to {100 * sigma:.0f} % "
                    f"(1 sigma; limit {100 * limits.focal_sigma:.0f} %): give the focal length, or a view that is "
                    "less frontal or of a less flat set of markers"
                )
        elif wrong := wrong_focal(self._plane, best):
            return "wrong_focal", f"{wrong}; correct it, or set free_focal"
        return None, ""

    def _hint(self) -> str:
        """What the likely reason is that nothing was found."""
        spots, markers = len(self._task.xy), len(self._task.markers)
        likely = []
        if spots < max(FEW_SPOTS, FEW_PART * markers):
            likely.append(f"too few spots ({spots} for {markers} markers)")
        elif spots > CLUTTERED * markers:
            likely.append(
                f"too much clutter ({spots} spots for {markers} markers: be stricter, put the best spots first)"
            )
        if self._task.prior is not None:
            likely.append("a prior that is too far away")
        if self._task.fixed:
            likely.append("a wrong label")
        if self._task.visible is not None:
            likely.append("a grid that does not fit the markers and hides them (try without occlusion)")
        if not self._task.free_focal:
            likely.append("a wrong focal length (try free_focal)")
        likely.append("another model, or its table in another shape")
        return "; likely " + ", or ".join(likely)


def _close(candidates: list[Candidate]) -> list[Candidate]:
    """Those that are worth a look beside the best."""
    return [c for c in candidates if c.score > max(c.score for c in candidates) - WORTH_A_LOOK]


def _runner_up(best: Solution, other: Solution) -> RunnerUp:
    return RunnerUp(other.evidence.score, other.cam_from_model, other.count, best.shared(other) > SAME_SHARE)
