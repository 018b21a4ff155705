"""Least squares of the template on one patch of an image. Private; the model is in `_kernels_template_model`.

The fit's own coordinates u are what a blurred disc shows: centre, second moments S = L L / 4 + blur^2 (u[2:5]),
blur^2 (u[5]),
volume = depth * det L (u[6]), background, slope. In them the long curved valley that small discs leave between size,
blur
and depth is straight, and the damping of Levenberg and Marquardt acts along it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection._kernels_template_model import evaluate, points_needed
from windmark.geometry._jit import nb

BLUR_MIN = 0.25  # px; below it only the pixel's box is seen
AXIS_MIN = 0.5  # px
MAX_EVALUATIONS = 60
TOLERANCE = 3e-3  # chi^2 of the last step: 5 % of a standard deviation, and Gauss-Newton squares what is left
STILL = 1e-4  # the same, where the step is taken without another evaluation
STILL_KNOWN = 0.05  # of a known shape: its steps shrink to a few per cent of the one before, so 1 % of a sigma is left
SAME_CHI2 = 2e-3  # increase of chi^2 let pass: the derivatives are not exact in the square of the light's slope
JUMP = 1e-3  # increase of chi^2 per depth / noise let pass where the number of points on the ellipse has changed
NOISE_PER_CUT = 1.0 / 4.685**2  # cut = 1 / (4.685 noise)^2: Tukey's weights with 95 % efficiency
MODEL_ERROR = 2e-5  # of the depth; no fit is better than the model
FITS = ("cost", "noise2", "evaluations", "status", "pixels", "largest", "signal", "rejected")  # columns of `fit_discs`


@nb.njit(cache=True, nogil=True, error_model="numpy")
def factor(matrix: Any, damping: float, held: Any, work: Any) -> bool:
    """Cholesky factor of matrix + damping diag(matrix) without the held unknowns; False where singular."""
    n = held.size
    for i in range(n):
        for j in range(i + 1):
            s = 0.0 if held[i] or held[j] else matrix[i, j]
            if i == j:
                s = 1.0 if held[i] else s * (1.0 + damping)
            limit = 1e-13 * s
            for k in range(j):
                s -= work[i, k] * work[j, k]
            if i == j:
                if not s > limit:
                    return False
                work[i, i] = math.sqrt(s)
            else:
                work[i, j] = s / work[j, j]
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def substitute(work: Any, rhs: Any, held: Any, step: Any) -> None:
    """Solve with the factor; 0 for the held unknowns."""
    n = rhs.size
    for i in range(n):
        s = 0.0 if held[i] else rhs[i]
        for k in range(i):
            s -= work[i, k] * step[k]
        step[i] = s / work[i, i]
    for i in range(n - 1, -1, -1):
        s = step[i]
        for k in range(i + 1, n):
            s -= work[k, i] * step[k]
        step[i] = s / work[i, i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def solve(matrix: Any, rhs: Any, damping: float, held: Any, work: Any, step: Any) -> bool:
    """Solve (matrix + damping diag(matrix)) step = rhs without the held unknowns, by Cholesky; False where singular."""
    if not factor(matrix, damping, held, work):
        return False
    substitute(work, rhs, held, step)
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def shape_of(u: Any, p: Any, t: Any) -> None:
    """Model parameters p of a state u, and t = d(p[2:7]) / d(u[2:7]).

    The fit's own coordinates are what a blurred disc shows: second moments S = L L / 4 + blur^2, blur^2 and volume.
    In them
    the long curved valley that small discs leave between size, blur and depth is straight.
    """
    for k in range(10):
        p[k] = u[k]
    sigma = math.sqrt(u[5])
    a, b, d = 4.0 * (u[2] - u[5]), 4.0 * u[3], 4.0 * (u[4] - u[5])
    area = math.sqrt(a * d - b * b)
    trace = math.sqrt(a + d + 2.0 * area)
    p[2], p[3], p[4], p[5], p[6] = (a + area) / trace, b / trace, (d + area) / trace, sigma, u[6] / area
    for k in range(5):  # by S_xx, S_xy, S_yy, blur^2, volume
        all4 = -4.0 if k == 3 else 0.0
        da, db, dd = 4.0 if k == 0 else all4, 4.0 if k == 1 else 0.0, 4.0 if k == 2 else all4
        darea = 0.5 * (d * da + a * dd - 2.0 * b * db) / area
        dtrace = 0.5 * (da + dd + 2.0 * darea) / trace
        t[0, k] = (da + darea - p[2] * dtrace) / trace
        t[1, k] = (db - p[3] * dtrace) / trace
        t[2, k] = (dd + darea - p[4] * dtrace) / trace
        t[3, k] = 0.5 / sigma if k == 3 else 0.0
        t[4, k] = (1.0 if k == 4 else -p[6] * darea) / area


@nb.njit(cache=True, nogil=True, error_model="numpy")
def congruence(matrix: Any, t: Any, row: Any) -> None:
    """Matrix = t^T matrix t in place, where t (5, 5) stands for the unknowns 2 ... 6."""
    for i in range(10):
        for k in range(5):
            row[k] = 0.0
            for m in range(5):
                row[k] += matrix[i, 2 + m] * t[m, k]
        for k in range(5):
            matrix[i, 2 + k] = row[k]
    for i in range(10):
        for k in range(5):
            row[k] = 0.0
            for m in range(5):
                row[k] += t[m, k] * matrix[2 + m, i]
        for k in range(5):
            matrix[2 + k, i] = row[k]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def normal_equations(jac: Any, res: Any, shape: bool, t: Any, matrix: Any, rhs: Any, row: Any) -> None:
    """J^T J and J^T r of the state, from the derivatives by the model parameters and t of `shape_of`."""
    rows, r = jac.reshape((10, res.size)), res.reshape(res.size)
    for a in range(10):
        for b in range(a, 11):
            total = 0.0
            if not shape and (2 <= a < 6 or 2 <= b < 6):
                matrix[a, b] = 0.0
                matrix[b, a] = 0.0
            elif b < 10:
                for k in range(r.size):
                    total += rows[a, k] * rows[b, k]
                matrix[a, b] = total
                matrix[b, a] = total
            else:
                for k in range(r.size):
                    total += rows[a, k] * r[k]
                rhs[a] = total
    congruence(matrix, t, row)
    for k in range(5):
        row[k] = 0.0
        for m in range(5):
            row[k] += t[m, k] * rhs[2 + m]
    for k in range(5):
        rhs[2 + k] = row[k]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def advance(u: Any, step: Any, trial: Any) -> float:
    """Trial = u + f step inside the bounds; returns f <= 1, which keeps the start of a fit from running away."""
    mean, gap = 0.5 * (u[2] + u[4]), math.sqrt(0.25 * (u[2] - u[4]) ** 2 + u[3] * u[3])
    share = math.sqrt((step[0] ** 2 + step[1] ** 2) / (mean - gap))
    share = max(share, 1.5 * math.sqrt(0.5 * (step[2] ** 2 + step[4] ** 2) + step[3] ** 2) / (mean - gap))
    f = 1.0 / max(share, 0.8 * abs(step[5]) / u[5], 1.0)
    for k in range(u.size):
        trial[k] = u[k] + f * step[k]
    mean, gap = 0.5 * (trial[2] + trial[4]), math.sqrt(0.25 * (trial[2] - trial[4]) ** 2 + trial[3] * trial[3])
    trial[5] = max(min(trial[5], mean - gap - 0.25 * AXIS_MIN * AXIS_MIN), BLUR_MIN * BLUR_MIN)
    least = trial[5] + 0.25 * AXIS_MIN * AXIS_MIN
    if mean - gap < least:  # raise the smaller second moment alone
        large, small = max(mean + gap, least), least
        g = (large - small) / (2.0 * gap) if gap > 0.0 else 0.0
        half = 0.5 * g * (trial[2] - trial[4])
        trial[2], trial[3], trial[4] = 0.5 * (large + small) + half, g * trial[3], 0.5 * (large + small) - half
    return f


@nb.njit(cache=True, nogil=True, error_model="numpy")
def at_bound(u: Any, step: Any, matrix: Any, held: Any) -> bool:
    """Where the step leaves the bounds from a state on them, keep it on them: True if it did."""
    hit = u[5] <= BLUR_MIN * BLUR_MIN and step[5] < 0.0
    if hit:
        held[5] = True
    gap = math.sqrt(0.25 * (u[2] - u[4]) ** 2 + u[3] * u[3])
    if 0.5 * (u[2] + u[4]) - gap - u[5] > 0.25001 * AXIS_MIN * AXIS_MIN or gap == 0.0:
        return hit
    xx, xy = 0.5 - 0.25 * (u[2] - u[4]) / gap, -0.5 * u[3] / gap  # projector on the smaller half axis
    c = (xx, 2.0 * xy, 1.0 - xx, -1.0)
    if c[0] * step[2] + c[1] * step[3] + c[2] * step[4] + c[3] * step[5] >= 0.0:
        return hit
    stiff = 1e4 * (matrix[2, 2] + matrix[4, 4])
    for i in range(4):
        for k in range(4):
            matrix[2 + i, 2 + k] += stiff * c[i] * c[k]
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def quadratic(matrix: Any, a: Any, b: Any) -> float:
    """(a - b)^T matrix (a - b)."""
    total = 0.0
    for i in range(10):
        for k in range(10):
            total += (a[i] - b[i]) * matrix[i, k] * (a[k] - b[k])
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def moments(patch: Any, weight: Any, start: Any, u: Any) -> None:
    """State from the moments of the hole within 1.5 px + blur of the rim, below the plane of what lies outside.

    `start`: x, y, radius, blur. The plane has its slope from the window's halves: first moments over second moments.
    Moments
    that are far from those of such a disc are replaced by them.
    """
    half, x, y, blur = patch.shape[0] // 2, start[0], start[1], start[3]
    rim2 = (start[2] + 1.5 + blur) ** 2
    n = g0 = gx = gy = xx = yy = 0.0
    for j in range(patch.shape[0]):
        for i in range(patch.shape[0]):
            dx, dy = i - half - x, j - half - y
            w = weight[j, i] if dx * dx + dy * dy > rim2 else 0.0
            v = w * patch[j, i]
            n += w
            g0 += v
            gx += v * dx
            gy += v * dy
            xx += w * dx * dx
            yy += w * dy * dy
    b, qx, qy = g0 / max(n, 1.0), gx / max(xx, 1.0), gy / max(yy, 1.0)
    volume = mx = my = sxx = sxy = syy = 0.0
    for j in range(patch.shape[0]):
        for i in range(patch.shape[0]):
            dx, dy = i - half - x, j - half - y
            w = weight[j, i] if dx * dx + dy * dy <= rim2 else 0.0
            hole = w * (b + qx * dx + qy * dy - patch[j, i])
            volume += hole
            mx += hole * dx
            my += hole * dy
            sxx += hole * dx * dx
            sxy += hole * dx * dy
            syy += hole * dy * dy
    usual = 0.25 * start[2] ** 2 + blur * blur
    mx, my = mx / volume, my / volume
    sxx, sxy, syy = sxx / volume - mx * mx - 1.0 / 12.0, sxy / volume - mx * my, syy / volume - my * my - 1.0 / 12.0
    mean, gap = 0.5 * (sxx + syy), math.sqrt(0.25 * (sxx - syy) ** 2 + sxy * sxy)
    good = mx * mx + my * my < 0.25 * start[2] ** 2 and mean + gap < 2.0 * usual
    good = good and mean - gap > max(0.15 * usual, blur * blur + AXIS_MIN * AXIS_MIN)
    u[0], u[1], u[2], u[3], u[4], u[6] = x + mx, y + my, sxx, sxy, syy, volume
    u[5], u[7], u[8], u[9] = blur * blur, b, 0.0, 0.0
    if not good:
        u[0], u[1], u[2], u[3], u[4], u[6] = x, y, usual, 0.0, usual, abs(volume)


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def fit_disc(
    patch: Any, weight: Any, u: Any, prior: Any, stiff: Any, fixed: Any, cut: float, multiplicative: float, n: float,
    jac: Any, res: Any, table: Any, matrix: Any, work: Any, t: Any, vectors: Any, held: Any,
) -> tuple[float, float, int, int]:  # fmt: skip
    """Levenberg-Marquardt from the state `u` (overwritten), with the prior (u - prior)^2 stiff in units of the noise.

    Returns (cost, noise variance, evaluations, status): 1 converged, 0 not, -1 too few pixels or singular. `n`
    degrees of
    freedom. `jac`, `res` are left as of the last evaluation, `matrix` as the normal matrix of u with the prior.
    """
    p, rhs, step, trial, row = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    status, evaluations, points, damping, least, noise2, last = 0, 0, 0, 1e-2, 0.0, 0.0, False
    cost = math.inf
    if fixed[2]:  # nearly linear: damping would only cost an evaluation
        damping = 1e-5
    for k in range(10):
        trial[k] = u[k]
    while status == 0 and evaluations < MAX_EVALUATIONS and damping < 1e8 and n > 0.0:
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
        advance(u, step, trial)
        if not max(abs(trial[0]), abs(trial[1])) < 0.5 * res.shape[0] or trial[2] + trial[4] > res.size:
            status = -1
        moved = quadratic(matrix, trial, u) * (1.0 + damping) ** 2
        last = moved < TOLERANCE * noise2
        if status == 0 and moved < (STILL_KNOWN if fixed[2] else STILL) * noise2:
            status = 1
            for k in range(10):
                u[k] = trial[k]
    return cost, noise2, evaluations, status


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
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
    rows
    for what was held, NaN where the fit failed. `influence` (M, 4, S, S) or empty: what one grey level in a pixel
    does to
    the centre's x and y, the residual, and the model's image; 0 where the pixel has no weight.
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
        out[k, 5] = out[k, 7] = 0.0
        for j in range(size):
            for i in range(size):
                out[k, 5] = max(out[k, 5], abs(res[j, i]))
                out[k, 7] += weight[j, i] > 0.0 and jac[7, j, i] == 0.0
        if influence.shape[1] > 0:
            influences(patch, params[k], multiplicative, jac, res, rows, noise2, influence[k])
        params[k, 0], params[k, 1] = params[k, 0] + centre[0, 0], params[k, 1] + centre[1, 0]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def inverse(matrix: Any, held: Any, scale: float, work: Any, unit: Any, column: Any, out: Any) -> None:
    """Scale / matrix without the held unknowns, whose rows and columns become 0."""
    factor(matrix, 0.0, held, work)
    for m in range(10):
        for i in range(10):
            unit[i] = 1.0 if i == m else 0.0
        substitute(work, unit, held, column)
        for i in range(10):
            out[i, m] = 0.0 if held[m] or held[i] else scale * column[i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def signal(u: Any, matrix: Any, held: Any, work: Any, rhs: Any, step: Any) -> float:
    """Sum of squares that the disc explains and a plane does not."""
    for k in range(10):
        held[k] = k < 7
        rhs[k] = matrix[k, 6]
    if not solve(matrix, rhs, 0.0, held, work, step):
        return math.nan
    total = matrix[6, 6]
    for k in range(7, 10):
        total -= matrix[6, k] * step[k]
    return u[6] * u[6] * total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def center_map(p: Any, multiplicative: float, shift: Any, cov: Any, rows: Any) -> None:
    """From the uncoupled centre c' to the disc's c = c' + (blur^2 + 1/12) slope / light(c').

    `shift` (2, 1) = c - c'; `cov` becomes that of c, ...; `rows` (2, 10) are the derivatives of c times the
    covariance before.
    """
    light = max(1.0 + multiplicative * (p[8] * p[0] + p[9] * p[1]), 0.05)
    reach = multiplicative * (p[5] * p[5] + 1.0 / 12.0) / light
    for i in range(2):
        shift[i, 0] = reach * p[8 + i]
        for k in range(10):
            rows[i, k] = cov[i, k] + multiplicative * 2.0 * p[5] / light * p[8 + i] * cov[5, k] + reach * cov[8 + i, k]
            for m in range(2):
                rows[i, k] -= shift[i, 0] / light * (p[8 + m] * cov[m, k] + p[m] * cov[8 + m, k])
    for i in range(2):
        for k in range(2, 10):
            cov[i, k] = rows[i, k]
            cov[k, i] = rows[i, k]
    for i in range(2):
        for k in range(2):
            total = rows[i, k] + multiplicative * 2.0 * p[5] / light * p[8 + k] * rows[i, 5] + reach * rows[i, 8 + k]
            for m in range(2):
                total -= shift[k, 0] / light * (p[8 + m] * rows[i, m] + p[m] * rows[i, 8 + m])
            cov[i, k] = total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def influences(
    patch: Any, p: Any, multiplicative: float, jac: Any, res: Any, rows: Any, noise2: float, out: Any
) -> None:
    """Influence of each pixel on x and y, residual and model image (4, S, S); `jac`, `res` carry the root of the
    weight.
    """
    half = patch.shape[0] // 2
    for j in range(patch.shape[0]):
        for i in range(patch.shape[0]):
            root = jac[7, j, i] / (1.0 + multiplicative * (p[8] * (i - half) + p[9] * (j - half)))
            for k in range(2):
                total = 0.0
                for m in range(10):
                    total += rows[k, m] * jac[m, j, i]
                out[k, j, i] = root * total / noise2
            out[2, j, i] = res[j, i] / root if root > 0.0 else 0.0
            out[3, j, i] = patch[j, i] - out[2, j, i] if root > 0.0 else 0.0
