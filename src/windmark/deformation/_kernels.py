"""What one view sees of the points, how that changes with all that is free, and what it weighs.

Private to the deformation. Readable twins: tests/deformation/test_sighting.py.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from windmark.geometry._cholesky_kernels import cholesky, inverse_factor
from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_with_slopes, to_camera


@nb.njit(cache=True, nogil=True)
def see(
    c: Any, r: Any, t: Any, place: Any, by_model: Any, row: Any, xy: Any, first: int, by_pose: int, by_focal: int,
    residual: Any, jacobian: Any,
) -> bool:  # fmt: skip
    """Fill the rows of one view; False where a point has no image.

    ``c = Camera.packed()``; ``r, t`` the pose cam_from_tunnel; ``place`` (P, 3) and ``by_model`` (P, 3, I) in the
    tunnel; ``row`` (n,), ``xy`` (n, 2) what is observed. Into ``residual`` (P, 2 V) and ``jacobian`` (P, 2 V, F):
    columns ``first``, ``first + 1``; the derivatives by the pose and by the focal length begin where `by_pose` and
    `by_focal` say, not at all where these are negative.
    """
    inner = by_model.shape[2]
    for k in range(len(row)):
        n = row[k]
        x, y, z = to_camera(r, t, place[n, 0], place[n, 1], place[n, 2])
        px, py, seen, ux, uy, uz, vx, vy, vz = project_with_slopes(c, x, y, z)
        if not seen:
            return False
        residual[n, first], residual[n, first + 1] = px - xy[k, 0], py - xy[k, 1]
        u, v = jacobian[n, first], jacobian[n, first + 1]
        for i in range(inner):
            u[i] = v[i] = 0.0
        for m in range(3):
            a = ux * r[0, m] + uy * r[1, m] + uz * r[2, m]
            b = vx * r[0, m] + vy * r[1, m] + vz * r[2, m]
            for i in range(inner):
                u[i] += a * by_model[n, m, i]
                v[i] += b * by_model[n, m, i]
        if by_pose >= 0:
            u[by_pose], u[by_pose + 1], u[by_pose + 2] = uz * y - uy * z, ux * z - uz * x, uy * x - ux * y
            v[by_pose], v[by_pose + 1], v[by_pose + 2] = vz * y - vy * z, vx * z - vz * x, vy * x - vx * y
            u[by_pose + 3], u[by_pose + 4], u[by_pose + 5] = ux, uy, uz
            v[by_pose + 3], v[by_pose + 4], v[by_pose + 5] = vx, vy, vz
        if by_focal >= 0:
            u[by_focal], v[by_focal] = (px - c[2]) / c[0], (py - c[3]) / c[0]
    return True


@nb.njit(cache=True, nogil=True)
def whiten(cov: Any, seen: Any, by_place: Any, place_cov: Any, out: Any) -> bool:
    """Fill ``out`` (P, 2 V, 2 V) with the inverse Cholesky factors of ``cov + by_place place_cov by_place^T``.

    ``cov`` (P, V, 2, 2), ``seen`` (P, V), ``by_place`` (P, 2 V, 3), ``place_cov`` (P, 3, 3). Rows and columns of views
    that do not see a point are zero. False where a covariance is not positive definite.
    """
    size = out.shape[1]
    a, half = np.zeros((size, size)), np.zeros((size, 3))
    out[:] = 0.0
    for k in range(out.shape[0]):
        for i in range(size):
            for m in range(3):
                half[i, m] = 0.0
                for q in range(3):
                    half[i, m] += by_place[k, i, q] * place_cov[k, q, m]
        for i in range(size):
            for j in range(i + 1):
                v, w = i // 2, j // 2
                if not (seen[k, v] and seen[k, w]):
                    a[i, j] = 1.0 if i == j else 0.0
                    continue
                a[i, j] = cov[k, v, i % 2, j % 2] if v == w else 0.0
                for m in range(3):
                    a[i, j] += half[i, m] * by_place[k, j, m]
        if not cholesky(a, size, 0.0):
            return False
        out[k] = inverse_factor(a, size)
        for i in range(size):
            if not seen[k, i // 2]:
                out[k, i, i] = 0.0
    return True


@nb.njit(cache=True, nogil=True)
def test_values(
    whitener: Any, residual: Any, jacobian: Any, cov: Any, point: Any, view: Any, least: float, out: Any
) -> None:
    """Fill ``out`` (n,) with Baarda's test values of the observations of ``point`` in ``view`` (n,).

    ``whitener`` (P, 2 V, 2 V), ``residual`` (P, 2 V), ``jacobian`` (P, 2 V, F), ``cov`` (F, F). 0 where the determinant
    of an observation's spread is no larger than ``least`` times that of its weight: the others do not check it.
    """
    size, free = residual.shape[1], cov.shape[0]
    weight, own, by_cov = np.empty((2, size)), np.empty((2, free)), np.empty((2, free))
    for k in range(len(point)):
        n, first = point[k], 2 * view[k]
        e = np.zeros(2)
        for a in range(2):
            for j in range(size):
                weight[a, j] = 0.0
                for m in range(size):
                    weight[a, j] += whitener[n, m, first + a] * whitener[n, m, j]
                e[a] += weight[a, j] * residual[n, j]
            for f in range(free):
                own[a, f] = 0.0
                for j in range(size):
                    own[a, f] += weight[a, j] * jacobian[n, j, f]
        xx, xy, yy = weight[0, first], weight[0, first + 1], weight[1, first + 1]
        limit = least * (xx * yy - xy * xy)
        for f in range(free):
            for a in range(2):
                by_cov[a, f] = 0.0
                for g in range(free):
                    by_cov[a, f] += own[a, g] * cov[g, f]
            xx, xy, yy = xx - by_cov[0, f] * own[0, f], xy - by_cov[0, f] * own[1, f], yy - by_cov[1, f] * own[1, f]
        det = xx * yy - xy * xy
        square = yy * e[0] * e[0] - 2.0 * xy * e[0] * e[1] + xx * e[1] * e[1]
        out[k] = square / det if det > limit else 0.0
