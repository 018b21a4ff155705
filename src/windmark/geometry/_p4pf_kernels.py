"""Scan and refinement of `p4pf`: private to windmark."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import solved
from windmark.geometry._jit import nb
from windmark.geometry._p3p_kernels import p3p_kernel

Array = NDArray[np.float64]

_STEPS = 40
_PIVOT = 1e-15
_SAME = 1e-3  # minima that agree to this (focal length, rotation, translation over depth) are one
ORIGIN = np.zeros(3)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def scan(xy: Array, xyz: Array, focal: Array, rotation: Array, translation: Array, error: Array) -> None:
    """P3P on the first three points for every focal length, and how far (px) the fourth point then is.

    focal (G,); outputs rotation (G, 4, 3, 3), translation (G, 4, 3), error (G, 4), inf where no solution.
    """
    rays = np.empty((3, 3))
    for g in range(len(focal)):
        f = focal[g]
        for i in range(3):
            k = 1.0 / math.sqrt(xy[i, 0] ** 2 + xy[i, 1] ** 2 + f * f)
            rays[i, 0], rays[i, 1], rays[i, 2] = k * xy[i, 0], k * xy[i, 1], k * f
        n = p3p_kernel(rays, xyz[:3], rotation[g], translation[g])
        for k in range(4):
            error[g, k] = math.inf
            if k < n:
                x, y, z = _camera_point(rotation[g, k], translation[g, k], xyz[3])
                if z > 0.0:
                    error[g, k] = math.hypot(f * x / z - xy[3, 0], f * y / z - xy[3, 1])


@nb.njit(cache=True, nogil=True)
def _camera_point(r: Array, t: Array, p: Array) -> tuple[float, float, float]:
    return (
        r[0, 0] * p[0] + r[0, 1] * p[1] + r[0, 2] * p[2] + t[0],
        r[1, 0] * p[0] + r[1, 1] * p[1] + r[1, 2] * p[2] + t[1],
        r[2, 0] * p[0] + r[2, 1] * p[1] + r[2, 2] * p[2] + t[2],
    )


@nb.njit(cache=True, nogil=True)
def _nearest(g: int, k: int, h: int, rotation: Array, error: Array) -> int:
    """Solution at grid point h nearest in rotation to solution k of grid point g; -1 for none at all near."""
    nearest, at = 0.5, -1  # Frobenius distance squared
    for m in range(4):
        if error[h, m] < math.inf:
            d = 0.0
            for i in range(3):
                for j in range(3):
                    d += (rotation[h, m, i, j] - rotation[g, k, i, j]) ** 2
            if d < nearest:
                nearest, at = d, m
    return at


@nb.njit(cache=True, nogil=True)
def _continuation(g: int, k: int, h: int, rotation: Array, error: Array) -> int:
    """Solution at grid point h that continues solution k of grid point g, each the other's nearest; -1 for none."""
    m = _nearest(g, k, h, rotation, error)
    return m if m >= 0 and _nearest(h, m, g, rotation, error) == k else -1


@nb.njit(cache=True, nogil=True)
def choose_starts(rotation: Array, error: Array, max_error: float, chosen: NDArray[np.bool_]) -> None:
    """Mark the grid solutions from which to refine, ``chosen`` (G, 4).

    Those are the minima of the error along each branch with their neighbours, the ends of branches (two solutions
    meet there, between grid points), and every second one of those that fit already (a flat valley may hold several
    minima).
    """
    last = len(error) - 1
    for g in range(last + 1):
        for k in range(4):
            if not error[g, k] < math.inf:
                continue
            before = _continuation(g, k, g - 1, rotation, error) if g > 0 else -1
            after = _continuation(g, k, g + 1, rotation, error) if g < last else -1
            rising = before >= 0 and error[g - 1, before] < error[g, k]
            falling = after >= 0 and error[g + 1, after] < error[g, k]
            if not (rising or falling):
                chosen[g, k] = True
                if before >= 0:
                    chosen[g - 1, before] = True
                if after >= 0:
                    chosen[g + 1, after] = True
            fits = g % 2 == 0 and error[g, k] <= max_error
            if (before < 0 < g) or (after < 0 and g < last) or fits:
                chosen[g, k] = True


