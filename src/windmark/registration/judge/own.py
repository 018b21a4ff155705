"""What a solution must pass by itself: against chance and within the table; and its evidence where residuals may be
of any size, but not without bounds (`of_scale`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2, g3
from windmark.geometry.order import median
from windmark.registration import rules
from windmark.registration.settle._kernels.state import EXCESS, TAKEN
from windmark.registration.settle.common import is_too_loose, other_labels
from windmark.registration.settle.solution import Solution
from windmark.registration.task import Limits

STATED, SIGMAS = math.hypot(1.0, rules.DOUBLED), 21
"""The residuals' sigma is as stated, or up to so many times it, as likely as not; of either it has so many values."""


def is_loose(best: Solution, c: int) -> bool:
    """Whether a camera's residuals are larger than its spots' covariances say, and the markers' do not explain it."""
    misfit = float(best.misfit_px[c])
    if not best.counts[c] or misfit <= rules.LOOSE * best.views.planes[c].task.typical_sigma_px:
        return False
    return misfit > rules.LOOSE * math.sqrt(_known(best, c))


def _known(best: Solution, c: int) -> float:
    """Variance per coordinate that the covariances of a camera's spots and markers explain."""
    spread = best.state.spread[c, best.state.match[c] >= 0]
    return 0.5 * float((spread[:, 0] + spread[:, 2]).mean()) - float(best.state.numbers[c, EXCESS])


def is_cluttered(best: Solution) -> bool:
    """Whether any camera has many more spots than there are markers."""
    return any(len(p.task.xy) > rules.CLUTTER * len(p.task.markers) for p in best.views.planes)


def labelled(best: Solution) -> float:
    """Part of the markers that any camera has in view that any camera has labelled."""
    seen = (best.state.match >= 0).any(axis=0)
    return float(seen.sum() / (seen | best.state.must.any(axis=0)).sum())


def least_score(best: Solution, limits: Limits) -> float:
    """Evidence (nats) that a solution needs against chance.

    What a prior or labels rule out lowers it. A labelling whose residuals are too large may be right in parts only: it
    needs more for every marker that is missing, and much more where half are.
    """
    tasks = [plane.task for plane in best.views.planes]
    known = sum(len(task.fixed) for task in tasks)
    least = limits.score + math.log(tasks[0].prior_share) - known * math.log(len(tasks[0].markers))
    loose = [c for c in range(len(best.counts)) if is_loose(best, c)]
    if not loose:
        return least
    count, expected = best.count, best.expected
    missing = sum(best.state.numbers[c, 2] - best.counts[c] for c in loose)
    missed = rules.MISSED * float(missing)
    if is_cluttered(best):
        return least + (rules.SPARSE if 2 * count <= expected else 0.0) + missed
    sparse = min(max((1 - 2 * count / expected) / rules.FADE, 0.0), 1.0)
    least += max(rules.SPARSE * sparse, missed)
    return max(least, rules.HALF * count) if 2 * count <= expected else least


def beyond_chance(best: Solution, limits: Limits) -> bool:
    """Whether chance does not give such a solution."""
    return best.log10_nfa < limits.log10_nfa and best.score > limits.score


def is_sure_of_few(best: Solution, limits: Limits) -> bool:
    """Whether a rigid solution that explains (nearly) all of few spots is no chance.

    Few pairs cannot reach the score and the false-alarm number that many must have, whose limits leave room for clutter
    that is not as uniform as both suppose. Where there is hardly any clutter the odds against chance themselves decide.
    """
    plane = best.views.planes[0]
    least = plane.task.least_explained
    if len(best.views.planes) > 1 or best.is_bent or not least or best.count < least or is_loose(best, 0):
        return False
    known = len(plane.task.fixed) * math.log(len(plane.task.markers))
    return odds_of_few(best, limits) > limits.score - rules.PRICE - known


def odds_of_few(best: Solution, limits: Limits) -> float:
    """Evidence (nats) of a single camera's solution, where neither the clutter's rate nor the excess is known before.

    `Solution.evidence` charges the solution with clutter as dense as all spots are, and with the excess that the gates
    are kept open for. Here the rate of the clutter has Jeffreys' prior under both explanations, and the residuals'
    sigma is open (`scale.of_scale`). By its construction chance gives odds above exp(t) in less than exp(-t) of the
    pictures (Markov's inequality).
    """
    spots, count = len(best.views.planes[0].task.xy), best.count
    rate = math.lgamma(spots - count + 0.5) - math.lgamma(spots + 0.5) + count * math.log(spots)
    return best.evidence + rate + of_scale(best, limits)


def is_copy(best: Solution, other: Solution, limits: Limits) -> bool:
    """Whether a solution of spots that the best one leaves is no chance: the model is there, too, if half hidden.

    Among very many spots some fit wherever a marker is; their misfit is that of the neighbourhood. That is no doubt of
    one that would be beyond chance alone, if most of its markers are seen twice (what is bent apart is seen once) and
    it fits as the best one does, or as its spots are known: a mirror image taken for the model does not.
    """
    twice = (best.state.match >= 0) & (other.state.match >= 0)
    noise = [plane.task.typical_sigma_px for plane in best.views.planes]
    fits = bool((other.misfit_px <= math.hypot(1.0, rules.DOUBLED) * np.maximum(best.misfit_px, noise)).all())
    if fits and beyond_chance(other, limits) and 2 * int(twice.sum()) > other.count:
        return True
    if any(is_too_loose(other, c) for c in other.seeing):
        return False
    return other.evidence > limits.margin and other.log10_nfa < rules.COPY_NFA


