"""No answer may hang on one observation: the explanation without a pair, its spot nobody's, competes with it.

A foreign spot near the place of a hidden marker fits wherever the other pairs hardly say where that marker is: the pose
follows it, or the model bends for it alone. What it is worth then is not what it is likelier than a foreign spot where
the solution has its marker. The rest must be settled without it, and with no more freedom than it needs; then both
explain the same spots, and the lead is what the one spot says for the other pose or the bending.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2
from windmark.geometry.rotations import hat
from windmark.registration import rules
from windmark.registration.result import Unchecked
from windmark.registration.settle._kernels.fit import spread_places
from windmark.registration.settle._kernels.places import open_kernel, places_kernel
from windmark.registration.settle._kernels.settle import fit_kernel
from windmark.registration.settle._kernels.state import State
from windmark.registration.settle.settling import copied, settle_state, with_freedom
from windmark.registration.settle.solution import Solution, opened_in
from windmark.registration.settle.views import Views
from windmark.registration.task import ON_LINE_PX, off_line

Array = NDArray[np.float64]

IN_VIEW = 5.0
"""A marker that is so many sigma of its place outside the picture is not in it."""


def less_one(best: Solution, views: Views, c: int, marker: int) -> Solution | None:
    """What a solution becomes with the freedom of ``views`` where the spot of one pair is no marker's; None where it
    falls apart.
    """  # fmt: skip
    taken = [np.zeros(len(plane.task.xy), dtype=bool) for plane in views.planes]
    taken[c][best.state.match[c, marker]] = True
    rest = views.without(taken)
    state = copied(rest, best.state)
    state.match[c, marker] = -1
    return settle_state(rest, state)


def bent_for_one(bent: Solution, straight: Views) -> str:
    """For which pair alone a model is bent; empty where a straight one does not explain the others about as well.

    Of the pairs it is the one that the straight model with the same labels fits least by what the others say of its
    place: it would gain most without that one.
    """
    rigid = with_freedom(straight, bent, relabel=False)
    if rigid is None:
        return ""
    c, marker = _least_fitting(rigid)
    if (less := less_one(bent, straight, c, marker)) is None or (ahead := bent.lead_over(less)) >= rules.FOREIGN:
        return ""
    return (
        f"it is bent for a single pair, {_named(bent, c, marker)}: without that a straight model explains the others "
        f"about as well (lead {ahead:.1f} nats), and its spot may be a foreign one"
    )


def _least_fitting(solution: Solution) -> tuple[int, int]:
    """Camera and marker of the pair whose residual is largest by the sigma that it has from where the others have it.

    Its square r' D^-1 r, D = N - S, is twice what the others gain without it (see `settle._kernels.label`).
    """
    worst, found = -math.inf, (0, 0)
    for c in range(len(solution.counts)):
        marker, state = solution.pairs(c)[1], solution.state
        noise, residual = _square(state.spread[c, marker]), state.residual[c, marker]
        value, vector = np.linalg.eigh(noise - _square(state.place[c, marker]))
        along = np.einsum("kij,ki->kj", vector, residual)
        value = np.maximum(value, 1e-9 * np.trace(noise, axis1=1, axis2=2)[:, None])
        off = (along**2 / value).sum(axis=1)
        if len(off) and off.max() > worst:
            worst, found = float(off.max()), (c, int(marker[off.argmax()]))
    return found


def _named(best: Solution, c: int, marker: int) -> str:
    """The pair of a marker."""
    plane = best.views.planes[c]
    x, y = plane.task.xy[best.state.match[c, marker]]
    return f"marker {plane.task.markers.name[marker]} at ({x:.0f}, {y:.0f})"


def held_by_one(best: Solution) -> str:
    """Which pair holds the pose alone, or what else of it is open; empty if every pair is checked by the others.

    A pair whose place the others hardly predict fits wherever its spot is: a foreign spot does as well, and the pose
    follows it. Markers on one line, or a few beside each other, say little of the rest: nothing then is missed
    there. And spots that are no farther from a line than they are from where the solution has them fix no pose: a row
    fits two rows that are seen edge-on.
    """
    seen = [(c, best.views.planes[c].task.xy[best.pairs(c)[0]]) for c in best.seeing]
    widths = [off_line(xy) - float(best.misfit_px[c]) for c, xy in seen]
    if max(widths) < ON_LINE_PX:
        return f"all of them lie on one line (within {g2(off_line(seen[0][1]))} px, no worse than they fit)"
    if best.is_bent:
        # A pair has most of its own place there: 2 % between the excess of the fit and of the residuals would be all.
        best = with_freedom(best.views, best, relabel=False) or best
    placed = _with_prior(best)
    found = best.openness if placed is best.state else opened_in(placed)
    for c, plane in enumerate(best.views.planes):
        wide = found[c][1]
        # A bent model leaves the markers that it has no spot of open by its nature.
        if best.counts[c] and not best.is_bent and not wide < plane.task.tolerance_px:
            rest, wide = _open_in_view(best, placed, c)
            if wide < plane.task.tolerance_px:
                continue
            turn = float(np.sqrt(np.linalg.eigvalsh(best.unit_cov[:3, :3])[-1]))
            return (
                f"the matched markers leave the place of others open: of {plane.task.markers.name[rest]} by "
                f"{g2(wide)} px and the rotation by {g2(np.degrees(turn))} deg (1 sigma), as where they lie on "
                "one line or close together"
            )
    for c, plane in enumerate(best.views.planes):
        marker, wide = found[c][2:]
        if not is_unheld(best, c, marker, wide):
            continue
        held = (
            f"a single pair holds the pose: {_named(best, c, marker)}, whose place the {best.count - 1} others leave "
            f"open by {g2(wide)} px (1 sigma)"
        )
        if wide > plane.task.tolerance_px:
            return f"{held}; without it the pose is not determined, and with it nothing checks it"
        # Of a bent model each pair has most of its own place.
        if not best.is_bent and (ahead := _ahead(best, placed, c, marker)) < rules.FOREIGN:
            return f"{held}; with a foreign spot there the others are explained about as well (lead {ahead:.1f} nats)"
    return ""


def _open_in_view(best: Solution, placed: State, c: int) -> tuple[int, float]:
    """The marker without a spot that is most open (px, 1 sigma) of those that may be in the picture; 0 px without any.

    Of a large board seen from near by and aslant others lie far outside, almost beside the camera, where a millimetre
    is thousands of pixels; of walls all round, behind it, where there are no pixels at all. That these are not in the
    picture is told by the directions in which they are.
    """
    sights, state = best.views.sights, best.state
    rest = np.flatnonzero(state.faces[c] & (state.match[c] < 0))
    known = np.isfinite(placed.place[c, rest]).all(axis=1)
    wide = np.full(len(rest), np.inf)
    wide[known] = np.sqrt(np.linalg.eigvalsh(_square(placed.place[c, rest[known]]))[:, 1])
    xy, size = places_kernel(sights, state, c)[rest], sights.size[c]
    outside = np.linalg.norm(np.maximum(np.maximum(-xy, xy - size), 0.0), axis=1)
    away = outside > IN_VIEW * wide  # not where either is unknown
    away |= _elsewhere(best, c, rest)
    if away.all():
        return -1, 0.0
    worst = int(np.argmax(np.where(away, -1.0, wide)))
    return int(rest[worst]), float(wide[worst])


def _elsewhere(best: Solution, c: int, markers: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(K,) which of these markers are in no direction that is in the picture, by as many of its sigmas."""
    state, sights, camera = best.state, best.views.sights, best.camera(c)
    xyz = (sights.xyz + best.displacement)[markers]
    along = xyz @ state.rotations[c].T + state.translations[c]
    away = np.linalg.norm(along, axis=1)
    # A turn and a shift of the pose, [rotation about the unit model's middle, translation], move it by J.
    by_pose = np.concatenate([-hat(xyz @ state.rotation.T), np.broadcast_to(np.eye(3), (len(xyz), 3, 3))], axis=2)
    cov = by_pose @ best.unit_cov[:6, :6] @ by_pose.transpose(0, 2, 1)
    cov[:, np.arange(3), np.arange(3)] += sights.sigma[markers] ** 2
    spread = np.sqrt(np.linalg.eigvalsh(cov)[:, -1])
    w, h = camera.size_px
    corner = camera.directions(np.array([[-0.5, -0.5], [w - 0.5, -0.5], [-0.5, h - 0.5], [w - 0.5, h - 0.5]]))
    if not np.isfinite(corner).all():
        return np.zeros(len(markers), dtype=np.bool_)
    widest = float(np.arccos(np.clip(corner[:, 2].min(), -1.0, 1.0)))
    angle = np.arctan2(np.linalg.norm(along[:, :2], axis=1), along[:, 2])
    return np.asarray((angle - widest) * away > IN_VIEW * spread)