@nb.njit(cache=True, nogil=True)
def refine_all(
    xy: Array, xyz: Array, grid: Array, rotation: Array, translation: Array, chosen: NDArray[np.bool_], out: Array
) -> int:
    """Refine from each chosen start; rows of ``out`` (4 G, 15) are focal, rms, sigma and the pose, each once."""
    n = 0
    pose = np.empty((3, 4))
    low, high = 0.5 * grid[0], 2.0 * grid[-1]
    for g in range(len(grid)):
        for k in range(4):
            if not chosen[g, k]:
                continue
            for i in range(3):
                for j in range(3):
                    pose[i, j] = rotation[g, k, i, j]
                pose[i, 3] = translation[g, k, i]
            out[n, 0], out[n, 1], out[n, 2] = refine(xy, xyz, pose, grid[g], low, high)
            for i in range(3):
                for j in range(4):
                    out[n, 3 + 4 * i + j] = pose[i, j]
            if out[n, 1] < math.inf and not _is_known(out, n):
                n += 1
    return n


@nb.njit(cache=True, nogil=True)
def _is_known(out: Array, n: int) -> bool:
    """Whether row n repeats an earlier one, which it then replaces if it fits better."""
    for m in range(n):
        difference = abs(out[n, 0] / out[m, 0] - 1.0)
        for i in range(3, 15):
            size = out[n, 14] if i % 4 == 2 else 1.0  # columns 6, 10, 14 are the translation
            difference = max(difference, abs(out[n, i] - out[m, i]) / size)
        if difference < _SAME:
            if out[n, 1] < out[m, 1]:
                out[m] = out[n]
            return True
    return False


@nb.njit(cache=True, nogil=True, error_model="numpy")
def refine(xy: Array, xyz: Array, pose: Array, focal: float, low: float, high: float) -> tuple[float, float, float]:
    """Least-squares pose and focal length of all four points (Levenberg-Marquardt), ``pose`` (3, 4) in place.

    Returns focal length, root-mean-square length of the residual, and the standard deviation of the logarithm of
    the focal length for one pixel of noise per coordinate (inf where it is not determined). The residual is inf where
    no minimum was reached between the focal lengths ``low`` and ``high``.
    """
    jac, res, normal, step, trial = np.empty((8, 7)), np.empty(8), np.empty((7, 7)), np.empty(7), np.empty((3, 4))
    cost = _system(xy, xyz, pose, focal, jac, res)
    damping = 1e-6
    for _ in range(_STEPS):
        _normal_equations(jac, res, damping, normal, step)
        if not solved(normal, step, 7, _PIVOT):
            damping = 10.0 * damping
            continue
        new_focal = _move(pose, focal, step, trial)
        new = _follow(xy, xyz, trial, new_focal, jac, res, normal, step)
        if new < cost:
            done = cost - new < 1e-12 * cost or new < 1e-28 * focal * focal
            _copy(trial, pose)
            focal, cost, damping = new_focal, new, 0.1 * damping
            if done or not low < focal < high:
                break
        else:
            damping = max(10.0 * damping, 1e-10)
            _system(xy, xyz, pose, focal, jac, res)
            if damping > 1e3:
                break
    cost = _system(xy, xyz, pose, focal, jac, res)
    _normal_equations(jac, res, 0.0, normal, step)
    if not solved(normal, step, 7, _PIVOT):
        return focal, math.sqrt(0.25 * cost), math.inf
    if _predicted_gain(jac, res, step) > 1e-3 * cost and cost > 1e-20 * focal * focal:
        return focal, math.inf, math.inf  # still under way in a flat valley: not a minimum
    # The last pivot of the Cholesky factor is the information on the last parameter, the others being free.
    return focal, math.sqrt(0.25 * cost), 1.0 / normal[6, 6]


