"""The discs of an accepted solution: nothing that is published may contradict its acceptance.

The search and the judge know markers as points. That they are discs of known radii and normals comes last and moves
every projection (`judge.answer`). A table whose radii are in another unit than its places, or whose normals are wrong,
moves them by pixels: so the solution as it is published must pass the gates of the accepted one, and fit no worse.

Wrong radii that do neither move the pose all the same: eccentricity looks like another pose, residuals stay small.
How large the discs are imaged tells them. The eccentricity goes with the square of the radius, so the pose is found
once more with discs of the imaged size, and its covariance has the way there: whatever the reason (a table that is
wrong, a print that bled), the one or the other is right. Where the sizes agree that is next to nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2
from windmark.registration.judge import own
from windmark.registration.judge.answer import away, corrected
from windmark.registration.judge.verdict import Verdict
from windmark.registration.result import Unchecked
from windmark.registration.settle._kernels.state import EXCESS
from windmark.registration.settle.settling import accepted, with_excess
from windmark.registration.settle.solution import Solution
from windmark.registration.task import MIN_COUNT, Limits
from windmark.scene.units import RADII_ODD, RADII_OFF, common_ratio, off_by, radii_told, radii_words

Array = NDArray[np.float64]


def stands(verdict: Verdict, limits: Limits) -> Verdict:
    """The verdict once the discs are looked at: as it was, with what is published; or refused (cause "discs")."""
    if verdict.cause is not None or verdict.best is None:
        return verdict
    best = verdict.best
    markers = best.views.planes[0].task.markers
    ratios, imaged_px = _ratios(best)
    ratio = off_by(ratios, MIN_COUNT)
    odd = radii_words(ratio, markers.length_unit)
    if max(ratio, 1 / ratio) > RADII_OFF:
        fits = f"The places fit: they match {best.count} of {best.expected} markers in view"
        return replace(verdict, cause="discs", reason=f"{odd} {fits}")
    final = corrected(best)
    if words := _grown(best, final, limits):
        return replace(verdict, cause="discs", reason=words)
    unchecked, size = verdict.unchecked, common_ratio(ratios, imaged_px, MIN_COUNT)
    imaged = corrected(best, size.ratio**2) if size.ratio != 1.0 and final.state.offset.any() else None
    # Otherwise the sigma of the pose has it, and there is nothing to look after.
    matters = imaged is not None and _sigmas(final, imaged) > 1.0
    if size.is_off and (matters or max(ratio, 1 / ratio) > RADII_ODD):
        unchecked = (*unchecked, Unchecked("radii", radii_told(size.ratio, markers.length_unit)))
    return replace(verdict, published=final, unchecked=unchecked, imaged=imaged)


def _sigmas(final: Solution, imaged: Solution) -> float:
    """How far the pose with discs of the imaged size is from that with the table's, in its own sigmas."""
    way = away(final, imaged)[:6]
    return float(np.sqrt(way @ np.linalg.solve(final.unit_cov[:6, :6], way)))


def _ratios(best: Solution) -> tuple[Array, Array]:
    """(N,) imaged radii over those that the table lets expect, NaN where either is not known; (N,) imaged, in px."""
    ratios, sizes = [np.zeros(0)], [np.zeros(0)]
    for c in best.seeing:
        task, pose = best.views.planes[c].task, best.cam_from_model(c)
        spot, marker = best.pairs(c)
        if task.radius_px is None or not np.isfinite(task.radius_px[spot] * task.markers.radius[marker]).any():
            continue
        place = pose.apply(task.markers.xyz[marker])
        away = np.linalg.norm(place, axis=1)
        # A disc that is seen obliquely is smaller; where the normal is not known it counts as seen from the front.
        slant = np.abs((pose.rotate(task.markers.normal[marker]) * place).sum(axis=1)) / away
        size = task.markers.radius[marker] * float(best.state.camera[c, 0]) / place[:, 2]
        ratios.append(task.radius_px[spot] / (size * np.sqrt(np.where(np.isfinite(slant), slant, 1.0))))
        sizes.append(task.radius_px[spot])
    return np.concatenate(ratios), np.concatenate(sizes)


def _grown(best: Solution, final: Solution, limits: Limits) -> str:
    """Why the published solution is not the accepted one; empty where it is.

    With the discs as the table has them the gates are the same, and the spots may not speak clearly against it.
    """
    if not final.state.offset.any():
        return ""
    plain = accepted(best)
    # Where some discs are unknown, what the pose made up for in all of them is left in these: no evidence.
    all_known = bool(best.views.planes[0].task.markers.is_disc[(best.state.match >= 0).any(axis=0)].all())
    nats = _worth(plain, final) - _worth(final, plain)
    worse = nats if all_known else 0.0
    if worse <= limits.margin and (_passes(final, limits) or not _passes(plain, limits)):
        return ""
    off = float(np.abs(final.state.offset).max())
    before, after = float(plain.misfit_px.max()), float(final.misfit_px.max())
    return (
        f"the best solution matches {best.count} of {best.expected} markers in view with a misfit of {g2(before)} px "
        f"(1 sigma per coordinate), but as discs of the table's radii and normals, whose images are off the images of "
        f"their centres by up to {g2(off)} px, they fit worse ({g2(after)} px, by {nats:.0f} nats): are radii and "
        "normals right, and in the unit of the places?"
    )


def _worth(one: Solution, other: Solution) -> float:
    """Nats of a solution, with its own excess or with the other's, whichever suits it better.

    The excess is nobody's claim, and it is estimated: from four fifths of the residuals, none where chance could make
    it. Two that explain the same spots alike may come to rest with different ones, and the nats between those, tens of
    them where the spots' covariances differ much, say nothing of the discs.
    """
    same = with_excess(one, other.state.numbers[:, EXCESS])
    return one.score if same is None else max(one.score, same.score)


def _passes(best: Solution, limits: Limits) -> bool:
    """Whether a solution is beyond chance and no camera's misfit is too large: the judge's own gates."""
    beyond = best.log10_nfa < limits.log10_nfa and best.score > own.least_score(best, limits)
    cameras = best.seeing
    return (beyond or own.is_sure_of_few(best, limits)) and not any(own.misfit_of(best, c, limits) for c in cameras)