def unheld_pair(best: Solution) -> tuple[int, int, float] | None:
    """Camera, marker and openness (px, 1 sigma) of the pair of a rigid solution that the others hardly check, if any.

    Of a bent model each pair has most of its own place, and its root's pose is known less well than that.
    """
    for c in best.seeing if not best.is_bent else ():
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
        f"others leave open by {g2(wide)} px (1 sigma): the sigma of the pose is that without it"
    )
    return Solution(best.views, state), Unchecked("pair", words, best.views.names[c])


def left_out(best: Solution) -> list[Unchecked]:
    """What is to be said where the solution without its pair that the others hardly check is the answer."""
    if (found := unheld_pair(best)) is None:
        return []
    c, marker, wide = found
    x, y = best.views.planes[c].task.xy[best.state.match[c, marker]]
    words = (
        f"the spot at ({x:.0f}, {y:.0f}) may be marker {best.views.planes[c].task.markers.name[marker]} or a foreign "
        f"one: the others leave the marker's place open by {g2(wide)} px (1 sigma), and it has no label"
    )
    return [Unchecked("pair", words, best.views.names[c])]


def is_unheld(best: Solution, c: int, marker: int, wide: float) -> bool:
    """Whether the others hardly check the pair of a marker, whose place they leave open by so much (px, 1 sigma)."""
    xx, _, yy = best.state.spread[c, marker]
    return marker >= 0 and wide > rules.UNHELD * math.sqrt(0.5 * (xx + yy))