@nb.njit(cache=True, nogil=True)
def _predicted_gain(jac: Array, res: Array, step: Array) -> float:
    """By how much the linear model says that ``step`` lowers the sum of squares."""
    gain = 0.0
    for m in range(8):
        change = 0.0
        for i in range(7):
            change += jac[m, i] * step[i]
        gain -= change * (2.0 * res[m] + change)
    return gain


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _follow(xy: Array, xyz: Array, pose: Array, f: float, jac: Array, res: Array, normal: Array, step: Array) -> float:
    """Two Gauss-Newton steps of the pose alone, in place; returns the sum of squares with its system in jac, res.

    Tilt and focal length make a curved valley (their product is what a flat set of points shows): without this
    every step along it would be cut short.
    """
    cost = _system(xy, xyz, pose, f, jac, res)
    for _ in range(2):
        if not cost < math.inf:
            break
        _normal_equations(jac, res, 1e-12, normal, step)
        step[6] = 0.0
        if not solved(normal, step, 6, _PIVOT):
            break
        _move(pose, f, step, pose)
        cost = _system(xy, xyz, pose, f, jac, res)
    return cost


@nb.njit(cache=True, nogil=True)
def _copy(a: Array, b: Array) -> None:
    for i in range(3):
        for j in range(4):
            b[i, j] = a[i, j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _system(xy: Array, xyz: Array, pose: Array, f: float, jac: Array, res: Array) -> float:
    """Residuals (8), Jacobian, sum of squares (inf behind the camera).

    Parameters are [rotation, x and y of the translation over depth, log depth, relative change of 1 / focal]. The
    focal length takes the depth with it, so the size of the image stays (else the two would be one narrow valley),
    and perspective is almost linear in its inverse.
    """
    total, scale = 0.0, pose[2, 3]
    for i in range(4):
        x, y, z = _camera_point(pose, ORIGIN, xyz[i])
        depth = z + pose[2, 3]
        if not depth > 0.0:
            return math.inf
        k = f / depth
        u, v = (x + pose[0, 3]) / depth, (y + pose[1, 3]) / depth
        a, b = 2 * i, 2 * i + 1
        res[a], res[b] = f * u - xy[i, 0], f * v - xy[i, 1]
        total += res[a] ** 2 + res[b] ** 2
        jac[a, 0], jac[a, 1], jac[a, 2] = -k * u * y, k * (z + u * x), -k * y
        jac[b, 0], jac[b, 1], jac[b, 2] = -k * (z + v * y), k * v * x, k * x
        jac[a, 3], jac[a, 4], jac[a, 5] = k * scale, 0.0, -k * u * scale
        jac[b, 3], jac[b, 4], jac[b, 5] = 0.0, k * scale, -k * v * scale
        jac[a, 6], jac[b, 6] = -f * u - jac[a, 5], -f * v - jac[b, 5]
    return total


@nb.njit(cache=True, nogil=True)
def _normal_equations(jac: Array, res: Array, damping: float, normal: Array, right: Array) -> None:
    for i in range(7):
        right[i] = 0.0
        for m in range(8):
            right[i] -= jac[m, i] * res[m]
        for j in range(i + 1):
            total = 0.0
            for m in range(8):
                total += jac[m, i] * jac[m, j]
            normal[i, j] = total
        normal[i, i] *= 1.0 + damping


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _move(pose: Array, focal: float, step: Array, out: Array) -> float:
    """New pose into ``out``: exp(step[:3]) applied to the rotation; returns the new focal length."""
    wx, wy, wz = step[0], step[1], step[2]
    theta2 = wx * wx + wy * wy + wz * wz
    theta = math.sqrt(theta2)
    a = math.sin(theta) / theta if theta > 1e-6 else 1.0 - theta2 / 6.0
    half = math.sin(0.5 * theta)
    b = 2.0 * half * half / theta2 if theta > 1e-6 else 0.5
    for j in range(3):
        x, y, z = pose[0, j], pose[1, j], pose[2, j]
        cx, cy, cz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
        out[0, j] = x + a * cx + b * (wy * cz - wz * cy)
        out[1, j] = y + a * cy + b * (wz * cx - wx * cz)
        out[2, j] = z + a * cz + b * (wx * cy - wy * cx)
    ratio = 1.0 / (1.0 + min(max(step[6], -0.8), 4.0))
    out[0, 3] = pose[0, 3] + pose[2, 3] * step[3]
    out[1, 3] = pose[1, 3] + pose[2, 3] * step[4]
    out[2, 3] = pose[2, 3] * math.exp(min(max(step[5], -1.0), 1.0)) * ratio
    return focal * ratio
