"""Images of flat discs: the kernel of `discs.imaged_ellipse`. Private."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point


@nb.njit(cache=True, nogil=True, error_model="numpy")
def image_discs(
    c: Any, center: Any, normal: Any, radius: Any, curvature: Any, derivative: Any, xy: Any, center_xy: Any, axes: Any,
    angle: Any,
) -> None:  # fmt: skip
    """Fill `ImagedEllipse`'s columns for discs (N, 3), (N, 3), (N,), (N, 3, 3) in a camera ``c = Camera.packed()``.

    `derivative` (P, P) of a periodic function by its P samples, times the step.
    """
    count = len(derivative)
    step, x, y = 2.0 * math.pi / count, np.empty(count), np.empty(count)
    for k in range(len(center)):
        px, py, pz, r = center[k, 0], center[k, 1], center[k, 2], radius[k]
        nx, ny, nz = normal[k, 0], normal[k, 1], normal[k, 2]
        size = math.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx / size, ny / size, nz / size
        # A unit vector at right angles to the normal: the x axis laid into the plane, or y; and the one across both.
        ex, ey = (1.0, 0.0) if abs(nx) < 0.9 else (0.0, 1.0)
        along = ex * nx + ey * ny
        ax, ay, az = ex - along * nx, ey - along * ny, -along * nz
        size = r / math.sqrt(ax * ax + ay * ay + az * az)
        ax, ay, az = size * ax, size * ay, size * az
        bx, by, bz = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
        mx = my = 0.0
        aa = ab = bb = 0.0  # the curvature's form of the two
        for i in range(3):
            la = curvature[k, i, 0] * ax + curvature[k, i, 1] * ay + curvature[k, i, 2] * az
            lb = curvature[k, i, 0] * bx + curvature[k, i, 1] * by + curvature[k, i, 2] * bz
            a_i, b_i = (ax, bx) if i == 0 else (ay, by) if i == 1 else (az, bz)
            aa, ab, bb = aa + a_i * la, ab + b_i * la, bb + b_i * lb
        for i in range(count):
            co, si = math.cos(step * i), math.sin(step * i)
            deep = 0.5 * (co * co * aa + 2.0 * co * si * ab + si * si * bb)  # below the tangent plane
            qx, qy, qz = px + co * ax + si * bx, py + co * ay + si * by, pz + co * az + si * bz
            x[i], y[i], _ = project_point(c, qx - deep * nx, qy - deep * ny, qz - deep * nz)
            mx, my = mx + x[i] / count, my + y[i] / count
        area = fx = fy = xx = yy = cross = 0.0
        for i in range(count):
            x[i], y[i] = x[i] - mx, y[i] - my
        for i in range(count):
            dx = dy = 0.0
            for m in range(count):
                dx += derivative[i, m] * x[m]
                dy += derivative[i, m] * y[m]
            u, v = x[i], y[i]
            area += 0.5 * (u * dy - v * dx)
            fx, fy = fx + 0.5 * u * u * dy, fy - 0.5 * v * v * dx
            xx, yy = xx + u * u * u * dy / 3.0, yy - v * v * v * dx / 3.0
            cross += 0.25 * u * v * (u * dy - v * dx)
        fx, fy = fx / area, fy / area
        xx, yy, cross = xx / area - fx * fx, yy / area - fy * fy, cross / area - fx * fy
        # A uniform ellipse has the second moments axis^2 / 4.
        middle, spread = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), cross)
        large, small = middle + spread, middle - spread
        axes[k, 0] = 2.0 * math.sqrt(0.0 if large < 0.0 else large)
        axes[k, 1] = 2.0 * math.sqrt(0.0 if small < 0.0 else small)
        angle[k] = 0.5 * math.atan2(2.0 * cross, xx - yy)
        xy[k, 0], xy[k, 1] = mx + fx, my + fy
        center_xy[k, 0], center_xy[k, 1], _ = project_point(c, px, py, pz)
