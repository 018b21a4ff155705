"""What one view sees of the points, and how that changes with all that is free. Private to the deformation."""

from __future__ import annotations

from typing import Any

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
