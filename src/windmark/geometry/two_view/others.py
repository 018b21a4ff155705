"""What the other pairs say of each pair: an error that they would not show is one that the geometry takes in.

Each pair is left out, the geometry of the rest predicts how far it should be from its epipolar line, and with which
sigma. With leverage h (the part of an own error that a fit of all follows) that sigma is the pair's own over the root
of 1 - h, and an error that shows by w sigmas there has moved the fit of all by w sqrt(h / (1 - h)) of its sigmas.
Sources: Baarda, A testing procedure for use in geodetic networks, 1968; Cook and Weisberg, Residuals and Influence in
Regression, 1982, chapter 2. The fits are repeated, not taken from the slopes of the fit of all, which a wrong pair of
large leverage has turned.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.camera import Camera
from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.pose import Pose
from windmark.geometry.two_view.distances import epipolar_distance, sampson_distance
from windmark.geometry.two_view.fundamental_fit import PARAMETERS, fits, spread_of
from windmark.geometry.two_view.pairs import check_cov
from windmark.geometry.two_view.refine import relative_pose_refine

Array = NDArray[np.float64]

LIKELY = 10.83
"""Two minima whose costs differ by less are both possible: chi-square of one degree of freedom, 0.1 %."""


@dataclass(frozen=True)
class ByOthers:
    """What the others say of N pairs.

    Parameters
    ----------
    distance_px : (N,) signed Sampson distance from the geometry of all others; NaN where they give none
    sigma_px : (N,) its 1 sigma: of the pair's own noise, of the geometry of the others, and of how far apart their
        likely minima are; infinite where they give none
    own_px : (N,) 1 sigma of the pair's own noise
    """

    distance_px: Array
    sigma_px: Array
    own_px: Array


def fundamental_by_others(xy_a: ArrayLike, xy_b: ArrayLike, matrix: ArrayLike, *, sigma_px: float = 1.0) -> ByOthers:
    """Without cameras: ``matrix`` is F of all pairs (N, 2), ``sigma_px`` 1 sigma of a coordinate.

    Eight pairs or fewer give infinite sigmas: seven fit a fundamental matrix exactly, and several.
    """
    a, b, start = (np.asarray(x, dtype=float) for x in (xy_a, xy_b, matrix))
    n = len(a)
    distance, size = np.full(n, np.nan), np.full(n, np.inf)
    for k in range(n) if n > PARAMETERS + 1 else ():
        rest = np.delete(np.arange(n), k)
        found = fits(a[rest], b[rest], sigma_px, start)
        if not found:
            continue
        likely = [f for f, cost in found if cost < found[0][1] + LIKELY]
        said = [float(sampson_distance(f, a[k], b[k])) for f in likely]
        cov, slope = spread_of(likely[0], a[rest], b[rest], sigma_px)
        row = slope(lambda f, k=k: sampson_distance(f, a[k], b[k]))  # type: ignore[misc]
        apart = max(abs(abs(d) - abs(said[0])) for d in said)  # the sign of F is free
        distance[k], size[k] = said[0], np.sqrt(sigma_px**2 + row @ cov @ row + apart**2)
    return ByOthers(distance, size, np.full(n, sigma_px))


def pose_by_others(
    xy_a: ArrayLike, xy_b: ArrayLike, camera_a: Camera, camera_b: Camera, b_from_a: Pose, *,
    cov_a: ArrayLike | None = None, cov_b: ArrayLike | None = None, which: Iterable[int] | None = None,
) -> ByOthers:  # fmt: skip
    """With cameras: ``b_from_a`` is the pose of all pairs, covariances as for `epipolar_distance`.

    ``which`` are the pairs that are asked for, in the order of the result; None for all.
    """
    a, b = np.asarray(xy_a, dtype=float), np.asarray(xy_b, dtype=float)
    covs = [check_cov("pose_by_others", c, len(a)) for c in (cov_a, cov_b)]
    asked = list(range(len(a)) if which is None else which)
    said = np.full((3, len(asked)), np.nan)
    said[1:] = np.inf
    for row, k in enumerate(asked):
        rest = np.delete(np.arange(len(a)), k)
        try:
            fit = relative_pose_refine(
                b_from_a, a[rest], b[rest], camera_a, camera_b, cov_a=covs[0][rest], cov_b=covs[1][rest]
            )
        except (DegenerateGeometry, np.linalg.LinAlgError):
            continue
        own, whole = (
            epipolar_distance(a[[k]], b[[k]], camera_a, camera_b, fit.b_from_a, cov_a=covs[0][[k]], cov_b=covs[1][[k]],
                              cov_pose=c) for c in (None, fit.cov)
        )  # fmt: skip
        with np.errstate(invalid="ignore", divide="ignore"):
            said[:, row] = [
                float(own.sampson_px[0]),
                *(float(np.abs(e.sampson_px / e.sigmas)[0]) for e in (whole, own)),
            ]
    said[1:] = np.where(np.isfinite(said[1:]), said[1:], np.inf)
    return ByOthers(*said)
