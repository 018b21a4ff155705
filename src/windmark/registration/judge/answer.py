"""An accepted explanation as it is reported: excess by the residuals alone, discs' centres, a sigma that covers.

- A disc's image is an ellipse whose centre is not the image of the disc's centre (`geometry.discs`). Where a marker
  has a normal and a radius, the projection is moved by that eccentricity at the pose at hand, and the pose is refined
  again; the eccentricity changes so little with the pose that two rounds are enough.
- Where few markers hold the pose the least squares are so far from linear that their own sigma is too small by several
  times: a row that waves a little is turned about itself along a curve. The covariance has the second order, too.
- Errors of the table are the same in all cameras of a rig.
- The pose of a bent model is that of its root, see `judge.root`. Where a rigid one leaves more than the noise of the
  spots, it may be bent after all, and the covariance of its pose has what that would change.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import imaged_ellipse
from windmark.registration._kernels.growth import _move
from windmark.registration.judge.root import likeliest, root_of
from windmark.registration.judge.twins import Weighed
from windmark.registration.settle._kernels.curve import curve_kernel
from windmark.registration.settle._kernels.project import place_cameras, room_for, see
from windmark.registration.settle._kernels.settle import accept_kernel
from windmark.registration.settle.settling import accepted, copied
from windmark.registration.settle.solution import Solution

Array = NDArray[np.float64]

DISC_ROUNDS = 2


def corrected(best: Solution, part: float = 1.0) -> Solution:
    """The solution with its excess by the residuals alone, and with the discs' eccentricity, or ``part`` of it."""
    best = accepted(best)
    discs = best.views.planes[0].task.markers.is_disc
    for _ in range(DISC_ROUNDS if discs.any() else 0):
        state = copied(best.views, best.state)
        for c in best.seeing:
            state.offset[c] = part * _eccentricity(best, c, discs)
        if not accept_kernel(best.views.sights, state):
            break
        best = Solution(best.views, state)
    return best


def answer(
    best: Solution, beside: Solution | None = None, bends: float = 0.0, near: Sequence[Weighed] = (),
    final: Solution | None = None, without: Solution | None = None, imaged: Solution | None = None,
) -> tuple[Solution, Array]:  # fmt: skip
    """The solution as it is reported, and the covariance (P, P) of all its unknowns; ``final`` where it is `corrected`.

    Where another camera fits better ``beside``, but it is only slightly another or the model may be bent instead, the
    covariance has the way from the one explanation to the other, and of the pose also that one's own.
    ``bends`` is the evidence (nats) of other pictures that the model bends. Solutions that are ``near`` a rigid one
    (weight, solution) are parts of one distribution of the pose, whose second moment about the answer is given.
    What only one pair says, ``without`` which the solution is less certain, is no more certain than that. Discs may be
    as large as they are ``imaged`` (`judge.discs`): the covariance has the way there.
    """
    single = 0.0 if without is None else _more_open(best, without)
    best = final or corrected(best)
    curved, sized = curvature(best), 0.0 if imaged is None else away(best, imaged)
    more = single + curved + np.outer(sized, sized) + of_one_table(best)
    best, cov = _of_root(best, bends)
    cov[: len(curved), : len(curved)] += more
    if near:
        cov *= 1.0 - sum(weight for weight, _ in near)
    for weight, other in near:
        way = _way(best, other)
        cov += weight * (other.unit_cov + np.outer(way, way))
    if beside is not None:
        way = _way(best, beside)
        cov += np.outer(way, way)
        cov[:6, :6] += beside.unit_cov[:6, :6]
    return best, cov


def of_one_table(best: Solution) -> Array:
    """(P, P) what the cameras of a rig add to the covariance of the unknowns because they see the same markers.

    A marker that is not where the table says is so in all pictures. The normal equations take its residuals in C
    cameras for independent, as if the errors of the table became less the more cameras look. With the same weights W,
    the covariance is C (J'W V W J) C for the V that has what the cameras share: J'WJ, and between two of them
    J'W G S G'W J for the derivative G of a marker's image by its place and the covariance S of that. What the residuals
    have beyond all sigmas is taken for errors of the table, too.
    """
    sights, state, cov = best.views.sights, best.state, best.unit_cov
    if len(best.seeing) < 2 or not (sights.sigma.any() or best.excess_px.any()):
        return np.zeros_like(cov)
    xy, by = room_for(state)
    together, alone = np.zeros((len(sights.xyz), len(cov), 3)), np.zeros_like(cov)
    for c in best.seeing:
        see(sights, state, c, state.match[c] >= 0, xy, by)
        seen = np.flatnonzero((state.match[c] >= 0) & np.isfinite(xy[:, 0]))
        slopes, by_place, (xx, xy_, yy) = by[seen, :, :-3], by[seen, :, -3:], state.spread[c, seen].T
        weight = np.linalg.inv(np.stack([xx, xy_, xy_, yy], axis=1).reshape(-1, 2, 2))
        excess = 2 * best.excess_px[c] ** 2 / (by_place**2).sum(axis=(1, 2))
        off = np.sqrt(sights.sigma[seen] ** 2 + excess[:, None])
        pull = slopes.transpose(0, 2, 1) @ weight @ (by_place * off[:, None])
        together[seen] += pull
        alone += np.einsum("mpi,mqi->pq", pull, pull)
    return np.asarray(cov @ (np.einsum("mpi,mqi->pq", together, together) - alone) @ cov)


