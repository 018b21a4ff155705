"""Is a lens known though its coefficients are not? Those of a rational lens stand for one another.

Numerator and denominator multiplied by the same polynomial are the same lens. So where the marks would have a simpler
one there is no minimum but a valley, which may lead to infinity, or to a zero of both in the middle of the picture.
Held as they are, some coefficients choose one point of it, and the lens is the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from windmark.calibration.lens_choice import judged
from windmark.calibration.result import Calibration, NotCalibrated
from windmark.geometry import PARAMETERS, Camera

Array = NDArray[np.float64]

RADIAL = ("k1", "k2", "k3", "k4", "k5", "k6")
"""Numerator and denominator of the radial factor: a change of one is nearly undone by one of another."""
RADII = 240
"""Of them one in a pixel or a few: where numerator and denominator nearly vanish, images are open in a narrow ring."""
OPEN = 0.1
"""Of the distance from the centre: 1 sigma above which an image's place is not determined, as for other parameters."""
HELD_FIRST = (("k6",), ("k3", "k6"), ("k3", "k5", "k6"), ("k3", "k4", "k5", "k6"))
"""What of these is held where not all can be found: the highest powers first, Brown's lens of two at last."""


def with_coefficients_told(
    outcome: Calibration | NotCalibrated, cameras: Mapping[str, Camera], free: tuple[str, ...],
    again: Callable[[tuple[str, ...]], Calibration | NotCalibrated], marks: int,
) -> Calibration | NotCalibrated:  # fmt: skip
    """A calibration of rational lenses with as many coefficients as the marks tell apart.

    Parameters
    ----------
    outcome : with all of the ``free`` parameters
    cameras : start values; of these lenses
    again : calibrates with other free parameters
    marks : number of the marks that both are made from
    """
    if not any(c.lens == "rational" for c in cameras.values()):
        return outcome
    for held in HELD_FIRST:
        if not _left_open(outcome):
            break
        fewer = again(tuple(p for p in free if p not in held))
        if isinstance(fewer, Calibration):
            # What explains the marks less well is another lens, not the same one with coefficients that are told.
            outcome = judged({"rational": outcome, "fewer": fewer}, marks)[0].outcome if outcome else fewer
    return outcome


def _left_open(outcome: Calibration | NotCalibrated) -> bool:
    """Whether marks leave coefficients of a rational lens open: no minimum, or no lens as far out as marks are."""
    if isinstance(outcome, NotCalibrated):
        return outcome.cause == "not_converged" or (outcome.cause == "degenerate" and set(outcome.weak) <= set(RADIAL))
    names = np.array([v.camera for v in outcome.views])[outcome.observations.view]
    return any(
        camera.lens == "rational" and not _known_among(camera, outcome.observations.xy[(names == name) & outcome.used])
        for name, camera in outcome.cameras.items()
    )


def _known_among(camera: Camera, xy: Array) -> bool:
    """Whether a camera's picture has rays, and known ones, as far from its principal point as marks (N, 2) are."""
    if camera.cov is None or not len(xy):
        return True
    middle = np.array([camera.cx, camera.cy])
    far = xy[np.linalg.norm(xy - middle, axis=1).argmax()]
    there = np.isfinite(camera.directions(_arm(middle, far))).all()
    return bool(there) and radial_spread(camera, camera.cov, far) < OPEN


def _arm(middle: Array, far: Array) -> Array:
    """(RADII, 2) image points from the principal point to another one."""
    return np.asarray(middle + np.linspace(0.0, 1.0, RADII + 1)[1:, None] * (far - middle))


def radial_spread(camera: Camera, cov: Array, far: Array | None = None) -> float:
    """1 sigma of where the lens' coefficients together put an image, as part of its distance from the centre.

    The largest over the image. To first order: what marks leave open of these coefficients is a bent valley, along
    which the image stays where it is, and a straight step of 1 sigma would leave it.

    Parameters
    ----------
    camera : a lens with radial coefficients
    cov : (15, 15) of its parameters; that of its coefficients alone (`RADIAL`) is used
    far : (2,) image point as far from the principal point as is asked; the farthest corner if None
    """
    index = [PARAMETERS.index(p) for p in RADIAL]
    middle, last = np.array([camera.cx, camera.cy]), np.array(camera.size_px) - 1.0
    xy = _arm(middle, np.where(middle > last / 2, 0.0, last) if far is None else far)
    rays = camera.directions(xy)
    known = np.isfinite(rays).all(axis=1)
    slope = camera.project_jacobian(rays[known])[3][..., index]
    square = np.einsum("rij,jk,rik->r", slope, cov[np.ix_(index, index)], slope)
    away = np.linalg.norm(xy - middle, axis=1)[known]
    return float((np.sqrt(np.maximum(square, 0.0)) / away).max(initial=0.0))
