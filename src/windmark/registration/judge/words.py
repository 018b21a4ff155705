"""The judge's reasons in words."""

from __future__ import annotations

import numpy as np

from windmark.errors import g2, g3
from windmark.registration import rules
from windmark.registration.result import RunnerUp
from windmark.registration.search.pool import Candidate
from windmark.registration.settle._kernels.places import places_kernel
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import Views
from windmark.registration.task import Limits, Task

FEW_SPOTS, FEW_PART = 8, 0.2
"""Fewer spots than so many, or than this part of the markers, are few."""
MIRROR_UNSEEN = (
    "the mirror image of the table explains the spots about as well: whether picture or table is mirrored cannot be "
    "seen here"
)
TABLE_ERRORS, BENDING = "errors of the table", "a bending of the model"
"""What alone may tell two labellings apart, and is no evidence for either."""
SCALE_UNSEEN = "one camera sees no scale: a table that is too large looks like one that is nearer"


def seen(best: Solution) -> str:
    """How much of the model the best solution explains."""
    where = " of all cameras" if len(best.counts) > 1 else ""
    return f"the best solution matches {best.count} of {best.expected} markers in view{where}"


def could_be_chance(best: Solution, limits: Limits, least: float) -> str:
    """Why a solution is weak."""
    return (
        f"{seen(best)}, which could be chance: false-alarm number 1e{best.log10_nfa:+.1f} (limit "
        f"1e{limits.log10_nfa:+.1f}), evidence {best.score:.0f} nats (at least {least:.0f})"
        f"{what_may_be(best.views, with_prior=False)}"
    )


def what_may_be(views: Views, *, with_prior: bool = True) -> str:
    """What is to be looked at when nothing was found: what is known of the task, not a guess at the cause."""
    tasks = [plane.task for plane in views.planes]
    markers, may = len(tasks[0].markers), []
    counts = ", ".join(str(len(task.xy)) for task in tasks)
    if max(len(task.xy) for task in tasks) < max(FEW_SPOTS, FEW_PART * markers):
        may.append(f"there are few spots ({counts} for {markers} markers)")
    elif any(len(task.xy) > rules.CLUTTER * markers for task in tasks):
        may.append(f"there is much clutter ({counts} spots for {markers} markers: be stricter, put the best first)")
    if with_prior and tasks[0].prior is not None:
        may.append("poses off the prior were left out")
    if any(task.fixed for task in tasks):
        may.append("some labels were given")
    if any(task.visible is not None for task in tasks):
        may.append("markers that the grid hides were left out (does it fit the markers? try without occlusion)")
    if not any(task.free_focal for task in tasks):
        may.append("the focal length was taken as given (or try free_focal)")
    if len(tasks) > 1:
        may.append("cam_from_rig was taken as given")
    return "; to look at: " + ", ".join([*may, "is it this model, in this shape?"])


def beyond_prior(task: Task, best: Candidate | None, least: float) -> str:
    """How far off its prior a candidate with evidence (nats) above ``least`` is; empty where the prior allows it."""
    if best is None or task.prior is None or best.score < least or task.allows(best.cam_from_model, best.focal_px):
        return ""
    angle = float(np.degrees(best.cam_from_model.angle_to(task.prior)))
    ratio = task.distance_ratio(best.cam_from_model, best.focal_px)
    return (
        f"a pose that explains {best.count} spots is off the prior: by {angle:.0f} degrees (limit "
        f"{np.degrees(task.prior_max_angle_rad):.0f}) and at {ratio:.2f} "
        f"times its distance (limit {g3(task.prior_max_scale)} times, either way)"
    )


