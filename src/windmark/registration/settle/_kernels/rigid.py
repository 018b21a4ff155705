"""Normal equations of a rigid model seen by cameras as given, as a numba kernel: `fit` without any other unknown.

Most of all fits are such ones. Seeing a marker, weighing its residual and adding its part is one pass over the pairs,
in which nothing is stored but the sums, which have the same bits as those of the general way.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_with_slopes
from windmark.registration.settle._kernels.state import EXCESS, Sights, State

Array = NDArray[np.float64]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def rigid_equations(sights: Sights, state: State, table: Array, a: Array, g: Array) -> float:
    """J'WJ (lower half) and J'W(seen - projected) of the pose's six unknowns; the cost, NaN where a pair has no image.

    Residuals and ``table`` (C, N, 3), the covariance of the projections by the markers' sigma, on the way.
    """
    a[:] = 0.0
    g[:] = 0.0
    cost, u, v = 0.0, np.empty(6), np.empty(6)
    # Arrays are taken out of their tuples once: that counts references.
    xyz, sigma, spots, noise, rot = sights.xyz, sights.sigma, sights.xy, sights.cov, state.rotation
    for c in range(state.match.shape[0]):
        excess, first, cam = state.numbers[c, EXCESS], sights.first[c], state.camera[c]
        match, residual, own, offset = state.match[c], state.residual[c], table[c], state.offset[c]
        rot_c, shift, turn = state.rotations[c], state.translations[c], np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                turn[i, j] = rot_c[i, 0] * rot[j, 0] + rot_c[i, 1] * rot[j, 1] + rot_c[i, 2] * rot[j, 2]
        for m in range(match.shape[0]):
            if match[m] < 0:
                continue
            x, y, z = xyz[m, 0], xyz[m, 1], xyz[m, 2]
            px = rot_c[0, 0] * x + rot_c[0, 1] * y + rot_c[0, 2] * z + shift[0]
            py = rot_c[1, 0] * x + rot_c[1, 1] * y + rot_c[1, 2] * z + shift[1]
            pz = rot_c[2, 0] * x + rot_c[2, 1] * y + rot_c[2, 2] * z + shift[2]
            seen_u, seen_v, valid, ux, uy, uz, vx, vy, vz = project_with_slopes(cam, px, py, pz)
            if not valid:
                return math.nan
            ax = rot[0, 0] * x + rot[0, 1] * y + rot[0, 2] * z
            ay = rot[1, 0] * x + rot[1, 1] * y + rot[1, 2] * z
            az = rot[2, 0] * x + rot[2, 1] * y + rot[2, 2] * z
            # In the rig's frame; a turn by w moves the point a by w x a.
            wx = ux * turn[0, 0] + uy * turn[1, 0] + uz * turn[2, 0]
            wy = ux * turn[0, 1] + uy * turn[1, 1] + uz * turn[2, 1]
            wz = ux * turn[0, 2] + uy * turn[1, 2] + uz * turn[2, 2]
            u[0], u[1], u[2], u[3], u[4], u[5] = ay * wz - az * wy, az * wx - ax * wz, ax * wy - ay * wx, wx, wy, wz
            sx = vx * turn[0, 0] + vy * turn[1, 0] + vz * turn[2, 0]
            sy = vx * turn[0, 1] + vy * turn[1, 1] + vz * turn[2, 1]
            sz = vx * turn[0, 2] + vy * turn[1, 2] + vz * turn[2, 2]
            v[0], v[1], v[2], v[3], v[4], v[5] = ay * sz - az * sy, az * sx - ax * sz, ax * sy - ay * sx, sx, sy, sz
            uu, uv, vv = 0.0, 0.0, 0.0
            for k in range(3):
                if sigma[m, k] != 0.0:
                    by_u = sigma[m, k] * (wx * rot[0, k] + wy * rot[1, k] + wz * rot[2, k])
                    by_v = sigma[m, k] * (sx * rot[0, k] + sy * rot[1, k] + sz * rot[2, k])
                    uu += by_u * by_u
                    uv += by_u * by_v
                    vv += by_v * by_v
            own[m, 0], own[m, 1], own[m, 2] = uu, uv, vv
            s = first + match[m]
            du, dv = spots[s, 0] - (seen_u + offset[m, 0]), spots[s, 1] - (seen_v + offset[m, 1])
            residual[m, 0], residual[m, 1] = -du, -dv
            xx, xy, yy = noise[s, 0] + uu + excess, noise[s, 1] + uv, noise[s, 2] + vv + excess
            k2 = 1.0 / (xx * yy - xy * xy)
            wuu, wuv, wvv = k2 * yy, -k2 * xy, k2 * xx
            bu, bv = wuu * du + wuv * dv, wuv * du + wvv * dv
            cost += 0.5 * (bu * du + bv * dv)
            for i in range(6):
                g[i] += u[i] * bu + v[i] * bv
                cu, cv = wuu * u[i] + wuv * v[i], wuv * u[i] + wvv * v[i]
                for j in range(i + 1):
                    a[i, j] += cu * u[j] + cv * v[j]
    return cost
