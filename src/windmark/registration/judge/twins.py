"""Other poses of mostly the same labels: the tilted one that sees flat markers the same, and a label or two apart.

What lies within the sigma of a solution that is not well determined, or within three degrees, is no rival of it
(`Solution.same_as`). Where it is about as good, the solution's own covariance is only that of one of several places
where the pose may be, and does not know of the others.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from windmark.registration import rules
from windmark.registration.judge.mirror import reach_of
from windmark.registration.settle._kernels.mirror import twin_kernel
from windmark.registration.settle._kernels.places import places_kernel
from windmark.registration.settle.settling import settle
from windmark.registration.settle.solution import SAME_ANGLE, Solution

Array = NDArray[np.float64]

Weighed = tuple[float, Solution]
"""A solution and its probability beside others."""


def twin_of(best: Solution) -> Solution | None:
    """What the labels of a solution become from the other pose that sees nearly flat markers almost the same; None
    where it is not nearly as good.
    """  # fmt: skip
    views, state = best.views, best.state
    near, rotation, translation = twin_kernel(views.sights, state, reach_of(best))
    return settle(views, rotation, translation, state.match, focal_px=state.camera[:, 0]) if near else None


def near_ones(best: Solution, others: Iterable[Solution], margin: float) -> tuple[Weighed, ...]:
    """Solutions that count as the same as the best one, lie elsewhere and are not worse by a margin (nats), each with
    its probability beside the best one and the other ones.
    """  # fmt: skip
    found: list[tuple[float, Solution]] = []
    others = [other for other in others if other is not best]
    gone = best.views.gone if others else np.zeros(0, dtype=bool)
    for other in others:
        if _uses(other, gone) or other.is_bent or other.shared(best) <= rules.SAME_SHARE:
            continue
        if any(_at_one(other, s) for s in (best, *_of(found))):
            continue
        if other.same_as(best) and (lead := best.lead_over(other)) < margin:
            found.append((lead, other))
    if not found:
        return ()
    least = min([0.0, *(lead for lead, _ in found)])
    total = math.exp(least) + sum(math.exp(least - lead) for lead, _ in found)
    return tuple((math.exp(least - lead) / total, other) for lead, other in found)


def elsewhere(best: Solution, other: Solution) -> bool:
    """Whether another solution has the model somewhere else: turned by more than three degrees, and a marker that faces
    a camera farther away than the search looks for its spot.
    """  # fmt: skip
    if best.rig_from_model.angle_to(other.rig_from_model) < SAME_ANGLE:
        return False
    for c in best.seeing:
        seen = best.state.faces[c] | (best.state.match[c] >= 0)
        one, two = (places_kernel(s.views.sights, s.state, c)[seen] for s in (best, other))
        off = np.linalg.norm(one - two, axis=1)
        if off[np.isfinite(off)].max(initial=0.0) > best.views.planes[c].task.tolerance_px:
            return True
    return False


def _uses(solution: Solution, gone: NDArray[np.bool_]) -> bool:
    """Whether a solution has a marker at any of some spots (S,): what these say another one leaves out on purpose."""
    if not gone.any():
        return False
    first = solution.views.sights.first
    return any(bool(gone[first[c] + solution.pairs(c)[0]].any()) for c in range(len(solution.counts)))


def _of(found: list[tuple[float, Solution]]) -> list[Solution]:
    return [other for _, other in found]


def _at_one(one: Solution, other: Solution) -> bool:
    """Whether two solutions are one by either's sigma."""
    if one is other:
        return True
    delta = (one.rig_from_model @ other.rig_from_model.inverse()).log()
    return bool(max(delta @ np.linalg.solve(s.cov, delta) for s in (one, other)) < 1.0)
