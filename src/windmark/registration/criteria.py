"""What a solution must pass: evidence, misfit, focal length, and the words for what fails. `verdict` asks in order."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Protocol

import numpy as np

from windmark.geometry import Pose
from windmark.geometry.order import median
from windmark.registration._kernels.fit import focal_score_kernel
from windmark.registration.evidence import Evidence
from windmark.registration.result import RunnerUp
from windmark.registration.search.plane import Plane
from windmark.registration.search.pool import Candidate
from windmark.registration.solution import Solution, with_free_focal
from windmark.registration.task import Limits, Task

MISFIT = 4.0
"""The residuals' sigma times this must fit into the neighbourhood of the search."""
TWICE = 3.0**0.5
"""An excess of so many sigma doubles the sigma of the spots."""
SUSPICIOUS = 1.8
"""A misfit of so many sigma of the spots makes the given focal length doubtful."""
MISSED = float(np.log(5.0))
"""More evidence (nats) that such a misfit needs for each missing marker, as if four of five were seen: a labelling that
is right in parts only, or by chance, explains them so, and a part of a large model has much evidence ..."""
LOOSE_AND_SPARSE = 40.0
"""... and so much where most markers are missing; in clutter, where half are, and on top of the other."""
FADE = 0.2
"""Without clutter it fades in from half of the markers in view to this part below."""
LOOSE_AND_HALF = 2.8
"""Without clutter, so much for every marker in view where half are missing: half of a large model has much evidence."""
CLEARLY_BETTER, FOCAL_OFF, FOCAL_SIGMAS = 10.0, 0.05, 4.5
"""A given focal length is wrong when another one is better by so much (nats), and away from it by this (relative) and
by so many sigma; 10 nats are 4.5 sigma (one in 150,000)."""
DOUBTED, MOST = 3.0, 0.6
"""Another one is looked for where it promises so many nats to first order (one in 70 by chance), and below this part of
the markers in view: those that it would bring into their gates are not seen in the residuals."""
FEW_PAIRS = 16
"""With so few a single wrong one can look like a deformation: it must be better than a rigid model without any one."""
MANY = 200
"""Among more pairs a single wrong one cannot hold the focal length."""
FREED_LEAD = 10.0
"""A wrong focal length must explain the spots better than a deformation by so much (nats): one that is off by 20 %
leads by 20 and more, while a slight bending is explained by both about equally well, with the same labels ..."""
FREED_OFF = 0.12
"""... and by focal lengths off by up to 10 %. Of few pairs the simpler explanation is taken where it is farther off."""


def misfit_of(plane: Plane, limits: Limits, best: Solution, taken: float | None = None) -> str:
    """Why the residuals are too large for the markers' own picture; empty if they are not.

    Another model of the same design is matched completely, well beyond chance and without a rival: chance and
    rivals say nothing against it, only what one expects of the table. The few pairs of a part of it may agree by
    luck, so the excess counts with its own sigma on top. The spots may be twice as bad as they say. ``taken`` so many
    coordinates are taken by the fit, all its unknowns by default.
    """
    task = plane.task
    if MISFIT * best.misfit_px > task.tolerance_px:
        return (
            f"with a misfit of {best.misfit_px:.1f} px (1 sigma per coordinate) it is too loose for tolerance_px = "
            f"{task.tolerance_px:.1f}: another or a deformed model, wrong camera parameters, or too small a tolerance"
        )
    depth = best.cam_from_model.apply(task.markers.xyz[best.marker])[:, 2]
    spacing = median(plane.layout.spacing[best.marker] * best.focal_px / depth)
    redundancy = 2 * best.count - (best.parameters if taken is None else taken)
    excess, allowed = table_excess(limits, best.excess_px, redundancy, spacing, task.typical_sigma_px)
    if excess <= allowed:
        return ""
    return (
        f"the markers are off their table by {excess:.2g} px (1 sigma per coordinate; limit {allowed:.2g} "
        f"px with max_table_error = {100 * limits.table_error:.3g} % of their spacing): another model of the "
        "same design, a deformed model, wrong camera parameters, or a table that needs its sigma"
    )


def wrong_focal(plane: Plane, best: Solution) -> str:
    """How another focal length fits clearly better than the given one; empty if none does.

    All labels may be right with a wrong one: it takes much of its error to the distance, and the rest looks like noise.
    """
    if best.count >= MOST * best.expected and focal_gain(plane, best) < DOUBTED:
        return ""
    freed = with_free_focal(plane, best)
    if freed is None or freed.count < best.count:
        # Right labels stay when the focal length is freed; a wrong one among them holds it where it is.
        tried = [freed] if freed is not None else []
        freed = max([*tried, *_without_each(plane, best)], key=lambda t: t.evidence.score, default=None)
    if freed is None or not freed.evidence.score > best.evidence.score + CLEARLY_BETTER:
        return ""
    given, sigma = plane.task.camera.focal_px, freed.focal_sigma
    if not abs(float(np.log(freed.focal_px / given))) > max(FOCAL_OFF, FOCAL_SIGMAS * sigma):
        return ""
    return (
        f"the given focal length of {given:.5g} px does not fit: with {freed.focal_px:.5g} px (1 sigma "
        f"{100 * sigma:.1f} %) the misfit falls from {best.misfit_px:.2g} to {freed.misfit_px:.2g} px"
    )


