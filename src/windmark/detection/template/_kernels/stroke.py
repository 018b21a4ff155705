"""Disc and stroke, or shadow's edge, on one window by Levenberg and Marquardt. Private; see `template.stroke`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection.template._kernels.algebra import solve
from windmark.detection.template._kernels.model import evaluate, points_needed
from windmark.geometry._jit import nb

COUNT = 14  # unknowns: ten of the disc, direction, place, strength, logarithm of the half width or of the penumbra
PIXEL = 0.29  # px, standard deviation of a pixel's box
LEAST_AXIS, LEAST_BLUR = 0.5, 0.25  # px
EVALUATIONS, HOPE = 25, 8  # at most; after so many it must be near a good fit, or it is given up
TOLERANCE = 1e-2  # chi^2 of the last step
PASSES = 3  # what the blurred product is less than that of blurred images changes with the fit, by a tenth of it
ROOT_2, ROOT_2_PI = math.sqrt(2.0), math.sqrt(2.0 * math.pi)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def stroke(edge: bool, direction: float, place: float, log_width: float, blur: float, out: Any) -> None:
    """A blurred stroke, 1 in its middle if it is wide, and its derivatives by the three unknowns into out (4, S, S).

    `direction` is that of its normal, `place` its distance from the middle of the patch along it, `log_width` the
    logarithm of half its width. `edge`: of a shadow, a half-plane that is 1 where the normal points to; its width is
    the penumbra's as the standard deviation of a Gaussian, by which the edge is wider than the lens makes it.
    """
    size = out.shape[1]
    c, s, width, sigma = math.cos(direction), math.sin(direction), math.exp(log_width), math.hypot(blur, PIXEL)
    if edge:
        sigma = math.hypot(sigma, width)
    half = 0.0 if edge else width
    for j in range(size):
        y = float(j - size // 2)
        for i in range(size):
            x = float(i - size // 2)
            distance = c * x + s * y - place
            high, low = (distance + half) / sigma, (distance - half) / sigma
            g_high = math.exp(-0.5 * high * high) / (ROOT_2_PI * sigma)
            g_low = 0.0 if edge else math.exp(-0.5 * low * low) / (ROOT_2_PI * sigma)
            out[0, j, i] = 0.5 * (math.erfc(-high / ROOT_2) - (0.0 if edge else math.erfc(-low / ROOT_2)))
            out[1, j, i] = (g_high - g_low) * (c * y - s * x)
            out[2, j, i] = g_low - g_high
            out[3, j, i] = -g_high * distance * (width / sigma) ** 2 if edge else (g_high + g_low) * half


@nb.njit(cache=True, nogil=True, error_model="numpy")
def model(
    v: Any, edge: bool, blur: float, scale: float, multiplicative: float, flat: Any, table: Any, line: Any, jac: Any,
    image: Any, late: Any,
) -> None:  # fmt: skip
    """Image (S, S) of disc and stroke, or shadow's `edge`, and its derivatives (14, S, S).

    Where one multiplies the other, the image is the product of the blurred ones. The blurred product is less than that
    by `late` (S, S), to first order the blur's variance times the product of their slopes.

    `flat` (2, S, S) zeros and ones; `table` (8, S + 6), `line` (4, S, S) scratch; others as in `fit_stroke`.
    """
    evaluate(flat[0], flat[1], v, points_needed(v), True, 0.0, multiplicative, table, jac, image)
    stroke(edge, v[10], v[11], v[13], blur, line)
    spread, c, s = multiplicative * (v[5] * v[5] + 1.0 / 12.0), math.cos(v[10]), math.sin(v[10])
    for j in range(image.shape[0]):
        for i in range(image.shape[0]):
            disc, taken = -image[j, i], v[12] * line[0, j, i]
            carrier = disc if multiplicative > 0.0 else scale
            late[j, i] = v[12] * spread * line[2, j, i] * (c * jac[0, j, i] + s * jac[1, j, i])
            for m in range(10):
                jac[m, j, i] *= 1.0 - multiplicative * taken
            jac[10, j, i] = -v[12] * carrier * line[1, j, i]
            jac[11, j, i] = -v[12] * carrier * line[2, j, i]
            jac[12, j, i] = -carrier * line[0, j, i]
            jac[13, j, i] = -v[12] * carrier * line[3, j, i]
            image[j, i] = disc - carrier * taken


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _equations(
    patch: Any, weight: Any, v: Any, known: Any, noise: float, jac: Any, image: Any, matrix: Any, rhs: Any
) -> float:
    """Normal matrix, right side and cost in units of the noise; `known` (2, 3): unknown, its value, its spread."""
    rows, left = jac.reshape((COUNT, image.size)), image.reshape(image.size)
    measured, used = patch.reshape(image.size), weight.reshape(image.size)
    cost = 0.0
    for k in range(left.size):
        left[k] = (measured[k] - left[k]) * used[k] / noise
        cost += left[k] * left[k]
    for a in range(COUNT):
        for k in range(left.size):
            rows[a, k] *= used[k] / noise
        total = 0.0
        for k in range(left.size):
            total += rows[a, k] * left[k]
        rhs[a] = total
        for b in range(a + 1):
            total = 0.0
            for k in range(left.size):
                total += rows[a, k] * rows[b, k]
            matrix[a, b] = total
            matrix[b, a] = total
    for n in range(2):
        k, value, spread = int(known[n, 0]), known[n, 1], known[n, 2]
        matrix[k, k] += 1.0 / (spread * spread)
        rhs[k] += (value - v[k]) / (spread * spread)
        cost += ((value - v[k]) / spread) ** 2
    return cost


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _possible(v: Any, half: int) -> bool:
    """Inside the bounds: an ellipse and a blur that pixels can show, a stroke in the window."""
    middle, gap = 0.5 * (v[2] + v[4]), math.hypot(0.5 * (v[2] - v[4]), v[3])
    return (
        middle - gap > LEAST_AXIS and middle + gap < half and v[5] > LEAST_BLUR
        and max(abs(v[0]), abs(v[1])) < half and abs(v[12]) < 1.0 and abs(v[11]) < 1.5 * half and abs(v[13]) < 2.0
    )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _settled(
    patch: Any, weight: Any, v: Any, edge: bool, known: Any, noise: float, scale: float, multiplicative: float,
    hopeless: float, matrix: Any, space: Any,
) -> float:  # fmt: skip
    """`fit_stroke` of the product of the blurred images; `space` is its scratch."""
    flat, table, jac, line, image, late, free, work, rhs, step, trial, other, other_rhs = space
    size, damping = patch.shape[0], 1e-2
    model(v, edge, known[0, 1], scale, multiplicative, flat, table, line, jac, image, late)
    cost = _equations(patch, weight, v, known, noise, jac, image, matrix, rhs)
    for k in range(EVALUATIONS):
        if (k == HOPE and cost > hopeless) or not solve(matrix, rhs, damping, free, work, step):
            return math.nan
        trial[:] = v + step
        if _possible(trial, size // 2):
            model(trial, edge, known[0, 1], scale, multiplicative, flat, table, line, jac, image, late)
            new = _equations(patch, weight, trial, known, noise, jac, image, other, other_rhs)
            if new <= cost:
                small = 0.0
                for a in range(COUNT):
                    for b in range(COUNT):
                        small += step[a] * matrix[a, b] * step[b]
                v[:], matrix[:], rhs[:] = trial, other, other_rhs
                cost, damping = new, max(0.2 * damping, 1e-7)
                if small < TOLERANCE:
                    return cost
                continue
        damping *= 8.0
        if damping > 1e8:
            break
    return math.nan


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fit_stroke(
    patch: Any, weight: Any, v: Any, edge: bool, known: Any, noise: float, scale: float, multiplicative: float,
    hopeless: float, matrix: Any,
) -> float:  # fmt: skip
    """Fit the unknowns `v` (14,), which are overwritten, and their normal `matrix`; the cost, NaN if not converged.

    Parameters
    ----------
    patch, weight : (S, S)
    edge : a shadow's edge, not a stroke
    known : (2, 3) what is known beforehand: which unknown, its value, its standard deviation; the first is the blur
    noise : standard deviation of a pixel
    scale : grey level of a stroke of strength 1 where paint does not multiply the light
    hopeless : cost above which a fit is given up after `HOPE` steps
    """
    size, cost = patch.shape[0], math.nan
    flat, late, corrected = np.zeros((2, size, size)), np.empty((size, size)), patch.copy()
    flat[1] = 1.0
    space = (
        flat, np.empty((8, size + 6)), np.empty((COUNT, size, size)), np.empty((4, size, size)),
        np.empty((size, size)), late, np.zeros(COUNT, np.bool_), np.empty((COUNT, COUNT)), np.empty(COUNT),
        np.empty(COUNT), np.empty(COUNT), np.empty((COUNT, COUNT)), np.empty(COUNT),
    )  # fmt: skip
    for _ in range(PASSES if multiplicative > 0.0 else 1):
        cost = _settled(corrected, weight, v, edge, known, noise, scale, multiplicative, hopeless, matrix, space)
        if math.isnan(cost):
            break
        model(v, edge, known[0, 1], scale, multiplicative, flat, space[1], space[3], space[2], space[4], late)
        for j in range(size):
            for i in range(size):
                corrected[j, i] = patch[j, i] + late[j, i]
    return cost