def _more_open(best: Solution, without: Solution) -> Array:
    """(P, P) what the covariance of a solution with less pairs has more, along the unknowns where it has more."""
    root = np.linalg.cholesky(best.unit_cov)
    own = np.linalg.solve(root, np.linalg.solve(root, without.unit_cov).T)
    value, vector = np.linalg.eigh(0.5 * (own + own.T))
    along = (root @ vector) * np.sqrt(np.maximum(value - 1.0, 0.0))
    return np.asarray(along @ along.T)


def curvature(best: Solution) -> Array:
    """(P, P) what the second order of the projections adds to the covariance of the unknowns.

    The minimum moves along a curve, x = L t + K(t, t) / 2 with K_ij = -C J'W D_ij for unit normal t: C = LL' is the
    covariance, J and D are the first and second derivatives of the projections (Bates and Watts 1988, section 7.1,
    parameter effects; Box 1971). The covariance of the second term is half the sum of all K_ij K_ij'. It is some 1 % of
    C for markers that fix their pose well. Of the pose alone, by its covariance with the other unknowns as they are.
    """
    return np.asarray(curve_kernel(best.views.sights, best.state, best.unit_cov))


def _way(best: Solution, beside: Solution) -> Array:
    """(P,) from the unknowns of a solution to those of a rigid one with another camera."""
    own = beside.state.nuisance[:, : best.state.nuisance.shape[1]] - best.state.nuisance
    return np.concatenate([_turned(best, beside), own.ravel(), -best.state.bent])


def away(best: Solution, other: Solution) -> Array:
    """(P,) from the unknowns of a solution to those of another of the same views and modes."""
    own, bent = other.state.nuisance - best.state.nuisance, other.state.bent - best.state.bent
    return np.concatenate([_turned(best, other), own.ravel(), bent])


def _turned(best: Solution, other: Solution) -> Array:
    """(6,) from the pose of the unit model of a solution to that of another."""
    log = (other.rig_from_model @ best.rig_from_model.inverse()).log()
    return np.asarray(np.linalg.solve(best.to_model(), log))


def _of_root(best: Solution, bends: float) -> tuple[Solution, Array]:
    """The solution with the root's pose, if it is bent, and the covariance (P, P) of its unknowns."""
    if not (best.is_bent or best.excess_px.any() or bends > 0.0):
        return best, best.unit_cov.copy()
    best = likeliest(best) if best.is_bent else best
    root = root_of(best, bends)
    off, cov = root.shift.copy(), best.unit_cov.copy()
    if best.is_bent:
        best, off[:6], cov = _moved(best, root.shift[:6]), 0.0, np.pad(cov, (0, 1))
    cov[: len(off), : len(off)] = root.cov + np.outer(off, off)
    return best, cov


def _moved(best: Solution, shift: Array) -> Solution:
    """The same places of a bent model's markers, described from another pose; one more mode makes up for it."""
    rotation, translation = best.state.rotation.copy(), best.state.translation.copy()
    _move(rotation, translation, np.ascontiguousarray(shift))
    flat = best.views.sights.xyz
    places = (flat + best.displacement) @ best.state.rotation.T + best.state.translation
    more = (places - translation) @ rotation - flat - best.displacement
    views = best.views.bent(np.concatenate([best.views.modes, more[None]]))
    state, size = copied(views, best.state), len(best.state.factor)
    state.rotation[:], state.translation[:] = rotation, translation
    state.bent[:] = np.append(best.state.bent, 1.0)
    state.factor[:size, :size], state.factor[size, size] = best.state.factor, 1.0
    place_cameras(views.sights, state)
    return Solution(views, state)


def _eccentricity(best: Solution, c: int, discs: NDArray[np.bool_]) -> Array:
    """(N, 2) of the matched markers, 0 where they are no discs or a part of the outline has no image."""
    off = np.zeros((len(discs), 2))
    marker = np.flatnonzero(discs & (best.state.match[c] >= 0))
    markers, pose = best.views.planes[c].task.markers.take(marker), best.cam_from_model(c)
    seen = imaged_ellipse(
        best.camera(c), pose.apply(markers.xyz), pose.rotate(markers.normal), markers.radius,
        pose.rotate_form(markers.curvature),
    )  # fmt: skip
    off[marker] = np.nan_to_num(seen.eccentricity_px)
    return off
