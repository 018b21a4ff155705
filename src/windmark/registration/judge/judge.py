"""Accept or refuse: explanations of the same spots compete by evidence.

The count of matched markers decides nothing here. On near-regular rows a shifted labelling may match all markers
in view, so a solution is accepted only when others were looked for on purpose and are clearly worse: chance, other
labellings, the mirrored table, a second copy of the model, another camera, a bent model, one pair less.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np

from windmark.registration import rules
from windmark.registration.budget import Budget
from windmark.registration.judge import one_pair, own, words
from windmark.registration.judge.bending import Bender
from windmark.registration.judge.cameras import Places, blocked
from windmark.registration.judge.doubts import PARTS, UNITS, Doubts, OtherCamera
from windmark.registration.judge.exact import of_cameras
from windmark.registration.judge.mirror import mirror_of
from windmark.registration.judge.repaired import Repaired
from windmark.registration.judge.source import Source, distinct
from windmark.registration.judge.symmetric import told_by_bending, told_by_table_errors
from windmark.registration.judge.twins import Weighed, elsewhere, near_ones, twin_of
from windmark.registration.judge.unseen import unchecked_bend, unchecked_copy, unchecked_shift, unchecked_twice
from windmark.registration.judge.verdict import Verdict, for_camera, runner_up, unbound
from windmark.registration.result import Cause, RunnerUp, Unchecked
from windmark.registration.settle.solution import Solution
from windmark.registration.task import Limits

T = TypeVar("T")

DOUBTFUL: tuple[Cause | None, ...] = ("nothing", "weak", "misfit", "ambiguous", "time", "one_pair")
"""Of the best rigid solution; as opposed to a clear one with something wrong about it."""
BENT = 5
"""Candidates from which a bent model is grown."""
MIRRORS = 8
"""Improper near-symmetries that are tried."""


class Judge:
    """Weighs the candidates of a source; settled solutions are kept, so asking again costs little."""

    def __init__(self, source: Source, limits: Limits, budget: Budget) -> None:
        self._source, self._limits, self._budget = source, limits, budget
        self._views = source.views
        self._bender = Bender(self._views, limits.deformation, budget)
        self._repaired = Repaired(self._views, budget)
        self._asked: dict[tuple[object, ...], Any] = {}  # asked of a solution once and at the next verdict again
        self._plain = -np.inf  # evidence of the rigid solution, if it is an answer
        self._challenged: list[Solution] = []
        self._displaced: OtherCamera | None = None
        self._copies: list[tuple[Solution, Solution | None]] = []
        self._unchallenged = False  # the work was over before all rivals had been looked for
        self._copies_from = 0.0  # part of a second copy's markers that must be seen for it to be met

    def _once(self, make: Callable[..., T], *of: object) -> T:
        """``make(*of)``, kept."""
        if (make, *of) not in self._asked:
            self._asked[(make, *of)] = make(*of)
        return cast("T", self._asked[(make, *of)])

    def _doubts(self, best: Solution) -> Doubts:
        return self._once(Doubts, self._views, best, self._bender.bend, self._limits.margin)

    def _places(self, best: Solution) -> Places:
        return self._once(Places, best, self._limits.margin)

    # --- the verdict ---------------------------------------------------------------------
    def verdict(self, *, deformed: bool = True, final: bool = False) -> Verdict:
        """Look for rivals of the best solution and decide.

        Where the rigid model is refused as `DOUBTFUL`, a bent one is tried only if asked for. Of the ``final`` verdict
        the reason is looked for, too: what else would explain the spots.
        """
        self._challenge()
        rigid = self._rigid()
        accepted = rigid.best is not None and rigid.cause is None
        self._plain = rigid.best.evidence if accepted and rigid.best is not None else -np.inf
        self._displaced = None
        if rigid.best is not None and len(self._views.planes) > 1:
            self._displaced = self._places(rigid.best).displaced(self._source.solutions(), self._source.seen)
        if rigid.cause in DOUBTFUL and not deformed and self._displaced is None:
            return rigid
        # A label may contradict a rigid model because the model is bent.
        verdict = self._bent(rigid) if self._bender.bend > 0.0 else rigid
        if verdict.cause == "labels":
            return verdict
        if verdict.best is not None and (verdict.cause in ("misfit", "weak") or verdict.best.is_bent):
            verdict = unbound(self._views, verdict.best, self._limits.margin) or verdict
        if verdict.cause is None and verdict.best is not None:
            verdict = self._beside_copies(verdict, verdict.best)
        if verdict.cause is None and verdict.best is not None:
            return self._checked(verdict, verdict.best, rigid)
        return self._explained(verdict) if final or self._displaced is not None else verdict

    def _rigid(self) -> Verdict:
        """The verdict on the rigid model with the cameras as given."""
        solutions = self._solutions()
        kept = [s for s in solutions if s.keeps_labels]
        if labels := self._contradicted(kept, [s for s in solutions if not s.keeps_labels]):
            return labels
        if not kept:
            reason = words.beyond_prior(self._views.planes[0].task, self._source.best, self._limits.score)
            none = "no pose explains the neighbourhood of any three markers"
            return Verdict(None, None, "nothing", reason or none + words.what_may_be(self._views))
        more = [s for s in self._repaired.rivals(kept[0], self._limits.margin) if s.keeps_labels]
        return self._judged(kept[0], sorted([*kept[1:], *more], key=lambda s: -s.evidence))

    def _bent(self, rigid: Verdict) -> Verdict:
        """The verdict on a bent model if that explains the spots better, otherwise the rigid one."""
        best = rigid.best
        if rigid.cause is None and best is not None and not self._doubts(best).bending_promises:
            return rigid
        if not (found := self._bender.solutions(self._source.cores(BENT))):
            return rigid
        if best is not None:
            # What bending brings the best one it may bring a rival, too.
            least = 2 * best.evidence - found[0].evidence - self._limits.margin
            found = self._bender.solutions([*self._source.cores(BENT), *self._source.above(least)])
        bent = found[0]
        if best is not None:
            # A rigid answer has a slight bending in its sigma; one that is no answer is likelier than a bent one, too.
            slight = rigid.cause is None and bent.count <= best.count
            if bent.evidence < best.evidence + (self._limits.margin if slight else rules.BENT_LEAD):
                return rigid
        free = all(plane.task.free_focal for plane in self._views.planes)
        if own.labelled(bent) < rules.BENT_MOST[0 if own.is_cluttered(bent) or free else 1]:
            return rigid
        solutions = self._source.solutions()
        others = [s for s in [*found[1:], *solutions] if not s.same_as(bent)]
        verdict = self._judged(bent, sorted(others, key=lambda s: -s.evidence))
        if verdict.cause == "ambiguous" and rigid.cause is None:
            return verdict  # the worse explanation has its lead by the pairs that its misfit drops
        if verdict.cause is not None or not self._bender.allows(bent):
            return rigid
        if bent.count <= rules.FEW and any(s.evidence > bent.evidence for s in self._repaired.with_one_less(bent)):
            return rigid
        if held := one_pair.bent_for_one(bent, self._views):
            verdict = Verdict(bent, verdict.runner_up, "one_pair", f"{words.seen(bent)}, but {held}")
            return rigid if rigid.cause is None else verdict
        if (other := told_by_bending(bent, solutions, self._limits.margin)) is not None:
            answer = runner_up(bent, other, self._limits)
            return Verdict(bent, answer, "ambiguous", words.ambiguity(bent, other, answer, only_by=words.BENDING))
        return verdict

    def _judged(self, best: Solution, others: Sequence[Solution], whole: Solution | None = None) -> Verdict:
        """A solution beside its rivals; ``whole``: with the pairs that it was left without."""
        answer = runner_up(best, others[0], self._limits) if others else None
        cause, reason = self._refusal(best, others, whole)
        if cause == "one_pair" and not best.is_bent and (less := self._repaired.less_unheld(best)):
            rivals = [s for s in (*less[1:], *others) if not s.same_as(less[0])]
            # Whether its spot is the marker's or not, the model is there: what says so is that of either together, and
            # no less than the whole one's.
            ahead = (whole or best).lead_over(less[0])
            more = (whole or best) if ahead < rules.FOREIGN else None
            if less[0].keeps_labels and self._refusal(less[0], rivals, more)[0] is None:
                verdict = self._judged(less[0], rivals, more)  # what hangs on no pair
                return replace(verdict, unchecked=(*one_pair.left_out(best), *verdict.unchecked))
        if cause is None and self._unchallenged:
            cause = "time"
            reason = f"whether another solution is as good as one of {best.count} of {best.expected} markers is unknown"
        return Verdict(best, answer, cause, reason)

    def _refusal(
        self, best: Solution, others: Sequence[Solution], whole: Solution | None = None
    ) -> tuple[Cause | None, str]:
        limits, there = self._limits, whole or best
        least = own.least_score(there, limits)
        beyond = there.log10_nfa < limits.log10_nfa and there.score > least
        if not beyond and not own.is_sure_of_few(there, limits):
            return "weak", words.could_be_chance(best, limits, least)
        names = best.views.names
        for c in range(len(names)) if len(names) > 1 else ():
            if hides := blocked(best, c):
                return "misfit", f"{words.seen(best)}, but camera {names[c]} {hides}"
        for c in best.seeing:
            if misfit := own.misfit_of(best, c, limits):
                where = f"in camera {names[c]} {misfit}, or a wrong cam_from_rig" if len(names) > 1 else misfit
                return "misfit", f"{words.seen(best)}, but {where}"
        for other in others:
            second = words.apart(best, other) and own.beyond_chance(other, limits)
            if own.lead(best, other, limits) < limits.margin or second:
                return "ambiguous", words.ambiguity(best, other, runner_up(best, other, limits))
            if told_by_table_errors(best, other, limits.margin):
                answer = runner_up(best, other, limits)
                return "ambiguous", words.ambiguity(best, other, answer, only_by=words.TABLE_ERRORS)
        for _, other in self._near(best):
            if elsewhere(best, other):
                return "ambiguous", words.ambiguity(best, other, runner_up(best, other, limits))
        if held := one_pair.held_by_one(best):
            return "one_pair", f"{words.seen(best)}, but {held}"
        return None, ""

    # --- what an accepted solution must still stand ---------------------------------------
    def _beside_copies(self, verdict: Verdict, best: Solution) -> Verdict:
        """The verdict beside a second copy of the model among the spots that the best solution leaves."""
        known = [copy for old, copy in self._copies if best.same_as(old)]
        if not known:
            found, self._copies_from = self._source.copies(best, lambda: self._budget.exhausted)
            known = [next((s for s in found if words.apart(best, s) and own.is_copy(best, s, self._limits)), None)]
            self._copies.append((best, known[0]))
        if (other := known[0]) is None:
            return verdict
        answer = runner_up(best, other, self._limits)
        if (bent := self._bender.as_one(best, other)) is not None:
            return Verdict(best, answer, "misfit", words.in_parts(best, other, bent, self._limits.deformation))
        return Verdict(best, answer, "ambiguous", words.ambiguity(best, other, answer))

    def _checked(self, verdict: Verdict, best: Solution, rigid: Verdict) -> Verdict:
        """Other cameras, the mirror image, a free focal length that is not determined; and what stays unchecked."""
        doubts, beside = self._doubts(best), None
        unchecked = [*verdict.unchecked, *doubts.unchecked()]
        if len(self._views.planes) > 1:
            unchecked.extend(self._places(best).unchecked())
        if (other := self._other_camera(best, promised=doubts.camera_promises)) is not None:
            if doubts.is_open(other):
                words_ = f"{other.words}, as it does in a bent model; the sigmas have what would change"
            elif best.is_bent and rigid.cause is None and rigid.best is not None:
                # Then it is no bending, and the rigid model may do.
                return self._checked(rigid, rigid.best, rigid)
            elif best.is_bent or not other.is_slight:
                return for_camera(best, verdict.runner_up, other, self._bender.doubted(best), self._limits)
            else:
                words_ = f"{other.words}; the sigma of the pose has what that would change"
            beside = other.solution
            unchecked.append(Unchecked(other.what, words_))
        elif len(self._views.planes) > 1:
            beside, said = self._places(best).slightly_off()
            unchecked.extend(said)
        if loose := doubts.loose_focal(self._limits.focal_sigma):
            return Verdict(best, verdict.runner_up, "focal", loose)
        if (mirror := self._once(mirror_of, self._views, best, MIRRORS)) is not None:
            lead = best.lead_over(mirror)
            sharper = mirror.misfit_px.max() < rules.SHARPER * best.misfit_px.max()
            if sharper and mirror.lead_over(best) > self._limits.margin:
                second = RunnerUp(best.score - lead, mirror.cam_from_model(), mirror.count, False)
                return Verdict(best, second, "mirrored", words.mirrored(best, mirror, lead))
            if lead < self._limits.margin:
                unchecked.append(Unchecked("mirror", words.MIRROR_UNSEEN))
        unchecked.extend(of_cameras(best, PARTS, UNITS) if beside is None else [])
        unchecked.extend([] if best.is_bent else unchecked_bend(doubts.look))
        unchecked.extend([Unchecked("scale", words.SCALE_UNSEEN)] if len(self._views.planes) == 1 else [])
        unchecked.extend(unchecked_shift(best, own.shift_of(best, self._source.solutions(), self._limits)))
        unchecked.extend(unchecked_twice(best))
        unchecked.extend(unchecked_copy(best, self._copies_from, self._limits.margin))
        if (without := one_pair.without_unheld(best)) is not None:
            unchecked.append(without[1])
        return Verdict(
            best, verdict.runner_up, None, "", tuple(unchecked), beside, self._near(best),
            without=without[0] if without is not None else None,
        )  # fmt: skip

    def _explained(self, verdict: Verdict) -> Verdict:
        """A refusal, with the camera as its reason if another one makes of the best solution a sound one."""
        best = verdict.best
        if best is None or verdict.cause not in ("weak", "misfit", "ambiguous"):
            return verdict
        other = self._other_camera(best, promised=verdict.cause != "ambiguous")
        if other is None or self._refusal(other.solution, ())[0] is not None:
            return verdict
        return for_camera(best, verdict.runner_up, other, self._bender.doubted(best), self._limits)

    def _other_camera(self, best: Solution, *, promised: bool) -> OtherCamera | None:
        """A camera that is another one, or elsewhere in the rig, if that explains the spots better; both where both do.

        Whether its interior parameters are others is asked only where that is ``promised``.
        """
        found = [self._doubts(best).other_camera(self._plain)] if promised else []
        bent = max(best.evidence, self._bender.most_evidence)
        if self._displaced is not None and self._displaced.solution.evidence > bent + self._limits.margin:
            found.append(self._displaced)
        others = sorted((f for f in found if f is not None), key=lambda f: -f.solution.evidence)
        if len(others) > 1 and others[1].solution.evidence > others[0].solution.evidence - self._limits.margin:
            return replace(others[0], words=f"{others[0].words}; or, about as likely: {others[1].words}")
        return others[0] if others else None

    def _near(self, best: Solution) -> tuple[Weighed, ...]:
        """Other explanations that count as the same as a rigid one but have another pose, see `judge.twins`."""
        if best.is_bent:
            return ()
        others = (*self._source.every(), *self._repaired.tried)
        return self._once(near_ones, best, others, self._limits.margin)

    # --- solutions -----------------------------------------------------------------------
    def _challenge(self) -> None:
        """Look for rivals until the best solution has none better, or the work is over."""
        while (solutions := self._source.solutions()) and not self._unchallenged:
            best = solutions[0]
            if any(best.same_as(old) for old in self._challenged):
                return
            self._challenged.append(best)
            self._unchallenged = not self._source.rivals(best, lambda: self._budget.exhausted)
            self._source.add(twin_of(best))

    def _solutions(self) -> list[Solution]:
        """Distinct solutions, best first; among few pairs without a wrong one that opened the gates for itself."""
        found = [*self._source.solutions(), *self._source.contradictions()]
        least = max((s.evidence for s in found), default=0.0) - rules.ONE_WRONG
        return distinct([self._repaired.of(s) if s.evidence > least else s for s in found])

    # --- labels --------------------------------------------------------------------------
    def _contradicted(self, kept: list[Solution], others: list[Solution]) -> Verdict | None:
        """The verdict where a solution without the labels is clearly better than the best with them.

        One that is about equally good is what labels are there to rule out.
        """
        if not others or any(plane.task.binding for plane in self._views.planes):
            return None
        best = others[0]
        if not own.beyond_chance(best, self._limits) or self._refusal(best, ())[0] is not None:
            return None
        if kept and (best.lead_over(kept[0]) < self._limits.margin
                     or told_by_table_errors(best, kept[0], self._limits.margin)):  # fmt: skip
            return None
        having = f"{kept[0].count} of {kept[0].expected}" if kept else "no solution"
        return Verdict(best, runner_up(best, kept[0], self._limits) if kept else None, "labels", (
            f"fixed labels contradict the spots: {best.count} of {best.expected} markers in view are matched without "
            f"them, {having} with them; {words.contradiction(best)}"
        ))  # fmt: skip
