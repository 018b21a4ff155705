"""Markers seen by the cameras, with derivatives by all unknowns, as numba kernels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point, project_with_slopes
from windmark.registration.settle._kernels.state import Sights, State

Array = NDArray[np.float64]

H = 1e-3
"""Step of the difference quotients by a nuisance, in its sigmas."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def place_cameras(sights: Sights, state: State) -> None:
    """Bring cameras and their poses up to date with the unknowns."""
    r, t = state.rotation, state.translation
    for c in range(sights.rotation.shape[0]):
        for i in range(3):
            total = sights.translation[c, i]
            for k in range(3):
                total += sights.rotation[c, i, k] * t[k]
            state.translations[c, i] = total
            for j in range(3):
                state.rotations[c, i, j] = (
                    sights.rotation[c, i, 0] * r[0, j] + sights.rotation[c, i, 1] * r[1, j]
                    + sights.rotation[c, i, 2] * r[2, j]
                )  # fmt: skip
        open_camera(sights.camera[c], sights.loose[c], state.nuisance[c], state.camera[c])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def open_camera(given: Array, loose: Array, nuisance: Array, out: Array) -> None:
    """A packed camera (12,) moved by nuisances (P,)."""
    out[:] = given
    for p in range(nuisance.shape[0]):
        out[0] *= math.exp(loose[0, p] * nuisance[p])
        for i in range(1, 11):
            out[i] += loose[i, p] * nuisance[p]
        if loose[4, p] != 0.0 or loose[5, p] != 0.0 or loose[8, p] != 0.0:
            out[11] = math.inf  # another lens ends elsewhere; `project_point` sees where it folds


@nb.njit(cache=True, nogil=True, error_model="numpy")
def see(
    sights: Sights, state: State, c: int, m: int, u: Array, v: Array, by_xyz: Array, other: Array
) -> tuple[float, float, bool]:
    """Where camera c sees marker m; its derivatives by all unknowns in ``u`` and ``v`` (P',), by the marker's place
    in ``by_xyz`` (2, 3); ``other`` (12,) is scratch.

    The rotation turns about the model's centre (the origin), so it hardly couples with the translation.
    """  # fmt: skip
    r, q, modes = state.rotation, state.bent, sights.modes
    x, y, z = sights.xyz[m, 0], sights.xyz[m, 1], sights.xyz[m, 2]
    for k in range(q.shape[0]):
        x += q[k] * modes[k, m, 0]
        y += q[k] * modes[k, m, 1]
        z += q[k] * modes[k, m, 2]
    ax = r[0, 0] * x + r[0, 1] * y + r[0, 2] * z
    ay = r[1, 0] * x + r[1, 1] * y + r[1, 2] * z
    az = r[2, 0] * x + r[2, 1] * y + r[2, 2] * z
    rc, tc = state.rotations[c], state.translations[c]
    px = rc[0, 0] * x + rc[0, 1] * y + rc[0, 2] * z + tc[0]
    py = rc[1, 0] * x + rc[1, 1] * y + rc[1, 2] * z + tc[1]
    pz = rc[2, 0] * x + rc[2, 1] * y + rc[2, 2] * z + tc[2]
    seen_u, seen_v, valid, ux, uy, uz, vx, vy, vz = project_with_slopes(state.camera[c], px, py, pz)
    if not valid:
        return seen_u, seen_v, False
    s = sights.rotation[c]
    for row, gx, gy, gz, out in ((0, ux, uy, uz, u), (1, vx, vy, vz, v)):
        # In the rig's frame; a turn by w moves the point a by w x a.
        wx = gx * s[0, 0] + gy * s[1, 0] + gz * s[2, 0]
        wy = gx * s[0, 1] + gy * s[1, 1] + gz * s[2, 1]
        wz = gx * s[0, 2] + gy * s[1, 2] + gz * s[2, 2]
        out[0], out[1], out[2] = ay * wz - az * wy, az * wx - ax * wz, ax * wy - ay * wx
        out[3], out[4], out[5] = wx, wy, wz
        for i in range(3):
            by_xyz[row, i] = wx * r[0, i] + wy * r[1, i] + wz * r[2, i]
    cameras, open_ = state.nuisance.shape
    if open_ > 0:
        u[6 : 6 + cameras * open_] = 0.0
        v[6 : 6 + cameras * open_] = 0.0
        _by_nuisances(state.camera[c], sights.loose[c], px, py, pz, 6 + c * open_, u, v, other)
    start = 6 + cameras * open_
    for k in range(q.shape[0]):
        mx, my, mz = modes[k, m, 0], modes[k, m, 1], modes[k, m, 2]
        u[start + k] = by_xyz[0, 0] * mx + by_xyz[0, 1] * my + by_xyz[0, 2] * mz
        v[start + k] = by_xyz[1, 0] * mx + by_xyz[1, 1] * my + by_xyz[1, 2] * mz
    return seen_u + state.offset[c, m, 0], seen_v + state.offset[c, m, 1], True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _by_nuisances(
    camera: Array, loose: Array, x: float, y: float, z: float, start: int, u: Array, v: Array, other: Array
) -> None:
    """Derivatives by a camera's nuisances, as difference quotients: one rule for every lens parameter."""
    for p in range(loose.shape[1]):
        other[:] = camera
        other[0] *= math.exp(H * loose[0, p])
        for i in range(1, 11):
            other[i] += H * loose[i, p]
        u1, v1, good1 = project_point(other, x, y, z)
        other[0] = camera[0] * math.exp(-H * loose[0, p])
        for i in range(1, 11):
            other[i] = camera[i] - H * loose[i, p]
        u0, v0, good0 = project_point(other, x, y, z)
        good = good0 and good1
        u[start + p] = (u1 - u0) / (2.0 * H) if good else 0.0
        v[start + p] = (v1 - v0) / (2.0 * H) if good else 0.0
