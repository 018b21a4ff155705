"""An accepted explanation as it is reported: excess by the residuals alone, discs' centres, a sigma that covers.

- A disc's image is an ellipse whose centre is not the image of the disc's centre (`geometry.discs`). Where a marker
  has a normal and a radius, the projection is moved by that eccentricity at the pose at hand, and the pose is refined
  again; the eccentricity changes so little with the pose that two rounds are enough.
- Errors of lens, table or shape that are smooth over the image do not average out over the markers as random ones do.
  Where the residuals show such errors, the covariance of the pose has what they do to it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import imaged_ellipse
from windmark.registration.settle._kernels.settle import accept_kernel
from windmark.registration.settle._kernels.smooth import smooth_cov_kernel
from windmark.registration.settle.solution import Solution, accepted, copied

Array = NDArray[np.float64]

DISC_ROUNDS = 2


def answer(best: Solution, beside: Solution | None = None) -> tuple[Solution, Array]:
    """The solution as it is reported, and the covariance (P, P) of all its unknowns.

    Where another camera fits better ``beside``, but it is only slightly another or the model may be bent instead, the
    covariance has the way from the one explanation to the other, and of the pose also that one's own.
    """
    best = accepted(best)
    discs = _are_discs(best)
    for _ in range(DISC_ROUNDS if discs.any() else 0):
        state = copied(best.views, best.state)
        for c in np.flatnonzero(best.counts):
            state.offset[c] = _eccentricity(best, int(c), discs)
        if not accept_kernel(best.views.sights, state):
            break
        best = Solution(best.views, state)
    cov = smooth_cov_kernel(best.views.sights, best.state, best.unit_cov)
    if beside is not None:
        way = _way(best, beside)
        cov += np.outer(way, way)
        cov[:6, :6] += beside.unit_cov[:6, :6]
    return best, cov


def _way(best: Solution, beside: Solution) -> Array:
    """(P,) from the unknowns of a solution to those of a rigid one with another camera."""
    away = (beside.rig_from_model @ best.rig_from_model.inverse()).log()
    own = beside.state.nuisance[:, : best.state.nuisance.shape[1]] - best.state.nuisance
    return np.concatenate([np.linalg.solve(best.to_model(), away), own.ravel(), -best.state.bent])


def _are_discs(best: Solution) -> NDArray[np.bool_]:
    """(N,) markers whose normal and radius are known."""
    markers = best.views.planes[0].task.markers
    return np.isfinite(markers.radius) & np.isfinite(markers.normal).all(axis=1)


def _eccentricity(best: Solution, c: int, discs: NDArray[np.bool_]) -> Array:
    """(N, 2) of the matched markers, 0 where they are no discs or a part of the outline has no image."""
    off = np.zeros((len(discs), 2))
    marker = np.flatnonzero(discs & (best.state.match[c] >= 0))
    markers, pose = best.views.planes[c].task.markers.take(marker), best.cam_from_model(c)
    seen = imaged_ellipse(best.camera(c), pose.apply(markers.xyz), pose.rotate(markers.normal), markers.radius)
    off[marker] = np.nan_to_num(seen.eccentricity_px)
    return off
