"""Labels given as facts: whether the spots say otherwise."""

from __future__ import annotations

from windmark.registration.judge import words
from windmark.registration.judge.verdict import Verdict
from windmark.registration.settle._kernels.settle import STEADY, settle_kernel
from windmark.registration.settle.settling import copied
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import Views


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
