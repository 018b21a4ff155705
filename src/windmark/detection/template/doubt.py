"""How far a centre hangs on a part of its window: what the covariance of a contaminated marker must not be below.

Dirt, a scratch or a shadow's edge is no noise: it sits at one place and pulls the centre as a whole, while the
covariance of least squares counts every pixel as one more independent witness. What such a thing does shows when its
place is left out. The marker is fitted again without each of eight overlapping quarters of its window; the scatter of
the centres is the covariance of the delete-a-group jackknife (Shao and Wu, Annals of Statistics 17, 1989), right for
errors that are independent from quarter to quarter whatever they are within. In white noise it is about twice as large
as needed, as a fit without a quarter loses more than a quarter of what the window knows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.fit import Fitted, refit
from windmark.detection.template.request import Neighbours, Request, Scene

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

QUARTERS = 8  # directions of the middles of the quarters
LEFT_TO_GONE = 3.0  # pixels that stay over those left out: the jackknife's factor


def with_doubt(scene: Scene, request: Request, done: Fitted, others: Neighbours, cov: Array) -> Array:
    """Covariances (K, 2, 2) that are, in every direction, the larger of the given ones and the jackknife's.

    A fit that fails without a quarter hangs on it altogether: its centre counts as a radius away, in both directions.

    Parameters
    ----------
    request : the markers as they were fitted, with the noise of the weights
    done : those fits
    cov : (K, 2, 2) covariances of the centres; stays where it is not finite
    """
    scatter = np.zeros_like(cov)
    for turn in 2.0 * np.pi * np.arange(QUARTERS) / QUARTERS:

        def without_quarter(index: Ints, patches: Array, weights: Array, turn: float = turn) -> None:
            x = np.arange(patches.shape[1]) - patches.shape[1] // 2
            centre = done.params[index, :2, None, None]
            along = np.arctan2(x[:, None] - centre[:, 1], x[None, :] - centre[:, 0])
            weights[np.abs(np.remainder(along - turn + np.pi, 2.0 * np.pi) - np.pi) < np.pi / 4.0] = 0.0

        again = refit(scene, request, done, others, without_quarter)
        moved = again.params[:, :2] - done.params[:, :2]
        converged = (again.column("status") == 1) & np.isfinite(moved).all(axis=1)
        moved = np.where(converged[:, None], moved, 0.0)
        scatter += moved[:, :, None] * moved[:, None, :]
        scatter += np.where(converged, 0.0, request.radius**2)[:, None, None] * np.eye(2)
    return larger(cov, scatter * LEFT_TO_GONE / QUARTERS)


def larger(cov: Array, other: Array) -> Array:
    """The covariance (K, 2, 2) that is the larger of both in each of the directions that are common to both.

    With cov = L L^T and L^-1 other L^-T = V diag(e) V^T these are the columns of L V: the result is
    L V diag(max(1, e)) V^T L^T.
    """
    out = cov.copy()
    with np.errstate(invalid="ignore"):
        good = np.isfinite(other).all(axis=(1, 2)) & (cov[:, 0, 0] > 0.0) & (np.linalg.det(cov) > 0.0)
    root = np.linalg.cholesky(cov[good])
    inverse = np.linalg.inv(root)
    size, turn = np.linalg.eigh(inverse @ other[good] @ np.swapaxes(inverse, 1, 2))
    turned = root @ turn
    out[good] = (turned * np.maximum(size, 1.0)[:, None, :]) @ np.swapaxes(turned, 1, 2)
    return out
