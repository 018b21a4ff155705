"""What a solution must pass by itself: against chance, within the table, with every pair checked by the others."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.registration import rules
from windmark.registration.judge.scale import allowed_excess, of_scale
from windmark.registration.result import Unchecked
from windmark.registration.settle._kernels.fit import spread_places
from windmark.registration.settle._kernels.places import open_kernel
from windmark.registration.settle._kernels.settle import fit_kernel
from windmark.registration.settle._kernels.state import EXCESS, TAKEN
from windmark.registration.settle.common import is_too_loose
from windmark.registration.settle.settling import copied, with_freedom
from windmark.registration.settle.solution import Solution
from windmark.registration.task import ON_LINE_PX, Limits, off_line

Array = NDArray[np.float64]


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
    if any(is_too_loose(other, c) for c in np.flatnonzero(other.counts).tolist()):
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
        f"the markers are off their table by {excess:.2g} px (1 sigma per coordinate; limit {allowed:.2g} "
        f"px with max_table_error = {100 * limits.table_error:.3g} % of their spacing): another model of the "
        "same design, a deformed model, wrong camera parameters, or a table that needs its sigma"
    )


def held_by_one(best: Solution) -> str:
    """Which pair holds the pose alone, or what else of it is open; empty if every pair is checked by the others.

    A pair whose place the others hardly predict fits wherever its spot is: a foreign spot does as well, and the pose
    follows it. Markers on one line, or a few beside each other, say little of the rest: nothing then is missed
    there. And spots that are no farther from a line than they are from where the solution has them fix no pose: a row
    fits two rows that are seen edge-on.
    """
    seen = [(c, best.views.planes[c].task.xy[best.pairs(c)[0]]) for c in np.flatnonzero(best.counts).tolist()]
    widths = [off_line(xy) - float(best.misfit_px[c]) for c, xy in seen]
    if max(widths) < ON_LINE_PX:
        return f"all of them lie on one line (within {off_line(seen[0][1]):.2g} px, no worse than they fit)"
    if best.is_bent:
        # A pair has most of its own place there: 2 % between the excess of the fit and of the residuals would be all.
        best = with_freedom(best.views, best, relabel=False) or best
    placed = _with_prior(best)
    found = best.openness
    if placed is not best.state.place:
        found = [open_kernel(best.state, placed, c) for c in range(len(best.counts))]
    for c, plane in enumerate(best.views.planes):
        rest, wide = found[c][:2]
        # A bent model leaves the markers that it has no spot of open by its nature.
        if best.counts[c] and not best.is_bent and not wide < plane.task.tolerance_px:
            turn = float(np.sqrt(np.linalg.eigvalsh(best.unit_cov[:3, :3])[-1]))
            return (
                f"the matched markers leave the place of others open: of {plane.task.markers.name[rest]} by "
                f"{wide:.2g} px and the rotation by {np.degrees(turn):.2g} deg (1 sigma), as where they lie on "
                "one line or close together"
            )
    for c, plane in enumerate(best.views.planes):
        marker, wide = found[c][2:]
        if not is_unheld(best, c, marker, wide):
            continue
        alone = wide > plane.task.tolerance_px
        # Of a bent model each pair has most of its own place.
        if alone or (not best.is_bent and _worth(best, placed, c, marker) < rules.FOREIGN):
            x, y = plane.task.xy[best.state.match[c, marker]]
            return (
                f"a single pair holds the pose: marker {plane.task.markers.name[marker]} at ({x:.0f}, {y:.0f}), "
                f"whose place the {best.count - 1} others leave open by {wide:.2g} px (1 sigma); without it the "
                "pose is not determined, and with it nothing checks it"
            )
    return ""


def unheld_pair(best: Solution) -> tuple[int, int, float] | None:
    """Camera, marker and openness (px, 1 sigma) of the pair of a rigid solution that the others hardly check, if any.

    Of a bent model each pair has most of its own place, and its root's pose is known less well than that.
    """
    for c in np.flatnonzero(best.counts).tolist() if not best.is_bent else ():
        marker, wide = best.openness[c][2:]
        if is_unheld(best, c, marker, wide):
            return c, marker, wide
    return None


def without_unheld(best: Solution) -> tuple[Solution, Unchecked] | None:
    """The solution less the pair that the others hardly check, and what is to be said; None where all are checked.

    The pair is likelier than a foreign spot that is anywhere, but foreign spots may be near markers, too.
    """
    if (found := unheld_pair(best)) is None:
        return None
    c, marker, wide = found
    state, plane = copied(best.views, best.state), best.views.planes[c]
    spot, state.match[c, marker] = int(state.match[c, marker]), -1
    if not fit_kernel(best.views.sights, state):
        return None
    x, y = plane.task.xy[spot]
    words = (
        f"a single spot at ({x:.0f}, {y:.0f}) says where marker {plane.task.markers.name[marker]} is, whose place the "
        f"others leave open by {wide:.2g} px (1 sigma): the sigma of the pose is that without it"
    )
    return Solution(best.views, state), Unchecked("pair", words, best.views.names[c])


def is_unheld(best: Solution, c: int, marker: int, wide: float) -> bool:
    """Whether the others hardly check the pair of a marker, whose place they leave open by so much (px, 1 sigma)."""
    xx, _, yy = best.state.spread[c, marker]
    return marker >= 0 and wide > rules.UNHELD * math.sqrt(0.5 * (xx + yy))


def _worth(best: Solution, placed: Array, c: int, marker: int) -> float:
    """Nats by which a pair is likelier than a foreign spot, by what the other pairs say of the place of its marker.

    ``placed`` (C, N, 3) is the covariance of the projections; see `settle._kernels.label.leave_one_out`.
    """
    noise, place = _square(best.state.spread[c, [marker]])[0], _square(placed[c, [marker]])[0]
    value, vector = np.linalg.eigh(noise - place)
    along = (vector.T @ best.state.residual[c, marker]) ** 2
    value = np.maximum(value, 1e-9 * np.trace(noise))
    sights = best.views.sights
    density = sights.density[sights.first[c] + best.state.match[c, marker]]
    spread = float(np.linalg.det(noise)) / math.sqrt(float(value.prod()))
    return -0.5 * float((along / value).sum()) - math.log(2 * math.pi * density * spread)


def _with_prior(best: Solution) -> Array:
    """(C, N, 3) covariance of the projections where the prior, too, says where the model is.

    It is a range: a rotation vector in a ball of radius a has a sigma of a / sqrt(5) along each axis, a number between
    -a and a one of a / sqrt(3).
    """
    state, task = best.state, best.views.planes[0].task
    if task.prior is None:
        return state.place
    # By the rotation, and by the distance along the first camera's axis; in the rig's frame as the unknowns are.
    axis = best.views.cam_from_rig[0].rotation[2]
    known = np.zeros_like(state.factor)
    known[:3, :3] = np.eye(3) * 5.0 / task.prior_max_angle_rad**2
    distance = math.log(task.prior_max_scale) * float(state.translations[0, 2])
    known[3:6, 3:6] = np.outer(axis, axis) * 3.0 / distance**2
    factor = np.asarray(np.linalg.cholesky(np.tril(state.factor) @ np.tril(state.factor).T + known), dtype=np.float64)
    prior = state._replace(factor=factor, place=np.zeros_like(state.place))
    spread_places(best.views.sights, prior)
    return prior.place


def _square(packed: Array) -> Array:
    """(n, 2, 2) symmetric matrices from xx, xy, yy (n, 3)."""
    return packed[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