def _ahead(best: Solution, placed: State, c: int, marker: int) -> float:
    """Nats by which a pair is likelier than a foreign spot.

    Where too few others are left to be settled it is by what they and the prior say of the place of its marker, to
    first order; ``placed`` has the covariance of the projections by both, see `settle._kernels.label.leave_one_out`.
    """
    if (less := less_one(best, best.views, c, marker)) is not None:
        return best.lead_over(less)
    noise, place = _square(best.state.spread[c, [marker]])[0], _square(placed.place[c, [marker]])[0]
    value, vector = np.linalg.eigh(noise - place)
    along = (vector.T @ best.state.residual[c, marker]) ** 2
    value = np.maximum(value, 1e-9 * np.trace(noise))
    sights = best.views.sights
    density = sights.density[sights.first[c] + best.state.match[c, marker]]
    spread = float(np.linalg.det(noise)) / math.sqrt(float(value.prod()))
    return -0.5 * float((along / value).sum()) - math.log(2 * math.pi * density * spread)


def _with_prior(best: Solution) -> State:
    """The state with places and openness as they are where the prior, too, says where the model is.

    It is a range: a rotation vector in a ball of radius a has a sigma of a / sqrt(5) along each axis, a number between
    -a and a one of a / sqrt(3).
    """
    state, task = best.state, best.views.planes[0].task
    if task.prior is None:
        return state
    # By the rotation, and by the distance along the first camera's axis; in the rig's frame as the unknowns are.
    axis = best.views.cam_from_rig[0].rotation[2]
    known = np.zeros_like(state.factor)
    known[:3, :3] = np.eye(3) * 5.0 / task.prior_max_angle_rad**2
    distance = math.log(task.prior_max_scale) * float(state.translations[0, 2])
    known[3:6, 3:6] = np.outer(axis, axis) * 3.0 / distance**2
    factor = np.asarray(np.linalg.cholesky(np.tril(state.factor) @ np.tril(state.factor).T + known), dtype=np.float64)
    prior = state._replace(factor=factor, place=np.zeros_like(state.place), open=np.zeros_like(state.open))
    spread_places(best.views.sights, prior)
    open_kernel(prior, prior.place)
    return prior


def _square(packed: Array) -> Array:
    """(n, 2, 2) symmetric matrices from xx, xy, yy (n, 3)."""
    return packed[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