def other_focal_explains(plane: Plane, best: Solution) -> bool:
    """Whether another focal length explains what a deformation does in ``best``.

    Where many markers are missing, also without any one of the pairs: a wrong one holds the focal length.
    """
    least, freed = best.evidence.score, with_free_focal(plane, best)
    if freed is not None:
        off = abs(float(np.log(freed.focal_px / plane.task.camera.focal_px)))
        lead = FREED_LEAD if best.count > FEW_PAIRS or off < FREED_OFF else 0.0
        if freed.evidence.score > least + lead:
            return True
    if best.count >= MOST * best.expected:
        return False
    return any(other.evidence.score > least + FREED_LEAD for other in _without_each(plane, best))


def _without_each(plane: Plane, best: Solution) -> Iterator[Solution]:
    """The solution with a free focal length and without one of its pairs; none of so `MANY` pairs that one is nothing.

    Thousands of pairs, each left out once, would take minutes.
    """
    for marker in best.marker.tolist() if best.count <= MANY else ():
        if (freed := with_free_focal(plane, best, marker)) is not None:
            yield freed


def beyond_prior(task: Task, best: Candidate | None, least: float) -> str:
    """How far off its prior a candidate with evidence (nats) above ``least`` is; empty where the prior allows it."""
    if best is None or task.prior is None or best.score < least or task.allows(best.cam_from_model, best.focal_px):
        return ""
    angle = float(np.degrees(best.cam_from_model.angle_to(task.prior)))
    ratio = task.distance_ratio(best.cam_from_model, best.focal_px)
    return (
        f"a pose that explains {best.count} spots is off the prior: by {angle:.0f} degrees (limit "
        f"{np.degrees(task.prior_max_angle_rad):.0f}) and at {ratio:.2f} "
        f"times its distance (limit {task.prior_max_scale:.3g} times, either way)"
    )


def focal_gain(plane: Plane, best: Solution) -> float:
    """What another focal length would gain to first order, in nats: Rao's score test with the pose as nuisance.

    0 where the view does not determine it.
    """
    return 0.5 * float(focal_score_kernel(best.unit_xyz(plane), best.markers, plane.spots, best.state)) ** 2


def is_loose(plane: Plane, best: Solution) -> bool:
    """Whether the residuals are larger than the spots' covariances say, and the markers' do not explain it."""
    return too_large(best.misfit_px, best.excess_px, plane.task.typical_sigma_px)


def too_large(misfit_px: float, excess_px: float, sigma_px: float) -> bool:
    """`is_loose` by the numbers alone."""
    return misfit_px > SUSPICIOUS * sigma_px and excess_px > sigma_px


def least_evidence(
    limits: Limits, share: float, count: int, expected: int, loose: bool, *, cluttered: bool = True
) -> float:
    """Evidence (nats) that a solution needs; ``share`` is what a prior leaves of all poses."""
    least, missed = limits.score + float(np.log(share)), MISSED * (expected - count)
    if loose and cluttered:
        return least + (LOOSE_AND_SPARSE if 2 * count <= expected else 0.0) + missed
    if loose:
        sparse = (1 - 2 * count / expected) / FADE
        least += max(LOOSE_AND_SPARSE * min(max(sparse, 0.0), 1.0), missed)
        return max(least, LOOSE_AND_HALF * expected) if 2 * count <= expected else least
    return least


def table_excess(
    limits: Limits, excess_px: float, redundancy: float, spacing_px: float, sigma_px: float
) -> tuple[float, float]:
    """By how much the markers are off their table (1 sigma, with its own uncertainty on top), and the limit."""
    allowed = math.hypot(limits.table_error * spacing_px, TWICE * sigma_px)
    return excess_px * (1 + 1 / math.sqrt(2 * max(redundancy, 1.0))), allowed


class Weighed(Protocol):
    """A solution of one or of several cameras."""

    @property
    def cam_from_model(self) -> Pose:
        """Its pose, as the (first) camera sees it."""

    @property
    def count(self) -> int:
        """Matched markers."""

    @property
    def expected(self) -> int:
        """Markers that should be seen."""

    @property
    def evidence(self) -> Evidence:
        """How much it is worth."""


def ambiguity(
    best: Weighed,
    other: RunnerUp,
    decides: str = "a prior pose or the label of a spot",
    *,
    by_table_errors: bool = False,
) -> str:
    """Why a solution is no answer beside another one, and what would decide."""
    angle = float(np.degrees(best.cam_from_model.angle_to(other.cam_from_model)))
    lead = best.evidence.score - other.score
    if other.same_labels:
        return (
            f"two poses {angle:.1f} degrees apart explain the same labels about equally well (lead {lead:.1f} nats), "
            "as a flat set of markers far away does: give a prior pose"
        )
    if by_table_errors:
        return (
            f"two labellings differ by no more than errors of the table: {best.count} and {other.count} markers "
            f"matched, poses {angle:.1f} degrees apart, lead {lead:.1f} nats, but a symmetric table would fit better; "
            f"the layout is (nearly) symmetric or regular: give {decides}, or a more accurate table"
        )
    missing = best.expected - best.count
    more = f"make more of the {missing} missing markers visible" if missing else "add a marker that breaks the symmetry"
    return (
        f"two labellings are about equally good: {best.count} and {other.count} markers matched, poses {angle:.1f} "
        f"degrees apart, lead {lead:.1f} nats; the layout is (nearly) symmetric or regular: give {decides}, "
        f"or {more}"
    )
