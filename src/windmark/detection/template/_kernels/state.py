"""The template fit's own coordinates, their bounds and their start. Private.

A state u is what a blurred disc shows: centre, second moments S = L L / 4 + blur^2 (u[2:5]), blur^2 (u[5]), volume =
depth * det L (u[6]), background, slope. In these coordinates the long curved valley that small discs leave between
size, blur and depth is straight, and the damping of Levenberg and Marquardt acts along it.
"""

from __future__ import annotations

import math
from typing import Any

from windmark.geometry._jit import nb

BLUR_MIN = 0.25  # px; below it only the pixel's box is seen
AXIS_MIN = 0.5  # px


@nb.njit(cache=True, nogil=True, error_model="numpy")
def shape_of(u: Any, p: Any, t: Any) -> None:
    """Model parameters p of a state u, and t = d(p[2:7]) / d(u[2:7])."""
    for k in range(10):
        p[k] = u[k]
    sigma = math.sqrt(u[5])
    a, b, d = 4.0 * (u[2] - u[5]), 4.0 * u[3], 4.0 * (u[4] - u[5])
    area = math.sqrt(a * d - b * b)
    trace = math.sqrt(a + d + 2.0 * area)
    p[2], p[3], p[4], p[5], p[6] = (a + area) / trace, b / trace, (d + area) / trace, sigma, u[6] / area
    for k in range(5):  # by S_xx, S_xy, S_yy, blur^2, volume
        all4 = -4.0 if k == 3 else 0.0
        da, db, dd = 4.0 if k == 0 else all4, 4.0 if k == 1 else 0.0, 4.0 if k == 2 else all4
        darea = 0.5 * (d * da + a * dd - 2.0 * b * db) / area
        dtrace = 0.5 * (da + dd + 2.0 * darea) / trace
        t[0, k] = (da + darea - p[2] * dtrace) / trace
        t[1, k] = (db - p[3] * dtrace) / trace
        t[2, k] = (dd + darea - p[4] * dtrace) / trace
        t[3, k] = 0.5 / sigma if k == 3 else 0.0
        t[4, k] = (1.0 if k == 4 else -p[6] * darea) / area


@nb.njit(cache=True, nogil=True, error_model="numpy")
def advance(u: Any, step: Any, keep_blur: bool, trial: Any) -> float:
    """Trial = u + f step inside the bounds; returns f <= 1, which keeps the start of a fit from running away.

    Where the smaller half axis would fall below its bound the blur gives way, or the axis if the blur is known well.
    """
    mean, gap = 0.5 * (u[2] + u[4]), math.sqrt(0.25 * (u[2] - u[4]) ** 2 + u[3] * u[3])
    share = math.sqrt((step[0] ** 2 + step[1] ** 2) / (mean - gap))
    share = max(share, 1.5 * math.sqrt(0.5 * (step[2] ** 2 + step[4] ** 2) + step[3] ** 2) / (mean - gap))
    f = 1.0 / max(share, 0.8 * abs(step[5]) / u[5], 1.0)
    for k in range(u.size):
        trial[k] = u[k] + f * step[k]
    mean, gap = 0.5 * (trial[2] + trial[4]), math.sqrt(0.25 * (trial[2] - trial[4]) ** 2 + trial[3] * trial[3])
    if not keep_blur:
        trial[5] = min(trial[5], mean - gap - 0.25 * AXIS_MIN * AXIS_MIN)
    trial[5] = max(trial[5], BLUR_MIN * BLUR_MIN)
    least = trial[5] + 0.25 * AXIS_MIN * AXIS_MIN
    if mean - gap < least:  # raise the smaller second moment alone
        large, small = max(mean + gap, least), least
        g = (large - small) / (2.0 * gap) if gap > 0.0 else 0.0
        half = 0.5 * g * (trial[2] - trial[4])
        trial[2], trial[3], trial[4] = 0.5 * (large + small) + half, g * trial[3], 0.5 * (large + small) - half
    return f


