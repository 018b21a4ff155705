"""Where the centre of a fitted disc goes when a part of its window is left out, without another fit. Private.

The window is divided into eight sectors round the centre. One evaluation of the model gives the normal equations of
each; those of the window without a quarter are the sum of the other six, and one step with them from the finished fit
is the fit without the quarter, but for what is not linear in it. Where the centre moves far further steps follow.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection.template._kernels.algebra import of_state, solve
from windmark.detection.template._kernels.model import evaluate, points_needed
from windmark.detection.template._kernels.state import advance, shape_of
from windmark.geometry._jit import nb

SECTORS = 8
STEPS = 6  # at most
SETTLED = 0.5  # of the centre's variance, square of a step after which none is needed
KNOWN_BLUR = 0.5  # share of what is known of the blur that is known beforehand


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _coupled(u: Any, p: Any, t: Any, multiplicative: float, xy: Any) -> None:
    """Parameters p and t as `shape_of` makes them of a state, and the disc's centre as `center_map` has it."""
    shape_of(u, p, t)
    light = max(1.0 + multiplicative * (p[8] * p[0] + p[9] * p[1]), 0.05)
    reach = multiplicative * (p[5] * p[5] + 1.0 / 12.0) / light
    xy[0], xy[1] = p[0] + reach * p[8], p[1] + reach * p[9]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def sector_of(x: float, y: float) -> int:
    """Which of eight equal sectors a direction lies in, from x towards y."""
    steep = 1 if abs(y) > abs(x) else 0
    if y >= 0.0:
        return steep if x > 0.0 else 3 - steep
    return 4 + steep if x <= 0.0 else 7 - steep


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _by_sector(jac: Any, res: Any, p: Any, xy: Any, multiplicative: float, out: Any) -> None:
    """Normal equations of each sector round xy: out (SECTORS, 21, 10), the matrix of reweighted least squares, J^T r,
    and the matrix of Newton's steps.

    `jac`, `res` as of `compare`, with the weight w = 1 - z of Tukey's psi(r) = r w^2, so that psi' = w (5 w - 4). Where
    that is negative a pixel has no say in the matrix: it must stay positive definite.
    """
    half, row = res.shape[0] // 2, np.empty(11)
    out[:] = 0.0
    for j in range(res.shape[0]):
        for i in range(res.shape[0]):
            if jac[7, j, i] == 0.0:  # no weight
                continue
            w = jac[7, j, i] / (1.0 + multiplicative * (p[8] * (i - half) + p[9] * (j - half)))
            bent = max(5.0 - 4.0 / w, 0.0)
            for m in range(10):
                row[m] = jac[m, j, i]
            part = out[sector_of(i - half - xy[0], j - half - xy[1])]
            for a in range(10):
                one, two = row[a], bent * row[a]
                part[10, a] += one * res[j, i]
                for b in range(10):
                    part[a, b] += one * row[b]
                if w < 1.0:
                    for b in range(10):
                        part[11 + a, b] += two * row[b]
                else:
                    for b in range(10):
                        part[11 + a, b] += one * row[b]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _without(parts: Any, q: int, first: int, matrix: Any, rhs: Any) -> None:
    """The equations without quarter q; `first` row of the matrix in each part."""
    for a in range(10):
        rhs[a] = 0.0
        for b in range(10):
            matrix[a, b] = 0.0
    for s in range(SECTORS):
        if s != q and s != (q + SECTORS - 1) % SECTORS:
            for a in range(10):
                rhs[a] += parts[s, 10, a]
                for b in range(10):
                    matrix[a, b] += parts[s, first + a, b]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _equations(
    patch: Any, weight: Any, p: Any, xy: Any, fixed: Any, cut: float, multiplicative: float, table: Any, jac: Any,
    res: Any, out: Any,
) -> None:  # fmt: skip
    """`_by_sector` of a model with parameters p."""
    evaluate(patch, weight, p, points_needed(p), not fixed[2], cut, multiplicative, table, jac, res)
    for m in range(2, 6 if fixed[2] else 2):
        for j in range(res.shape[0]):
            for i in range(res.shape[0]):
                jac[m, j, i] = 0.0
    _by_sector(jac, res, p, xy, multiplicative, out)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _step(
    parts: Any, q: int, u: Any, noise2: float, prior: Any, stiff: Any, held: Any, matrix: Any,
    work: Any, rhs: Any, row: Any, step: Any, p: Any, t: Any, trial: Any,
) -> bool:  # fmt: skip
    """State `trial` after a step from u without quarter q; False where there is none."""
    shape_of(u, p, t)
    for first in (11, 0):
        _without(parts, q, first, matrix, rhs)
        of_state(matrix, rhs, t, row)
        for a in range(10):
            rhs[a] += noise2 * stiff[a] * (prior[a] - u[a])
            matrix[a, a] += noise2 * stiff[a]
        if solve(matrix, rhs, 0.0, held, work, step):
            advance(u, step, noise2 * stiff[5] > KNOWN_BLUR * matrix[5, 5], trial)
            return True
    return False


