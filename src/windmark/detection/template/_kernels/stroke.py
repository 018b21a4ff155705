"""Disc and stroke on one window by Levenberg and Marquardt. Private; the readable model is in `template.stroke`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection.template._kernels.algebra import solve
from windmark.detection.template._kernels.model import evaluate, points_needed
from windmark.geometry._jit import nb

COUNT = 14  # unknowns: ten of the disc, the stroke's direction, place, strength, logarithm of its half width
PIXEL = 0.29  # px, standard deviation of a pixel's box
LEAST_AXIS, LEAST_BLUR = 0.5, 0.25  # px
EVALUATIONS, HOPE = 25, 8  # at most; after so many it must be near a good fit, or it is given up
TOLERANCE = 1e-2  # chi^2 of the last step
ROOT_2, ROOT_2_PI = math.sqrt(2.0), math.sqrt(2.0 * math.pi)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def stroke(direction: float, place: float, log_half_width: float, blur: float, out: Any) -> None:
    """A blurred stroke, 1 in its middle if it is wide, and its derivatives by the three unknowns into out (4, S, S).

    `direction` is that of its normal, `place` its distance from the middle of the patch along it.
    """
    size = out.shape[1]
    c, s, half, sigma = math.cos(direction), math.sin(direction), math.exp(log_half_width), math.hypot(blur, PIXEL)
    for j in range(size):
        y = float(j - size // 2)
        for i in range(size):
            x = float(i - size // 2)
            distance = c * x + s * y - place
            high, low = (distance + half) / sigma, (distance - half) / sigma
            g_high = math.exp(-0.5 * high * high) / (ROOT_2_PI * sigma)
            g_low = math.exp(-0.5 * low * low) / (ROOT_2_PI * sigma)
            out[0, j, i] = 0.5 * (math.erfc(-high / ROOT_2) - math.erfc(-low / ROOT_2))
            out[1, j, i] = (g_high - g_low) * (c * y - s * x)
            out[2, j, i] = g_low - g_high
            out[3, j, i] = (g_high + g_low) * half


@nb.njit(cache=True, nogil=True, error_model="numpy")
def model(
    v: Any, blur: float, scale: float, multiplicative: float, flat: Any, table: Any, line: Any, jac: Any, image: Any
) -> None:
    """Image (S, S) of disc and stroke, and its derivatives (14, S, S).

    `flat` (2, S, S) zeros and ones; `table` (8, S + 6), `line` (4, S, S) scratch; others as in `fit_stroke`.
    """
    evaluate(flat[0], flat[1], v, points_needed(v), True, 0.0, multiplicative, table, jac, image)
    stroke(v[10], v[11], v[13], blur, line)
    for j in range(image.shape[0]):
        for i in range(image.shape[0]):
            disc, taken = -image[j, i], v[12] * line[0, j, i]
            carrier = disc if multiplicative > 0.0 else scale
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
def fit_stroke(
    patch: Any, weight: Any, v: Any, known: Any, noise: float, scale: float, multiplicative: float, hopeless: float,
    matrix: Any,
) -> float:  # fmt: skip
    """Fit the unknowns `v` (14,), which are overwritten, and their normal `matrix`; the cost, NaN if not converged.

    Parameters
    ----------
    patch, weight : (S, S)
    known : (2, 3) what is known beforehand: which unknown, its value, its standard deviation; the first is the blur
    noise : standard deviation of a pixel
    scale : grey level of a stroke of strength 1 where paint does not multiply the light
    hopeless : cost above which a fit is given up after `HOPE` steps
    """
    size = patch.shape[0]
    flat, table, jac = np.zeros((2, size, size)), np.empty((8, size + 6)), np.empty((COUNT, size, size))
    line, image = np.empty((4, size, size)), np.empty((size, size))
    free, work = np.zeros(COUNT, np.bool_), np.empty((COUNT, COUNT))
    rhs, step, trial = np.empty(COUNT), np.empty(COUNT), np.empty(COUNT)
    other, other_rhs, damping = np.empty((COUNT, COUNT)), np.empty(COUNT), 1e-2
    flat[1] = 1.0
    model(v, known[0, 1], scale, multiplicative, flat, table, line, jac, image)
    cost = _equations(patch, weight, v, known, noise, jac, image, matrix, rhs)
    for k in range(EVALUATIONS):
        if (k == HOPE and cost > hopeless) or not solve(matrix, rhs, damping, free, work, step):
            return math.nan
        trial[:] = v + step
        if _possible(trial, size // 2):
            model(trial, known[0, 1], scale, multiplicative, flat, table, line, jac, image)
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
