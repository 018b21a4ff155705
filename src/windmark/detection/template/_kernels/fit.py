"""Least squares of the template on patches of an image, by Levenberg and Marquardt. Private.

The model is in `_kernels.model`, the coordinates in which it is fitted in `_kernels.state`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection.template._kernels.algebra import congruence, inverse, normal_equations, quadratic, solve
from windmark.detection.template._kernels.centre import center_map, influences, signal
from windmark.detection.template._kernels.model import evaluate, points_needed
from windmark.detection.template._kernels.state import advance, at_bound, moments, shape_of
from windmark.geometry._jit import nb

MAX_EVALUATIONS = 60
TOLERANCE = 3e-3  # chi^2 of the last step: 5 % of a standard deviation, and Gauss-Newton squares what is left
STILL = 1e-4  # the same, where the step is taken without another evaluation
STILL_KNOWN = 0.05  # of a known shape: its steps shrink to a few per cent of the one before, so 1 % of a sigma is left
SAME_CHI2 = 2e-3  # increase of chi^2 let pass: the derivatives are not exact in the square of the light's slope
JUMP = 1e-3  # increase of chi^2 per depth / noise let pass where the number of points on the ellipse has changed
NOISE_PER_CUT = 1.0 / 4.685**2  # cut = 1 / (4.685 noise)^2: Tukey's weights with 95 % efficiency
KNOWN_BLUR = 0.5  # share of what is known of the blur that is known beforehand
MODEL_ERROR = 2e-5  # of the depth; no fit is better than the model
FITS = ("cost", "noise2", "evaluations", "status", "pixels", "largest", "signal", "rejected")  # columns of `fit_discs`


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fit_disc(
    patch: Any, weight: Any, u: Any, prior: Any, stiff: Any, fixed: Any, cut: float, multiplicative: float, n: float,
    jac: Any, res: Any, table: Any, matrix: Any, work: Any, t: Any, vectors: Any, held: Any,
) -> tuple[float, float, int, int]:  # fmt: skip
    """Levenberg-Marquardt from the state `u` (overwritten), with the prior (u - prior)^2 stiff in units of the noise.

    Returns (cost, noise variance, evaluations, status): 1 converged, 0 not, -1 too few pixels or singular. `n`
    degrees of freedom. `jac`, `res` are left as of the last evaluation, `matrix` as the normal matrix of u with the
    prior.
    """
    p, rhs, step, trial, row = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    status, evaluations, points, damping, least, noise2, last = 0, 0, 0, 1e-2, 0.0, 0.0, False
    if not n > 0.0:
        status = -1
    cost = math.inf
    if fixed[2]:  # nearly linear: damping would only cost an evaluation
        damping = 1e-5
    for k in range(10):
        trial[k] = u[k]
    while status == 0 and evaluations < MAX_EVALUATIONS and damping < 1e8:
        evaluations += 1
        shape_of(trial, p, t)
        need, before = points_needed(p), points
        if not need <= points <= 1.3 * need + 8.0:
            points = need + need // 10
        new = evaluate(patch, weight, p, points, not fixed[2], cut, multiplicative, table, jac, res)
        fresh = evaluations == 1
        if not fresh:
            change, predicted = new - cost, quadratic(matrix, trial, u)
            for k in range(10):
                change += noise2 * stiff[k] * ((trial[k] - prior[k]) ** 2 - (u[k] - prior[k]) ** 2)
                predicted -= 2.0 * (trial[k] - u[k]) * rhs[k]
            jump = JUMP * math.sqrt(p[6] * p[6] * noise2) if points != before else 0.0
            fresh = change <= SAME_CHI2 * noise2 + jump
            damping, least = damped(change / predicted if predicted < 0.0 else -1.0, damping, least)
        if fresh:
            cost = new
            noise2 = max(cost / n, (MODEL_ERROR * p[6]) ** 2) if cut == 0.0 else NOISE_PER_CUT / cut
            normal_equations(jac, res, not fixed[2], t, matrix, rhs, row)
            for k in range(10):
                u[k] = trial[k]
                rhs[k] += noise2 * stiff[k] * (prior[k] - u[k])
                matrix[k, k] += noise2 * stiff[k]
                held[k] = fixed[k]
        status = 1 if fresh and last else 0
        again = status == 0
        while again:  # a second time where the first step left the bounds
            if not solve(matrix, rhs, damping, held, work, step):
                status = -1
            again = status == 0 and fresh and at_bound(u, step, matrix, held)
            fresh = False
        advance(u, step, noise2 * stiff[5] > KNOWN_BLUR * matrix[5, 5], trial)
        if not max(abs(trial[0]), abs(trial[1])) < 0.5 * res.shape[0] or trial[2] + trial[4] > res.size:
            status = -1
        moved = quadratic(matrix, trial, u) * (1.0 + damping) ** 2
        last = moved < TOLERANCE * noise2
        if status == 0 and moved < (STILL_KNOWN if fixed[2] else STILL) * noise2:
            status = 1
            for k in range(10):
                u[k] = trial[k]
    return cost, noise2, evaluations, status


@nb.njit(cache=True, nogil=True, error_model="numpy")
def damped(gain: float, damping: float, least: float) -> tuple[float, float]:
    """Next damping from the gain, the decrease of the cost over the predicted one.

    A step that gained little sets a least damping, which later steps may only halve: else a fit in a bent valley would
    swing between two states that are equally good.
    """
    if gain > 0.75:
        return max(damping * (0.1 if gain > 0.9 else 0.3), least, 1e-9), 0.5 * least
    if gain < 0.5:
        damping = max(damping * (3.0 if gain > 0.0 else 8.0), 3e-3)
        return damping, damping
    return damping, least


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fit_discs(
    patches: Any, weights: Any, starts: Any, states: Any, priors: Any, stiff: Any, fixed: Any, cut: Any,
    multiplicative: float, out: Any, params: Any, cov: Any, influence: Any,
) -> None:  # fmt: skip
    """Fit M patches (M, S, S).

    `starts` (M, 4): x, y, radius, blur; `states` (M, 10) overwritten by the result, used as start where states[k, 0] is
    finite. `out` (M, 8): `FITS`. `params` (M, 10) and `cov` (M, 10, 10): model parameters and their covariance, zero
    rows for what was held, NaN where the fit failed. `influence` (M, 4, S, S) or empty: what one grey level in a pixel
    does to the centre's x and y, the residual, and the model's image; 0 where the pixel has no weight.
    """
    size = patches.shape[1]
    jac, res, table, t = np.empty((10, size, size)), np.empty((size, size)), np.empty((8, size + 6)), np.empty((5, 5))
    matrix, work, vectors, held = np.empty((10, 10)), np.empty((10, 10)), np.empty((5, 10)), np.empty(10, np.bool_)
    back, rows, centre = np.empty((5, 5)), np.empty((2, 10)), np.empty((2, 1))
    for k in range(patches.shape[0]):
        patch, weight, u = patches[k], weights[k], states[k]
        pixels = 0.0
        for j in range(size):
            for i in range(size):
                pixels += weight[j, i]
        if not math.isfinite(u[0]):
            moments(patch, weight, starts[k], u)
        cost, noise2, evaluations, status = fit_disc(
            patch, weight, u, priors[k], stiff[k], fixed, cut[k], multiplicative, pixels - 10.0,
            jac, res, table, matrix, work, t, vectors, held,
        )  # fmt: skip
        out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4] = cost, noise2, evaluations, status, pixels
        shape_of(u, params[k], t)
        inverse(matrix, held, noise2 if status >= 0 else math.nan, work, vectors[1], vectors[2], cov[k])
        out[k, 6] = signal(u, matrix, held, work, vectors[1], vectors[2]) if status >= 0 else math.nan
        for i in range(5):
            for m in range(5):
                back[i, m] = t[m, i]
        congruence(cov[k], back, vectors[4])
        center_map(params[k], multiplicative, centre, cov[k], rows)
        largest, rejected = 0.0, 0
        for j in range(size):
            for i in range(size):
                largest = max(largest, abs(res[j, i]))
                rejected += weight[j, i] > 0.0 and jac[7, j, i] == 0.0
        out[k, 5], out[k, 7] = largest, rejected
        if influence.shape[1] > 0:
            influences(patch, params[k], multiplicative, jac, res, rows, noise2, influence[k])
        params[k, 0], params[k, 1] = params[k, 0] + centre[0, 0], params[k, 1] + centre[1, 0]
