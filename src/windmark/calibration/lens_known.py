"""Is a lens known though its coefficients are not? Those of a rational lens stand for one another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import PARAMETERS, Camera

Array = NDArray[np.float64]

RADIAL = ("k1", "k2", "k3", "k4", "k5", "k6")
"""Numerator and denominator of the radial factor: a change of one is nearly undone by one of another."""
RADII = 24


def radial_spread(camera: Camera, cov: Array) -> float:
    """1 sigma of where the lens' coefficients together put an image, as part of its distance from the centre.

    The largest over the image. To first order: what marks leave open of these coefficients is a bent valley, along
    which the image stays where it is, and a straight step of 1 sigma would leave it.

    Parameters
    ----------
    camera : a lens with radial coefficients
    cov : (15, 15) of its parameters; that of its coefficients alone (`RADIAL`) is used
    """
    index = [PARAMETERS.index(p) for p in RADIAL]
    middle, last = np.array([camera.cx, camera.cy]), np.array(camera.size_px) - 1.0
    arm = np.where(middle > last / 2, -middle, last - middle)  # to the farthest corner
    xy = middle + np.linspace(0.0, 1.0, RADII + 1)[1:, None] * arm
    rays = camera.directions(xy)
    known = np.isfinite(rays).all(axis=1)
    slope = camera.project_jacobian(rays[known])[3][..., index]
    square = np.einsum("rij,jk,rik->r", slope, cov[np.ix_(index, index)], slope)
    away = np.linalg.norm(xy - middle, axis=1)[known]
    return float((np.sqrt(np.maximum(square, 0.0)) / away).max(initial=0.0))
