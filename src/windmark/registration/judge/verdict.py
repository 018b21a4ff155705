"""What the judge says."""

from __future__ import annotations

import math
from dataclasses import dataclass

from windmark.registration import rules
from windmark.registration.judge import words
from windmark.registration.judge.doubts import OtherCamera
from windmark.registration.judge.own import lead
from windmark.registration.judge.twins import Weighed
from windmark.registration.result import Cause, RunnerUp, Unchecked
from windmark.registration.settle._kernels.settle import STEADY, settle_kernel
from windmark.registration.settle.settling import copied
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import Views
from windmark.registration.task import Limits


@dataclass(frozen=True, eq=False)
class Verdict:
    """The best explanation, the best distinct other one, why it is refused (None: accepted), and what is unchecked.

    ``beside`` is another camera's that may be the right one, whose pose the covariance has to cover; so it has that of
    those that are ``near``, each with its probability (`judge.twins`). ``published`` is the best one as it is reported,
    with the discs' eccentricity, once that has been looked at. ``without`` is the best one less a pair that the others
    hardly check: a foreign spot near the marker's place would be taken for it, so the pose is known as it is there.
    ``imaged`` is the published one with discs of the size that they are imaged with (`judge.discs`).
    """

    best: Solution | None
    runner_up: RunnerUp | None
    cause: Cause | None
    reason: str
    unchecked: tuple[Unchecked, ...] = ()
    beside: Solution | None = None
    near: tuple[Weighed, ...] = ()
    published: Solution | None = None
    without: Solution | None = None
    imaged: Solution | None = None


def runner_up(best: Solution, other: Solution, limits: Limits) -> RunnerUp:
    """Another solution beside the best, with the score that it has in comparison."""
    score, same = best.score - lead(best, other, limits), best.shared(other) > rules.SAME_SHARE
    return RunnerUp(score, other.cam_from_model(), other.count, same)


def for_camera(
    best: Solution, answer: RunnerUp | None, other: OtherCamera, bent: Solution | None, limits: Limits
) -> Verdict:
    """The refusal for another camera; for a bent model that should be rigid, where that explains the spots better; for
    either where they do about as well.
    """  # fmt: skip
    ahead = -math.inf if bent is None else bent.evidence - other.solution.evidence
    if bent is None or ahead < -limits.margin:
        return Verdict(best, answer, other.cause, other.words)
    reason = f"{words.seen(best)}, but {words.is_bent(bent, limits.deformation)}"
    if ahead < limits.margin:
        reason += f"; or, about as likely: {other.words}"
    return Verdict(best, answer, "misfit", reason)


def unbound(views: Views, best: Solution, margin: float) -> Verdict | None:
    """The verdict where binding labels are against all others: without them a rigid model explains more."""
    if not any(plane.task.binding and plane.task.fixed for plane in views.planes):
        return None
    state = copied(views, best.state)
    for c, plane in enumerate(views.planes):
        marker = [m for _, m in plane.task.fixed]
        state.bound[c], state.match[c, marker] = -1, -1
    if settle_kernel(views.sights, state, 0) != STEADY:
        return None
    free = Solution(views, state)
    if free.keeps_labels or free.evidence < best.evidence + margin:
        return None
    return Verdict(free, None, "labels", (
        f"binding labels contradict the others: {free.count} of {free.expected} markers in view fit without them, "
        f"and better; {words.contradiction(free)}"
    ))  # fmt: skip
