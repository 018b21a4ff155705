"""The covariance of a corrected camera: what is not known of a lens is still in the pictures that it was undone in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera
from windmark.geometry.camera import LENS_PARAMETERS, PARAMETERS

Array = NDArray[np.float64]

_SIDE = 25
"""Places along each side of the corrected picture at which the two cameras are held beside each other."""
_FITTED = [PARAMETERS.index(name) for name in LENS_PARAMETERS["brown"] if not name.startswith("tilt")]
"""Tilts do what the principal point and p1, p2 do, to first order."""
_SAME = 1e-8
"""Of the largest singular value of columns of one length: directions that do nothing in this picture."""


def corrected_cov(camera: Camera, target: Camera) -> Array | None:
    """The covariance (15, 15) of a camera in whose pictures the lens of another one was undone; None where it has none.

    A direction n is imaged at L(n, theta + d), is taken for L^-1(L(n, theta + d), theta), and drawn there by the
    target T: to first order dT/dn (dL/dn)^-1 dL/dtheta d away from its place. These displacements, all over the
    corrected picture, are those of some d' of the target's own parameters, dT/dphi d': by least squares d' = M d, and
    the covariance is M cov M^T. So it has a variance for a distortion that the target has not. What is minimised are
    pixels of the picture that was taken, dL/dn (dT/dn)^-1 dT/dphi d' - dL/dtheta d, where spots are as certain
    everywhere: towards the radius at which a lens turns back dL/dn has no inverse, and a corrected picture says little.

    Parameters
    ----------
    camera : with its lens and covariance
    target : without distortion, or with another one, seen from the same place in the same direction
    """
    if camera.cov is None:
        return None
    width, height = target.size_px
    x, y = np.meshgrid(np.linspace(-0.5, width - 0.5, _SIDE), np.linspace(-0.5, height - 0.5, _SIDE))
    rays = target.unproject(np.stack([x, y], axis=-1).reshape(-1, 2))
    rays = rays[np.isfinite(rays).all(axis=1)]
    seen, valid = camera.project(rays)
    rays = rays[valid & camera.in_image(seen)]
    if len(rays) < len(_FITTED):  # next to nothing of it is shown
        return None
    _, _, by_ray, by_own = camera.project_jacobian(rays)
    _, _, target_by_ray, by_target = target.project_jacobian(rays)
    by_fitted = by_ray[..., :2] @ np.linalg.solve(target_by_ray[..., :2], by_target[..., _FITTED])
    columns, moved = by_fitted.reshape(-1, len(_FITTED)), by_own.reshape(-1, len(PARAMETERS))
    size = np.linalg.norm(columns, axis=0)
    onto = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    onto[_FITTED] = np.linalg.lstsq(columns / size, moved, rcond=_SAME)[0] / size[:, None]
    cov = onto @ camera.cov @ onto.T
    return np.asarray(0.5 * (cov + cov.T))