@nb.njit(cache=True, nogil=True, error_model="numpy")
def quarter_steps(
    patches: Any, weights: Any, states: Any, noise2: Any, variance: Any, priors: Any, stiff: Any, fixed: Any, cut: Any,
    multiplicative: float, out: Any,
) -> None:  # fmt: skip
    """Movement (K, SECTORS, 2) of the centres of K finished fits without each quarter of the window.

    Quarter k is centred on the direction k pi / 4. NaN where the steps do not settle: only a fit can tell. They are
    Newton's without the pixels at which Tukey's psi falls; where these are too few, of reweighted least squares.

    Parameters
    ----------
    patches, weights : (K, S, S)
    states, priors, stiff : (K, 10), relative to the patches' middles
    noise2, variance : (K,) of a pixel, and of the centre in both directions together; the other parameters as
        `fit.fit_discs` has them
    """
    size = patches.shape[1]
    jac, res, table = np.empty((10, size, size)), np.empty((size, size)), np.empty((8, size + 6))
    first, again = np.empty((SECTORS, 21, 10)), np.empty((SECTORS, 21, 10))
    matrix, work, t, held = np.empty((10, 10)), np.empty((10, 10)), np.empty((5, 5)), fixed.copy()
    p, q_there, rhs, row, step = np.empty(10), np.empty(10), np.empty(10), np.empty(10), np.empty(10)
    u, trial, here, there = np.empty(10), np.empty(10), np.empty(2), np.empty(2)
    for k in range(len(patches)):
        _coupled(states[k], p, t, multiplicative, here)
        _equations(patches[k], weights[k], p, here, fixed, cut[k], multiplicative, table, jac, res, first)
        for q in range(SECTORS):
            out[k, q, 0] = out[k, q, 1] = math.nan
            parts, farther, x, y = first, math.inf, 0.0, 0.0
            for a in range(10):
                u[a] = states[k, a]
            for _ in range(STEPS):
                if not _step(
                    parts, q, u, noise2[k], priors[k], stiff[k], held, matrix, work, rhs, row, step, p, t, trial
                ):
                    break
                _coupled(trial, q_there, work, multiplicative, there)
                far = (there[0] - here[0] - x) ** 2 + (there[1] - here[1] - y) ** 2
                if not far < farther:  # steps that grow lead nowhere
                    break
                x, y, farther = there[0] - here[0], there[1] - here[1], far
                if not far > SETTLED * variance[k]:
                    out[k, q, 0], out[k, q, 1] = x, y
                    break
                _equations(patches[k], weights[k], q_there, here, fixed, cut[k], multiplicative, table, jac, res, again)
                parts = again
                for a in range(10):
                    u[a] = trial[a]
