"""Constant-velocity motion of a pose as numba kernels: prediction, innovation, update.

Private to the registration room; works on the unit model (see `search.layout.Frame`). The state is the pose and its
change per frame, twelve numbers: [rotation vector, translation of the centre, their change per frame]. The velocity
itself walks at random, from frame to frame by ``change`` (rad, and part of the distance), so the uncertainty of a
prediction grows with every frame that is missing. Readable twin: tests/registration/test_track_kernels.py.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import cholesky, inverse_factor, solve_factored, solved
from windmark.geometry._jit import nb
from windmark.registration._kernels.growth import _move

Array = NDArray[np.float64]

MEMORY, RISE = 0.15, 0.3
"""Weight of a new frame in what is known of the motion's changes; more if they grew."""
LEAST_CHANGE, MOST_CHANGE = 0.05, 6.0
"""The adapted changes stay within these factors of the expected ones."""


class Estimate(NamedTuple):
    """Pose and motion of the unit model."""

    rotation: Array  # (3, 3)
    translation: Array  # (3,)
    velocity: Array  # (6,) rotation vector and translation per frame
    cov: Array  # (12, 12) of [rotation, translation, velocity]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def predict_kernel(before: Estimate, change: Array, dt: float) -> Estimate:
    """The estimate after ``dt`` frames, without having looked.

    The velocity changes once per frame: its walk over n frames moves the pose by n (n + 1) (2 n + 1) / 6 of the
    variance of one change, which is also used between whole numbers.
    """
    r, t, out = before.rotation.copy(), before.translation.copy(), before.cov.copy()
    _move(r, t, before.velocity * dt)
    for i in range(6):
        for j in range(12):
            out[i, j] += dt * before.cov[6 + i, j]
    for i in range(12):
        for j in range(6):
            out[i, j] += dt * out[i, 6 + j]
    distance2 = t[0] ** 2 + t[1] ** 2 + t[2] ** 2
    for i in range(6):
        q = change[0] ** 2 if i < 3 else change[1] ** 2 * distance2
        across = 0.5 * dt * (dt + 1.0) * q
        out[i, i] += dt * (dt + 1.0) * (2.0 * dt + 1.0) / 6.0 * q
        out[i, 6 + i] += across
        out[6 + i, i] += across
        out[6 + i, 6 + i] += dt * q
    return Estimate(r, t, before.velocity.copy(), out)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def difference(r: Array, t: Array, r0: Array, t0: Array, out: Array) -> None:
    """[rotation vector, translation] that leads from one pose to another."""
    x, y, z, trace = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        trace += r[0, k] * r0[0, k] + r[1, k] * r0[1, k] + r[2, k] * r0[2, k]
        x += 0.5 * (r[2, k] * r0[1, k] - r[1, k] * r0[2, k])
        y += 0.5 * (r[0, k] * r0[2, k] - r[2, k] * r0[0, k])
        z += 0.5 * (r[1, k] * r0[0, k] - r[0, k] * r0[1, k])
        out[3 + k] = t[k] - t0[k]
    sine = math.sqrt(x * x + y * y + z * z)
    angle = math.atan2(sine, 0.5 * (trace - 1.0))
    # At half a turn the axis is not defined by this; any axis is as far away.
    s = angle / sine if sine > 1e-12 else 1.0
    out[0], out[1], out[2] = s * x, s * y, s * z
    if sine <= 1e-12 and trace < 0.0:
        out[0] = math.pi


@nb.njit(cache=True, nogil=True, error_model="numpy")
def invert_factored(factor: Array, out: Array) -> None:
    """The first (6, 6) of the inverse of a matrix (P, P), from its Cholesky factor."""
    size = factor.shape[0]
    root = inverse_factor(factor, size)
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, size):
                total += root[k, i] * root[k, j]
            out[i, j] = out[j, i] = total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def distance2_of(innovation: Array, prior: Array, measured: Array) -> float:
    """Squared Mahalanobis distance of an innovation by the covariances of prediction and measurement."""
    s, g = prior[:6, :6] + measured[:6, :6], innovation[:6].copy()
    if not solved(s, g, 6, 1e-14):
        return math.inf
    total = 0.0
    for i in range(6):
        total += g[i] * innovation[i]
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def update_kernel(predicted: Estimate, innovation: Array, measured: Array) -> Estimate:
    """Prediction and a measured pose together (Kalman); ``measured`` (6, 6) is its covariance."""
    before = predicted.cov
    s, column, gain = before[:6, :6] + measured[:6, :6], np.empty(6), np.empty((12, 6))
    r, t, velocity, out = (
        predicted.rotation.copy(), predicted.translation.copy(), predicted.velocity.copy(), before.copy()
    )  # fmt: skip
    cholesky(s, 6, 1e-14)
    step = np.zeros(12)
    for i in range(12):
        column[:] = before[i, :6]
        solve_factored(s, column, 6)
        gain[i] = column
        for k in range(6):
            step[i] += column[k] * innovation[k]
    _move(r, t, step[:6])
    velocity += step[6:]
    for i in range(12):
        for j in range(i + 1):
            for k in range(6):
                out[i, j] -= gain[i, k] * before[k, j]
            out[j, i] = out[i, j]
    return Estimate(r, t, velocity, out)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def adapted(change: Array, expected: Array, innovation: Array, known: Array, distance2: float, dt: float) -> Array:
    """The motion's changes (2,) as one more frame shows them: what the innovation holds beyond its covariance.

    ``known`` (6,) is the variance that the innovation should have with the changes as they were thought to be.
    """
    new, growth = np.empty(2), dt * (dt + 1.0) * (2.0 * dt + 1.0) / 6.0
    for part in range(2):
        more = 0.0
        for k in range(3 * part, 3 * part + 3):
            more += (innovation[k] ** 2 - known[k]) / 3.0
        more /= growth * (distance2 if part == 1 else 1.0)
        weight = RISE if more > 0.0 else MEMORY
        value = math.sqrt(max(change[part] ** 2 + weight * max(more, -(change[part] ** 2)), 0.0))
        new[part] = min(MOST_CHANGE * expected[part], max(LEAST_CHANGE * expected[part], value))
    return new