@nb.njit(cache=True, nogil=True, error_model="numpy")
def at_bound(u: Any, step: Any, matrix: Any, held: Any) -> bool:
    """Where the step leaves the bounds from a state on them, keep it on them: True if it did."""
    hit = u[5] <= BLUR_MIN * BLUR_MIN and step[5] < 0.0
    if hit:
        held[5] = True
    gap = math.sqrt(0.25 * (u[2] - u[4]) ** 2 + u[3] * u[3])
    if 0.5 * (u[2] + u[4]) - gap - u[5] > 0.25001 * AXIS_MIN * AXIS_MIN or gap == 0.0:
        return hit
    xx, xy = 0.5 - 0.25 * (u[2] - u[4]) / gap, -0.5 * u[3] / gap  # projector on the smaller half axis
    c = (xx, 2.0 * xy, 1.0 - xx, -1.0)
    if c[0] * step[2] + c[1] * step[3] + c[2] * step[4] + c[3] * step[5] >= 0.0:
        return hit
    stiff = 1e4 * (matrix[2, 2] + matrix[4, 4])
    for i in range(4):
        for k in range(4):
            matrix[2 + i, 2 + k] += stiff * c[i] * c[k]
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def moments(patch: Any, weight: Any, start: Any, u: Any) -> None:
    """State from the moments of the hole within 1.5 px + blur of the rim, below the plane of what lies outside.

    `start`: x, y, radius, blur. The plane has its slope from the window's halves: first moments over second moments.
    Moments that are far from those of such a disc are replaced by them.
    """
    half, x, y, blur = patch.shape[0] // 2, start[0], start[1], start[3]
    rim2 = (start[2] + 1.5 + blur) ** 2
    n = g0 = gx = gy = xx = yy = 0.0
    for j in range(patch.shape[0]):
        for i in range(patch.shape[0]):
            dx, dy = i - half - x, j - half - y
            w = weight[j, i] if dx * dx + dy * dy > rim2 else 0.0
            v = w * patch[j, i]
            n += w
            g0 += v
            gx += v * dx
            gy += v * dy
            xx += w * dx * dx
            yy += w * dy * dy
    b, qx, qy = g0 / max(n, 1.0), gx / max(xx, 1.0), gy / max(yy, 1.0)
    volume = mx = my = sxx = sxy = syy = 0.0
    for j in range(patch.shape[0]):
        for i in range(patch.shape[0]):
            dx, dy = i - half - x, j - half - y
            w = weight[j, i] if dx * dx + dy * dy <= rim2 else 0.0
            hole = w * (b + qx * dx + qy * dy - patch[j, i])
            volume += hole
            mx += hole * dx
            my += hole * dy
            sxx += hole * dx * dx
            sxy += hole * dx * dy
            syy += hole * dy * dy
    usual = 0.25 * start[2] ** 2 + blur * blur
    mx, my = mx / volume, my / volume
    sxx, sxy, syy = sxx / volume - mx * mx - 1.0 / 12.0, sxy / volume - mx * my, syy / volume - my * my - 1.0 / 12.0
    mean, gap = 0.5 * (sxx + syy), math.sqrt(0.25 * (sxx - syy) ** 2 + sxy * sxy)
    good = mx * mx + my * my < 0.25 * start[2] ** 2 and mean + gap < 2.0 * usual
    good = good and mean - gap > max(0.15 * usual, blur * blur + AXIS_MIN * AXIS_MIN)
    u[0], u[1], u[2], u[3], u[4], u[6] = x + mx, y + my, sxx, sxy, syy, volume
    u[5], u[7], u[8], u[9] = blur * blur, b, 0.0, 0.0
    if not good:
        u[0], u[1], u[2], u[3], u[4], u[6] = x, y, usual, 0.0, usual, abs(volume)
