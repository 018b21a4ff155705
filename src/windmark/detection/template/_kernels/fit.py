"""Least squares of the template on patches of an image, by Levenberg and Marquardt. Private.

The model is in `_kernels.model`, the coordinates in which it is fitted in `_kernels.state`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection.template._kernels.algebra import (
    congruence,
    inverse,
    normal_equations,
    of_state,
    quadratic,
    solve,
)
from windmark.detection.template._kernels.bands import ROWS, banded, extremes, forget, used_runs
from windmark.detection.template._kernels.centre import center_map, influences, signal
from windmark.detection.template._kernels.cut import cut_window, leave_out
from windmark.detection.template._kernels.held import held_sums, pixel_table
from windmark.detection.template._kernels.model import CUT, SHAPE, compare, evaluate, points_needed, rim_sums
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
WIDE = 1.25  # reaches of the rim to both sides: discs with larger radii have pixels away from it that are worth it
LARGE = 2.0  # the same, of discs that have one minimum, and are started with their depth
MODEL_ERROR = 2e-5  # of the depth; no fit is better than the model
FITS = ("cost", "noise2", "evaluations", "status", "pixels", "largest", "signal", "rejected")  # columns of `fit_discs`


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fit_disc(
    patch: Any, weight: Any, u: Any, prior: Any, stiff: Any, fixed: Any, cut: float, multiplicative: float, n: float,
    still: float, wide: bool, edges: Any, space: Any,
) -> tuple[float, float, int, int, int]:  # fmt: skip
    """Levenberg-Marquardt from the state `u` (overwritten), with the prior (u - prior)^2 stiff in units of the noise.

    It ends with a step of chi^2 below `still`.

    Returns (cost, noise variance, evaluations, status, points): 1 converged, 0 not, -1 too few pixels or singular. `n`
    degrees of freedom. Of `space`, see `workspace`, the last evaluation's parameters are left, the points on their
    ellipse, and the images: `jac`, `res` as of `compare`, of `wide` discs as of `banded`; the normal matrix is that of
    u with the prior. `edges` of `pixel_table` where the shape is held, with its blur.
    """
    jac, res, table, matrix, work, t, vectors, held, _, _, _, spans, bands, rows, other = space
    p, rhs, step, trial, row, new_rhs = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4], vectors[5]
    status, evaluations, points, damping, least, noise2, last = 0, 0, 0, 1e-2, 0.0, 0.0, False
    moved_before = math.inf
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
        if fixed[2]:
            held_sums(p, points, edges, jac)
            new = compare(patch, weight, p, False, cut, multiplicative, table, jac, res)
        elif not wide:
            new = evaluate(patch, weight, p, points, True, cut, multiplicative, table, jac, res)
        else:
            forget(jac, bands)
            rim_sums(p, points, SHAPE, table, jac, bands)
            new = banded(patch, weight, spans, p, cut, multiplicative, jac, bands, rows, other, new_rhs)
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
            if not wide:
                normal_equations(jac, res, not fixed[2], t, matrix, rhs, row)
            else:
                for a in range(10):
                    rhs[a] = new_rhs[a]
                    for b in range(10):
                        matrix[a, b] = other[a, b]
                of_state(matrix, rhs, t, row)
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
        # Steps shrink at least as they did: what is left after this one is known without another evaluation.
        sure = last and moved * moved < STILL * noise2 * moved_before
        moved_before = moved
        if status == 0 and (sure or moved < (STILL_KNOWN if fixed[2] else still) * noise2):
            status = 1
            for k in range(10):
                u[k] = trial[k]
    return cost, noise2, evaluations, status, points


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
    multiplicative: float, out: Any, params: Any, cov: Any,
) -> None:  # fmt: skip
    """Fit M patches (M, S, S).

    `starts` (M, 4): x, y, radius, blur; `states` (M, 10) overwritten by the result, used as start where states[k, 0] is
    finite. `out` (M, 8): `FITS`. `params` (M, 10) and `cov` (M, 10, 10): model parameters and their covariance, zero
    rows for what was held, NaN where the fit failed.
    """
    size, none = patches.shape[1], np.empty((0, 1, 1))
    space, edges = workspace(size), pixel_table(starts[0, 3] if len(starts) else 1.0)
    for k in range(len(patches)):
        if fixed[2] and k > 0 and starts[k, 3] != starts[k - 1, 3]:
            edges = pixel_table(starts[k, 3])
        fit_window(
            patches[k], weights[k], starts[k], states[k], priors[k], stiff[k], fixed, cut[k], multiplicative, STILL,
            out[k], params[k], cov[k], none, edges, space,
        )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def cut_and_fit(
    image: Any, usable: Any, sign: float, saturation: float, pixel: Any, half: Any, order: Any, starts: Any, reach: Any,
    xy: Any, radii: Any, margin: Any, others: Any, gone: Any, states: Any, priors: Any, stiff: Any, fixed: Any,
    cut: Any, multiplicative: float, still: Any, share: Any, out: Any, params: Any, cov: Any, images: Any,
) -> None:  # fmt: skip
    """`cut_windows` and `fit_discs` in one go: windows of radii `half` (K,) round pixels (K, 2), in an `order` (K,).

    `still` (K,) of `fit_disc`.

    `gone` (K,) of `leave_out`, about the centre to start from. `images`, flat, in the order, or empty: for each marker
    (4, S, S) what one grey level in a pixel does to the centre's x and y, the residual, and the model's image; 0 where
    the pixel has no weight.
    """
    size, at, many, blur = 0, 0, 0, 1.0
    edges = pixel_table(blur)
    for k in order:
        if 2 * half[k] + 1 != size:
            size = 2 * half[k] + 1
            space, patch, weight = workspace(size), np.empty((size, size)), np.empty((size, size))
            kind, many = np.empty((size, size), np.uint8), 4 if images.size > 0 else 0
        if fixed[2] and starts[k, 3] != blur:
            blur = starts[k, 3]
            edges = pixel_table(blur)
        share[k, 0], share[k, 1] = cut_window(
            image, usable, sign, saturation, pixel[k], starts[k], starts[k, 2], starts[k, 3], reach[k], xy, radii,
            margin, others[k], patch, weight, kind,
        )  # fmt: skip
        if gone[k] >= 0:
            leave_out(weight, states[k], gone[k])
        influence = images[at : at + many * size * size].reshape((many, size, size))
        at += influence.size
        fit_window(
            patch, weight, starts[k], states[k], priors[k], stiff[k], fixed, cut[k], multiplicative, still[k],
            out[k], params[k], cov[k], influence, edges, space,
        )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def workspace(size: int) -> Any:
    """Scratch of `fit_window` for patches (S, S); the derivatives by what is held stay zero."""
    return (
        np.zeros((10, size, size)), np.empty((size, size)), np.empty((8, size + 6)), np.empty((10, 10)),
        np.empty((10, 10)), np.empty((5, 5)), np.empty((6, 10)), np.empty(10, np.bool_), np.empty((5, 5)),
        np.empty((2, 10)), np.empty((2, 1)), np.empty((size, 2), np.int64), np.zeros((size, 4), np.int64),
        np.empty((ROWS, size * size)), np.empty((10, 10)),
    )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fit_window(
    patch: Any, weight: Any, start: Any, u: Any, prior: Any, stiff: Any, fixed: Any, cut: float, multiplicative: float,
    still: float, out: Any, p: Any, cov: Any, influence: Any, edges: Any, space: Any,
) -> None:  # fmt: skip
    """One of `fit_discs`; `still` of `fit_disc`, `edges` of `pixel_table` for the blur of `start`."""
    jac, res, table, matrix, work, t, vectors, held, back, rows, centre, spans, bands, _, _ = space
    size, pixels = patch.shape[0], 0.0
    reach = CUT * start[3] + 0.5
    wide = not fixed[2] and start[2] > WIDE * reach
    if wide:
        used_runs(weight, spans)
        jac[:8], bands[:] = 0.0, 0
    for j in range(size):
        for i in range(size):
            pixels += weight[j, i]
    if not math.isfinite(u[0]):
        moments(patch, weight, start, u)
        # The hole's volume is pi times depth times det L. Small discs begin with pi times the depth: their fits end in
        # the better one of two minima more often (PTV cavity: 16 against 11 markers).
        if wide and start[2] > LARGE * reach:
            u[6] /= math.pi
    cost, noise2, evaluations, status, points = fit_disc(
        patch, weight, u, prior, stiff, fixed, cut, multiplicative, pixels - 10.0, still, wide, edges, space
    )
    if wide:
        out[5], out[7] = extremes(patch, weight, spans, vectors[0], cut, multiplicative, jac, bands)
        if influence.shape[0] > 0:
            evaluate(patch, weight, vectors[0], points, True, cut, multiplicative, table, jac, res)
    out[0], out[1], out[2], out[3], out[4] = cost, noise2, evaluations, status, pixels
    shape_of(u, p, t)
    inverse(matrix, held, noise2 if status >= 0 else math.nan, work, vectors[1], vectors[2], cov)
    out[6] = signal(u, matrix, held, work, vectors[1], vectors[2]) if status >= 0 else math.nan
    for i in range(5):
        for m in range(5):
            back[i, m] = t[m, i]
    congruence(cov, back, vectors[4])
    center_map(p, multiplicative, centre, cov, rows)
    if not wide:
        largest, rejected = 0.0, 0
        for j in range(size):
            for i in range(size):
                largest = max(largest, abs(res[j, i]))
                rejected += weight[j, i] > 0.0 and jac[7, j, i] == 0.0
        out[5], out[7] = largest, rejected
    if influence.shape[0] > 0:
        influences(patch, p, multiplicative, jac, res, rows, noise2, influence)
    p[0], p[1] = p[0] + centre[0, 0], p[1] + centre[1, 0]
