"""Centres weighed by the frame's noise: one step of generalised least squares from a fit by ordinary least squares.

Least squares is unbiased whatever the noise, but where its neighbours' noise is alike, or its level makes it noisier, a
pixel counts for less than it is given: on coarse paint the centres are off by up to three times what is possible. With
C the covariance of the window's pixels and J the model's derivatives at the fit, the estimate moves by
(J^T C^-1 J)^-1 J^T C^-1 r, r the residuals (Aitken, Proc. Royal Soc. Edinburgh 55, 1935); one step is enough, as the
model bends little over a few sigmas.

Weights trust the model more than least squares does: they take from what the pixels have in common. Where the model is
wrong (a rim that is no Gaussian's, pixels that see less than their square) that shows, as both estimates then differ by
more than the noise can make them (Hausman, Econometrica 46, 1978): the frame is left to least squares.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.fit import Fitted, linearised, windows
from windmark.detection.template.noise import FrameNoise
from windmark.detection.template.request import Neighbours, Request, Scene

Array = NDArray[np.float64]

MOST_PIXELS = 500  # of a window, discs of radius 6: the work grows with the third power, 1 ms at 150, 11 ms at 450
DIFFER = 2.0  # times what is expected of the two estimates' difference, chi^2, by the median of the markers
EXPECTED_MEDIAN = 2.0 * np.log(2.0)  # of chi^2 with two degrees of freedom
ALONE = 27.6  # chi^2 of a marker's difference that chance reaches once in a million


def weighed(
    scene: Scene, request: Request, done: Fitted, others: Neighbours, noise: FrameNoise, cov: Array
) -> tuple[Array, Array]:
    """By how much weights move the centres (K, 2), and their covariances (K, 2, 2) in the frame's noise.

    Both as they were, 0 and `cov`, where weights are not believed: of the whole frame where estimates differ by more
    than the noise makes them, of a marker that alone does so or whose window has more than 500 pixels.

    Parameters
    ----------
    done : converged fits by least squares, shape and blur among the unknowns
    cov : (K, 2, 2) covariances of their centres in the frame's noise
    """
    moved, best = np.zeros((len(cov), 2)), np.full_like(cov, np.nan)
    variance, sizes = done.column("noise2"), np.ceil(request.reach() + 0.5).astype(np.int64)
    for half in np.unique(sizes):
        index = np.flatnonzero(sizes == half)
        one = request.take(index)
        _, _, patches, weights = windows(scene, one, others.take(index), int(half))
        images = np.zeros((len(index), 4, *patches.shape[1:]))
        for k, m in enumerate(index):
            if len(done.params[m]) < np.count_nonzero(weights[k]) <= MOST_PIXELS and variance[m] > 0.0:
                prior = float(request.blur[m]), float(request.blur_spread[m])
                moved[m] = _step(scene, patches[k], weights[k], done.params[m], prior, noise, variance[m], images[k])
        best[index] = noise.covariance(images, variance[index])
    with np.errstate(invalid="ignore"):
        spread = np.linalg.det(cov - best) > 0.0
    good = (moved != 0.0).any(axis=1) & np.isfinite(best).all(axis=(1, 2)) & spread & (best[:, 0, 0] < cov[:, 0, 0])
    odd = np.zeros(len(cov))
    odd[good] = np.einsum("ki,kij,kj->k", moved[good], np.linalg.inv((cov - best)[good]), moved[good])
    if not good.any() or np.median(odd[good]) > DIFFER * EXPECTED_MEDIAN:
        return np.zeros_like(moved), cov
    good &= odd < ALONE
    return np.where(good[:, None], moved, 0.0), np.where(good[:, None, None], best, cov)


def _step(
    scene: Scene, patch: Array, weight: Array, params: Array, prior: tuple[float, float], noise: FrameNoise,
    variance: float, out: Array,
) -> Array:  # fmt: skip
    """The step of one centre (2,); `out` (4, S, S) as `Batch.images`, with the influences of the weighed estimate.

    0 where the pixels that neighbours leave do not determine all unknowns.
    """
    from scipy.linalg import cho_factor, cho_solve

    used = weight > 0.0
    out[2], jac = linearised(scene, patch, weight, params)
    out[3] = np.where(used, patch - out[2], 0.0)
    pixels = noise.pixels(out[3], variance)
    unit = np.maximum(np.linalg.norm(jac[:, used], axis=1), 1e-300)
    rows = jac[:, used] / unit[:, None]
    if pixels.ndim == 1:
        inverse = rows.T / pixels[:, None]
    else:
        try:
            inverse = cho_solve(cho_factor(pixels, check_finite=False), rows.T, check_finite=False)
        except np.linalg.LinAlgError:  # noise in proportion to the light leaves black pixels without any
            return np.zeros(2)
    matrix, known = rows @ inverse, (prior[1] * unit[5]) ** -2.0
    matrix[5, 5] += known
    right = np.column_stack([inverse.T, np.eye(10)[5] * known * unit[5]])
    if not np.linalg.eigvalsh(matrix)[0] > 0.0:
        return np.zeros(2)
    gain = (np.linalg.solve(matrix, right) / unit[:, None])[:2]
    out[:2, used] = gain[:, :-1]
    return np.asarray(gain @ np.append(out[2][used], prior[0] - params[5]))