def misfit_of(best: Solution, c: int, limits: Limits) -> str:
    """Why a camera's residuals are too large for the markers' own picture; empty if they are not.

    Another model of the same design is matched completely, well beyond chance and without a rival: chance and
    rivals say nothing against it, only what one expects of the table. The few pairs of a part of it may agree by
    luck, so the excess counts with its own sigma on top. The spots may be twice as bad as they say. What the gates are
    kept open for beyond the residuals (`settle._kernels.fit.excess_of`) is doubt, no error of the table.
    """
    task, misfit = best.views.planes[c].task, float(best.misfit_px[c])
    excess = min(float(best.excess_px[c]), math.sqrt(max(misfit**2 - _known(best, c), 0.0)))
    if is_too_loose(best, c):
        return (
            f"with a misfit of {misfit:.1f} px (1 sigma per coordinate) it is too loose for tolerance_px = "
            f"{task.tolerance_px:.1f}: another or a deformed model, wrong camera parameters, or too small a tolerance"
        )
    redundancy = 2 * int(best.counts[c]) - float(best.state.numbers[c, TAKEN])
    allowed = allowed_excess(best, c, limits)
    excess *= 1 + 1 / math.sqrt(2 * max(redundancy, 1.0))
    if excess <= allowed:
        return ""
    return (
        f"the markers are off their table by {g2(excess)} px (1 sigma per coordinate; limit {g2(allowed)} "
        f"px with max_table_error = {g3(100 * limits.table_error)} % of their spacing): another model of the "
        "same design, a deformed model, wrong camera parameters, or a table that needs its sigma"
    )


def allowed_excess(best: Solution, c: int, limits: Limits) -> float:
    """What the residuals of a camera may have beyond the given covariances (px, 1 sigma per coordinate): the errors
    that the table may have, and spots that are twice as bad as they say.
    """  # fmt: skip
    task, marker = best.views.planes[c].task, best.pairs(c)[1]
    depth = best.cam_from_model(c).apply(task.markers.xyz[marker])[:, 2]
    spacing = median(best.views.layout.spacing[marker] * float(best.state.camera[c, 0]) / depth)
    return math.hypot(limits.table_error * spacing, rules.DOUBLED * task.typical_sigma_px)


def lead(best: Solution, other: Solution, limits: Limits) -> float:
    """How much (nats) more a solution explains than another one, in the reading that is worst for it, whatever sigma
    the residuals of either have (`of_scale`).

    Of a bent solution a rigid rival may be off for want of the bending, so nothing of that is held against it.
    """
    if best.is_bent:
        return best.lead_over(other)
    by_all, by_common = best.leads_over(other)
    by_all += of_scale(best, limits) - of_scale(other, limits)
    return by_all if math.isinf(by_common) else min(by_all, by_common + _scale_by_common(best, other, limits))


def shift_of(best: Solution, others: Sequence[Solution], limits: Limits) -> Solution | None:
    """Another labelling that only spots speak against which it leaves, and may leave: a board beyond its table."""
    for other in others if not best.is_bent else ():
        if other.is_bent or not other_labels(best, other, rules.SHIFTED) or not any(map(len, in_both(best, other))):
            continue  # of other spots altogether it is a second copy
        if best.lead_by_missing(other) >= limits.margin:
            continue
        by_common = best.lead_by_common(other, range(len(best.counts)))
        if by_common + _scale_by_common(best, other, limits) < limits.margin:
            return other
    return None


def _scale_by_common(best: Solution, other: Solution, limits: Limits) -> float:
    """What an unknown sigma adds to the lead (nats) by the spots that both explain."""
    both = in_both(best, other)
    return of_scale(best, limits, both) - of_scale(other, limits, both)


def in_both(one: Solution, other: Solution) -> list[NDArray[np.int64]]:
    """Spots of each camera that both solutions explain."""
    return [np.intersect1d(one.pairs(c)[0], other.pairs(c)[0]) for c in range(len(one.counts))]


def of_scale(solution: Solution, limits: Limits, spots: Sequence[NDArray[np.int64]] | None = None) -> float:
    """What an unknown sigma of the residuals adds to the evidence of a solution (nats), by all its pairs or those with
    some ``spots`` of each camera.

    `Solution.evidence` takes it as the gates have it, which are kept a little open while labels may be wrong. Of many
    pairs that is what the residuals say; of few it blunts what fits, and flatters what does not.

    It is as stated or up to twice that, as spots may be; or else anything, by its logarithm, from there to what errors
    of the table may make of it: by more than `Limits.table_error` no marker is off, so what would need more is worth
    what it is with that. The unknowns of the fit are as sure as the residuals are small.
    """
    total = 0.0
    for c in solution.seeing:
        spot, marker = solution.pairs(c)
        marker = marker if spots is None else marker[np.isin(spot, spots[c])]
        redundancy = 2 * len(marker) - float(solution.state.numbers[c, TAKEN])
        if redundancy <= 0.0:
            continue
        r, (xx, xy, yy) = solution.state.residual[c, marker], solution.state.spread[c, marker].T
        det = xx * yy - xy * xy
        square = float(((yy * r[:, 0] ** 2 - 2 * xy * r[:, 0] * r[:, 1] + xx * r[:, 1] ** 2) / det).sum())
        now = math.sqrt(0.5 * float((xx + yy).mean()))
        stated = math.sqrt(max(now**2 - float(solution.excess_px[c]) ** 2, 0.0))
        most = math.hypot(stated, allowed_excess(solution, c, limits))
        sigma = np.stack([np.geomspace(stated, end, SIGMAS) for end in (STATED * stated, most)]) / now
        worth = -redundancy * np.log(sigma) - 0.5 * square * (1 / sigma**2 - 1)
        total += float(np.logaddexp.reduce(worth, axis=None)) - math.log(worth.size)
    return total
