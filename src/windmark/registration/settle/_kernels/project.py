"""Markers seen by the cameras, with derivatives by all unknowns, as numba kernels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point, project_with_slopes
from windmark.geometry.lens import BROWN
from windmark.registration._kernels.growth import _move
from windmark.registration.settle._kernels.state import PLACE, SHEAR, WIDE, Mask, Sights, State

Array = NDArray[np.float64]

H = 1e-3
"""Step of the difference quotients by a nuisance, in its sigmas."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def place_cameras(sights: Sights, state: State) -> None:
    """Bring cameras and their poses up to date with the unknowns."""
    r, t = state.rotation, state.translation
    turn, shift = np.empty((3, 3)), np.empty(3)
    for c in range(sights.rotation.shape[0]):
        _place(sights.rotation[c], sights.translation[c], sights.loose[c], state.nuisance[c], turn, shift)
        for i in range(3):
            total = shift[i]
            for k in range(3):
                total += turn[i, k] * t[k]
            state.translations[c, i] = total
            for j in range(3):
                state.rotations[c, i, j] = turn[i, 0] * r[0, j] + turn[i, 1] * r[1, j] + turn[i, 2] * r[2, j]
        open_camera(sights.camera[c], sights.loose[c], state.nuisance[c], state.camera[c])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _place(rotation: Array, translation: Array, loose: Array, nuisance: Array, turn: Array, shift: Array) -> None:
    """A camera's place in the rig moved by its nuisances (P,), into ``turn`` (3, 3) and ``shift`` (3,)."""
    step, own, moved = np.zeros(6), np.eye(3), np.zeros(3)
    for p in range(nuisance.shape[0]):
        for i in range(6):
            step[i] += loose[PLACE + i, p] * nuisance[p]
    _move(own, moved, step)
    for i in range(3):
        shift[i] = moved[i] + own[i, 0] * translation[0] + own[i, 1] * translation[1] + own[i, 2] * translation[2]
        for j in range(3):
            turn[i, j] = own[i, 0] * rotation[0, j] + own[i, 1] * rotation[1, j] + own[i, 2] * rotation[2, j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def open_camera(given: Array, loose: Array, nuisance: Array, out: Array) -> None:
    """A packed camera (17,) moved by nuisances (P,)."""
    out[:] = given
    for p in range(nuisance.shape[0]):
        out[0] *= math.exp(loose[0, p] * nuisance[p])
        for i in range(1, 11):
            out[i] += loose[i, p] * nuisance[p]
        for i in range(3):
            out[12 + i] += loose[WIDE + i, p] * nuisance[p]
        out[16] += loose[SHEAR, p] * nuisance[p]
        if loose[4, p] != 0.0 or loose[5, p] != 0.0 or loose[8, p] != 0.0 or loose[WIDE, p] != 0.0:
            out[11] = math.inf  # another lens ends elsewhere; `project_point` sees where it folds


@nb.njit(cache=True, nogil=True, error_model="numpy")
def room_for(state: State) -> tuple[Array, Array]:
    """Empty ``xy`` (N, 2) and ``by`` (N, 2, P' + 3) for `see`."""
    n = state.match.shape[1]
    return np.empty((n, 2)), np.empty((n, 2, state.factor.shape[0] + 3))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def see(sights: Sights, state: State, c: int, asked: Mask, xy: Array, by: Array) -> None:
    """Where camera c sees the markers that are ``asked`` (N,) for: ``xy`` (N, 2), NaN of others and without an image.

    ``by`` (N, 2, P' + 3) has the derivatives by all unknowns, and behind them by the marker's own place. The rotation
    turns about the model's centre (the origin), so it hardly couples with the translation. All markers in one go: an
    array that a function is given costs more to hand over than half a marker to see.
    """
    xyz, modes, bend, rot, rot_c, shift_c = (
        sights.xyz, sights.modes, state.bent, state.rotation, state.rotations[c], state.translations[c],
    )  # fmt: skip
    cam, loose, offset, turn, other = state.camera[c], sights.loose[c], state.offset[c], np.empty((3, 3)), np.empty(17)
    bends, open_, size = bend.shape[0], loose.shape[1], by.shape[2] - 3
    bent, own = size - bends, 6 + c * open_
    for i in range(3):
        for j in range(3):
            turn[i, j] = rot_c[i, 0] * rot[j, 0] + rot_c[i, 1] * rot[j, 1] + rot_c[i, 2] * rot[j, 2]
    for m in range(xyz.shape[0]):
        xy[m, 0], xy[m, 1] = math.nan, math.nan
        if not asked[m]:
            continue
        x, y, z = xyz[m, 0], xyz[m, 1], xyz[m, 2]
        for k in range(bends):
            x += bend[k] * modes[k, m, 0]
            y += bend[k] * modes[k, m, 1]
            z += bend[k] * modes[k, m, 2]
        px = rot_c[0, 0] * x + rot_c[0, 1] * y + rot_c[0, 2] * z + shift_c[0]
        py = rot_c[1, 0] * x + rot_c[1, 1] * y + rot_c[1, 2] * z + shift_c[1]
        pz = rot_c[2, 0] * x + rot_c[2, 1] * y + rot_c[2, 2] * z + shift_c[2]
        seen_u, seen_v, valid, ux, uy, uz, vx, vy, vz = project_with_slopes(cam, px, py, pz)
        if not valid:
            continue
        xy[m, 0], xy[m, 1] = seen_u + offset[m, 0], seen_v + offset[m, 1]
        ax = rot[0, 0] * x + rot[0, 1] * y + rot[0, 2] * z
        ay = rot[1, 0] * x + rot[1, 1] * y + rot[1, 2] * z
        az = rot[2, 0] * x + rot[2, 1] * y + rot[2, 2] * z
        for q in range(2):
            u = by[m, q]
            if q == 1:
                ux, uy, uz = vx, vy, vz
            # In the rig's frame; a turn by w moves the point a by w x a.
            wx = ux * turn[0, 0] + uy * turn[1, 0] + uz * turn[2, 0]
            wy = ux * turn[0, 1] + uy * turn[1, 1] + uz * turn[2, 1]
            wz = ux * turn[0, 2] + uy * turn[1, 2] + uz * turn[2, 2]
            u[0], u[1], u[2], u[3], u[4], u[5] = ay * wz - az * wy, az * wx - ax * wz, ax * wy - ay * wx, wx, wy, wz
            for i in range(3):
                u[size + i] = wx * rot[0, i] + wy * rot[1, i] + wz * rot[2, i]
            for i in range(6, bent):
                u[i] = 0.0
            if open_ > 0:
                _by_place(loose, px, py, pz, ux, uy, uz, own, u)
            for k in range(bends):
                u[bent + k] = u[size] * modes[k, m, 0] + u[size + 1] * modes[k, m, 1] + u[size + 2] * modes[k, m, 2]
        if open_ > 0:
            _by_nuisances(cam, loose, px, py, pz, own, by[m, 0], by[m, 1], other)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _by_nuisances(
    camera: Array, loose: Array, x: float, y: float, z: float, start: int, u: Array, v: Array, other: Array
) -> None:
    """Derivatives by a camera's nuisances, of a point in its frame that it sees.

    They are added. Those by tilt or shear of the sensor, where it has one, and of a wide lens are difference quotients
    (``other`` is scratch).
    """
    xn, yn = x / z, y / z  # a wide lens, which may see behind, is of the quotients
    s, fx, fy, aspect = xn * xn + yn * yn, camera[0], camera[0] * camera[1], camera[1]
    k1, k2, p1, p2, k3 = camera[4], camera[5], camera[6], camera[7], camera[8]
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    tilted = camera[9] != 0.0 or camera[10] != 0.0 or camera[15] != BROWN or camera[16] != 0.0
    from_u = fx * (xn * radial + 2.0 * p1 * xn * yn + p2 * (s + 2.0 * xn * xn))
    from_v = fy * (yn * radial + p1 * (s + 2.0 * yn * yn) + 2.0 * p2 * xn * yn)
    for p in range(loose.shape[1]):
        if tilted or loose[9, p] != 0.0 or loose[10, p] != 0.0 or loose[SHEAR, p] != 0.0:
            by_u, by_v = _quotients(camera, loose, p, x, y, z, other)
            u[start + p] += by_u
            v[start + p] += by_v
            continue
        radial = s * (loose[4, p] + s * (loose[5, p] + s * loose[8, p]))
        by_p1, by_p2, both = loose[6, p], loose[7, p], 2.0 * xn * yn
        u[start + p] += loose[0, p] * from_u + loose[2, p] + fx * (
            xn * radial + by_p1 * both + by_p2 * (s + 2.0 * xn * xn)
        )  # fmt: skip
        v[start + p] += (loose[0, p] + loose[1, p] / aspect) * from_v + loose[3, p] + fy * (
            yn * radial + by_p1 * (s + 2.0 * yn * yn) + by_p2 * both
        )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _quotients(camera: Array, loose: Array, p: int, x: float, y: float, z: float, other: Array) -> tuple[float, float]:
    """Difference quotients by nuisance p; 0 where the camera that is moved so does not see the point."""
    other[:] = camera
    other[0] *= math.exp(H * loose[0, p])
    for i in range(1, 11):
        other[i] += H * loose[i, p]
    for i in range(3):
        other[12 + i] += H * loose[WIDE + i, p]
    other[16] += H * loose[SHEAR, p]
    u1, v1, good1 = project_point(other, x, y, z)
    other[0] = camera[0] * math.exp(-H * loose[0, p])
    for i in range(1, 11):
        other[i] = camera[i] - H * loose[i, p]
    for i in range(3):
        other[12 + i] = camera[12 + i] - H * loose[WIDE + i, p]
    other[16] = camera[16] - H * loose[SHEAR, p]
    u0, v0, good0 = project_point(other, x, y, z)
    if not (good0 and good1):
        return 0.0, 0.0
    return (u1 - u0) / (2.0 * H), (v1 - v0) / (2.0 * H)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _by_place(
    loose: Array, x: float, y: float, z: float, by_x: float, by_y: float, by_z: float, start: int, out: Array
) -> None:
    """Add the derivative of an image coordinate by a camera's place, from that by the point (x, y, z) it sees."""
    for p in range(loose.shape[1]):
        out[start + p] += (
            loose[PLACE, p] * (y * by_z - z * by_y) + loose[PLACE + 1, p] * (z * by_x - x * by_z)
            + loose[PLACE + 2, p] * (x * by_y - y * by_x) + loose[PLACE + 3, p] * by_x + loose[PLACE + 4, p] * by_y
            + loose[PLACE + 5, p] * by_z
        )  # fmt: skip