def ambiguity(best: Solution, other: Solution, answer: RunnerUp, *, only_by: str = "") -> str:
    """Why a solution is no answer beside another one, and what would decide; ``only_by`` what its lead rests on."""
    angle = float(np.degrees(best.rig_from_model.angle_to(other.rig_from_model)))
    lead = best.score - answer.score
    # Both are within a prior that was given: it has not told them apart.
    prior = best.views.planes[0].task.prior is not None
    label = f"the label of {'another' if any(plane.task.fixed for plane in best.views.planes) else 'a'} spot"
    decides = label if prior else f"a prior pose or {label}"
    if answer.same_labels:
        closer = "a closer prior pose" if prior else "a prior pose"
        return (
            f"two poses {angle:.1f} degrees apart explain the same labels about equally well (lead {lead:.1f} nats), "
            f"as a flat set of markers far away does: give {closer}"
        )
    if apart(best, other):
        return (
            f"the model is seen twice: {best.count} markers matched in one place and {other.count} in another, by "
            "other spots, as with a reflection, a ghost or a second model in view: exclude its spots, or give "
            f"{decides}"
        )
    if only_by:
        fits = "a symmetric table would fit better" if only_by == TABLE_ERRORS else "a rigid model tells them no better"
        better = ", or a more accurate table" if only_by == TABLE_ERRORS else ""
        return (
            f"two labellings differ by no more than {only_by}: {best.count} and {other.count} markers "
            f"matched, poses {angle:.1f} degrees apart, lead {lead:.1f} nats, but {fits}; "
            f"the layout is (nearly) symmetric or regular: give {decides}{better}"
        )
    missing = best.expected - best.count
    more = f"make more of the {missing} missing markers visible" if missing else "add a marker that breaks the symmetry"
    return (
        f"two labellings are about equally good: {best.count} and {other.count} markers matched, poses {angle:.1f} "
        f"degrees apart, lead {lead:.1f} nats; the layout is (nearly) symmetric or regular: give {decides}, "
        f"or {more}"
    )


def in_parts(best: Solution, other: Solution, bent: Solution, most: float) -> str:
    """That two rigid solutions are parts of a bent model, which may differ from its table by ``most`` of its size."""
    return f"{seen(best)}, and {other.count} spots are those of other markers elsewhere: {is_bent(bent, most)}"


def is_bent(bent: Solution, most: float) -> str:
    """That the model is bent, and by how much of its size; ``most`` is allowed."""
    return (
        f"it is one model that is bent by {g2(100 * bent.largest)} % of its size, as that explains {bent.count} of "
        f"{bent.expected} markers in view (max_deformation = {g2(100 * most)} %)"
    )


def mirrored(best: Solution, mirror: Solution, lead: float) -> str:
    """That the mirrored table explains the spots better; ``lead`` (nats, negative) is that of the table over it."""
    return (
        f"the mirror image of the table explains the spots better than the table (by {-lead:.0f} nats, {mirror.count} "
        f"and {best.count} markers matched): the picture or the table is mirrored"
    )


def apart(best: Solution, other: Solution) -> bool:
    """Whether two solutions explain mostly different spots."""
    shared = 0
    for c in range(len(best.counts)):
        shared += len(set(best.pairs(c)[0].tolist()).intersection(other.pairs(c)[0].tolist()))
    return 2 * shared < min(best.count, other.count)


def contradiction(found: Solution) -> str:
    """Which labels a solution without them contradicts, in words."""
    parts = []
    for c, plane in enumerate(found.views.planes):
        match, place = found.state.match[c], places_kernel(found.views.sights, found.state, c)
        names = plane.task.markers.name
        where = f"camera {found.views.names[c]}: " if len(found.views.planes) > 1 else ""
        for spot, marker in plane.task.fixed:
            if match[marker] == spot:
                continue
            (x, y), (px, py) = plane.task.xy[spot], place[marker]
            away = f"{float(np.hypot(px - x, py - y)):.1f} px away" if np.isfinite(px) else "out of sight"
            holder = np.flatnonzero(match == spot)
            held = f" and takes the spot for {names[holder[0]]}" if len(holder) else ""
            parts.append(f"{where}{names[marker]} at ({x:.1f}, {y:.1f}): it has this marker {away}{held}")
    return "; ".join(parts)
