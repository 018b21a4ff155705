"""Exhaustive search for a disc of known shape round a predicted place, and the same filter where no marker is. Private.

A window is the least-squares fit of plane and disc image to the pixels round a place. Where all of them can be used the
disc image less its plane is the same for every place, and a window costs one pass; where some are missing (border,
mask, saturation) each window has its own plane.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection.template._kernels.cut import grey_row
from windmark.detection.template._kernels.held import held_sums, pixel_table
from windmark.detection.template._kernels.model import points_needed
from windmark.geometry._jit import nb

FOUND = ("x", "y", "correlation", "depth", "background", "usable", "misfit")  # columns of `search_discs`
WINDOW = ("correlation", "depth", "background", "misfit", "usable")  # columns of `ring_windows`
LEAST_KNOWN = 0.5  # share of a window's pixels that must be usable
BLOCK = 7  # windows beside each other that share a strip of the patch
LANES = 32  # rows of pixels are so many long, or a multiple: a vector unit's work without a rest


@nb.njit(cache=True, nogil=True, error_model="numpy")
def square_of(size: int) -> Any:
    """Scratch."""
    return np.empty((size, size), np.float32)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def cut(image: Any, usable: Any, sign: float, saturation: float, x0: int, y0: int, patch: Any, known: Any) -> Any:
    """Patch from (x0, y0) as a hole on a mean of 0, `known` 1 or 0; returns the mean and the number of known pixels."""
    side, row = patch.shape[0], np.empty(patch.shape[0])
    if usable.shape[0] == 0:
        mean, whole = cut_whole(image, sign, saturation, x0, y0, row, patch)
        if whole:
            known[:] = 1.0
            return sign * mean, patch.size
    total, count = 0.0, 0
    for j in range(side):
        grey_row(image, y0 + j, x0, row)
        for i in range(side):
            good = -math.inf < row[i] < saturation
            if good and usable.shape[0] > 0:
                good = usable[y0 + j, x0 + i]
            total += row[i] if good else 0.0
            known[j, i] = 1.0 if good else 0.0
            count += good
    mean = total / max(count, 1)
    for j in range(side):
        grey_row(image, y0 + j, x0, row)
        for i in range(side):
            patch[j, i] = sign * (row[i] - mean) if known[j, i] > 0.0 else 0.0
    return sign * mean, count


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def cut_whole(
    image: Any, sign: float, saturation: float, x0: int, y0: int, row: Any, patch: Any
) -> tuple[float, bool]:
    """The same for a patch of which all pixels are known, with `row` as scratch: its mean, and whether they are."""
    total, unknown, side = 0.0, 0, patch.shape[0]
    for j in range(side):
        grey_row(image, y0 + j, x0, row)
        for i in range(side):
            v = row[i]
            total += v
            unknown += not (-math.inf < v < saturation)
    mean = total / patch.size
    if unknown > 0:
        return mean, False
    for j in range(side):
        grey_row(image, y0 + j, x0, row)
        into = patch[j]
        for i in range(side):
            into[i] = sign * (row[i] - mean)
    return mean, True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def templates(
    p: Any, reach: float, edges: Any, g: Any, inside: Any, disc: Any, flat: Any
) -> tuple[float, float, float, float]:
    """Window, disc image, disc image less its plane (S, S); square sum of the last, pixels, sum of x^2, disc's mean.

    `edges` of `pixel_table` for the disc's blur.
    """
    held_sums(p, points_needed(p), edges, g)
    half, n, xx, t0, tx, ty, tt = disc.shape[0] // 2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(disc.shape[0]):
        for i in range(disc.shape[0]):
            x, y = float(i - half), float(j - half)
            w = 1.0 if x * x + y * y <= reach * reach else 0.0
            t = w * g[6, j, i]
            inside[j, i], disc[j, i], n, xx = w, t, n + w, xx + w * x * x
            t0, tx, ty = t0 + t, tx + t * x, ty + t * y
    for j in range(disc.shape[0]):
        for i in range(disc.shape[0]):
            plane = t0 / n + (tx * (i - half) + ty * (j - half)) / xx
            t = inside[j, i] * (disc[j, i] - plane)
            flat[j, i] = t
            tt += t * t
    return tt, n, xx, t0 / n


@nb.njit(cache=True, nogil=True, error_model="numpy")
def flattened(inside: Any, flat: Any, stride: int, rows: Any) -> None:
    """Window, window * x, window * y and the disc image less its plane in rows of so many pixels: `rows` (4, N)."""
    half = flat.shape[0] // 2
    for m in range(4):
        for i in range(rows.shape[1]):
            rows[m, i] = 0.0
    for j in range(flat.shape[0]):
        for i in range(flat.shape[0]):
            w, at = inside[j, i], j * stride + i
            rows[0, at], rows[1, at], rows[2, at], rows[3, at] = w, w * (i - half), w * (j - half), flat[j, i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def whole_windows(
    patch: Any, size: int, rows: Any, strip: Any, sums: tuple[float, float, float, float], rho: Any
) -> None:
    """Correlations (steps, steps) of all windows of a patch without gaps.

    A strip of the patch is so wide that BLOCK windows fit beside each other. In it a window is one row of pixels, with
    zeros in `rows` between those that count, and long rows are what is fast. `rows` as `flattened` leaves them, `sums`
    as `templates` returns them.
    """
    stride, n = size + BLOCK - 1, rows.shape[1]
    for left in range(0, rho.shape[1], BLOCK):
        wide = min(stride, patch.shape[1] - left)
        for j in range(patch.shape[0]):
            for i in range(wide):
                strip[j * stride + i] = patch[j, left + i]
        for i in range(left, min(left + BLOCK, rho.shape[1])):
            for j in range(rho.shape[0]):
                at = j * stride + i - left
                rho[j, i] = correlation(strip[at : at + n], rows, sums)


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def correlation(pixels: Any, rows: Any, sums: tuple[float, float, float, float]) -> float:
    """Correlation of disc and window, both less their planes, from one row of pixels."""
    tt, n, xx, _ = sums
    zero: Any = np.float32(0.0)
    w, x, y, t = rows[0], rows[1], rows[2], rows[3]
    g0 = gx = gy = gg = gt = zero
    for i in range(w.size):
        v = pixels[i]
        u = w[i] * v
        g0 += u
        gg += u * v
        gx += x[i] * v
        gy += y[i] * v
        gt += t[i] * v
    a, b, c = float(g0), float(gx), float(gy)
    square = gg - a * a / n - (b * b + c * c) / xx
    return -gt / math.sqrt(tt * square) if square > 0.0 and tt > 0.0 else 0.0


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def verdict(
    gt: float, tt: float, square: float, mean: float, cover: float, n: float
) -> tuple[float, float, float, float]:
    """`WINDOW` from sums of squares without their planes (disc times window, disc, window) and the two means."""
    if not (square > 0.0 and tt > 0.0):
        return 0.0, 0.0, mean, 0.0
    misfit = max(square - gt * gt / tt, 0.0) / max(n - 4.0, 1.0)
    return -gt / math.sqrt(tt * square), -gt / tt, mean - gt / tt * cover, misfit


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def gappy_window(
    patch: Any, known: Any, dx: int, dy: int, inside: Any, disc: Any, total: float
) -> tuple[float, float, float, float]:
    """`WINDOW` but for `usable` at (dx, dy); NaN where more than half is missing. The plane fits what is there."""
    size = disc.shape[0]
    half = size // 2
    n = sx = sy = sxx = sxy = syy = v0 = vx = vy = vv = t0 = tx = ty = tt = tv = 0.0
    for j in range(size):
        y, window, image = float(j - half), inside[j], disc[j]
        row, there = patch[dy + j, dx : dx + size], known[dy + j, dx : dx + size]
        for i in range(size):
            w, x = float(window[i] * there[i]), float(i - half)
            v, t = w * row[i], w * image[i]
            n, sx, sy, sxx, sxy, syy = n + w, sx + w * x, sy + w * y, sxx + w * x * x, sxy + w * x * y, syy + w * y * y
            v0, vx, vy, vv = v0 + v, vx + v * x, vy + v * y, vv + v * v
            t0, tx, ty, tt, tv = t0 + t, tx + t * x, ty + t * y, tt + t * t, tv + t * v
    if n < LEAST_KNOWN * total:
        return math.nan, math.nan, math.nan, math.nan
    a, b, c = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
    det = a * c - b * b
    if not det > 1e-9 * a * c:
        return math.nan, math.nan, math.nan, math.nan
    px, py, qx, qy = tx - sx * t0 / n, ty - sy * t0 / n, vx - sx * v0 / n, vy - sy * v0 / n
    tt -= t0 * t0 / n + (c * px * px - 2.0 * b * px * py + a * py * py) / det
    vv -= v0 * v0 / n + (c * qx * qx - 2.0 * b * qx * qy + a * qy * qy) / det
    tv -= t0 * v0 / n + (c * px * qx - b * (px * qy + py * qx) + a * py * qy) / det
    return verdict(tv, tt, vv, v0 / n, t0 / n, n)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def search_discs(
    image: Any, usable: Any, sign: float, saturation: float, pixel: Any, discs: Any, reach: Any, search: int, out: Any
) -> None:
    """Best place of each disc within +-search pixels: rows of `FOUND`, positions relative to the pixel.

    `usable` (H, W) or (0, 0); `pixel` (M, 2); `discs` (M, 6) as in `held_sums`, centred on the pixel, so that equal
    discs share their template. The best window has the largest correlation; a parabola through its neighbours places it
    within the pixel.
    """
    steps, size = 2 * search + 1, 0
    edges = pixel_table(discs[0, 5] if len(discs) else 1.0)
    rho = np.empty((steps, steps))
    for k in range(len(pixel)):
        half = int(math.ceil(reach[k]))
        fresh = size != 2 * half + 1
        if fresh:
            size = 2 * half + 1
            stride, side = size + BLOCK - 1, size + 2 * search
            g = np.empty((10, size, size))
            inside, disc, flat = square_of(size), square_of(size), square_of(size)
            patch, known = square_of(side), square_of(side)
            rows = np.empty((4, -(-size * stride // LANES) * LANES), np.float32)
            strip = np.zeros(side * stride + rows.shape[1], np.float32)
        if k > 0 and discs[k, 5] != discs[k - 1, 5]:
            edges = pixel_table(discs[k, 5])
        if fresh or reach[k] != reach[k - 1] or (discs[k] != discs[k - 1]).any():
            sums = templates(discs[k], reach[k], edges, g, inside, disc, flat)
            flattened(inside, flat, stride, rows)
        x0, y0 = pixel[k, 0] - half - search, pixel[k, 1] - half - search
        level, count = cut(image, usable, sign, saturation, x0, y0, patch, known)
        if count == patch.size:
            whole_windows(patch, size, rows, strip, sums, rho)
        else:
            for j in range(steps):
                for i in range(steps):
                    rho[j, i] = gappy_window(patch, known, i, j, inside, disc, sums[1])[0]
        best, bx, by = -2.0, search, search
        for j in range(steps):
            for i in range(steps):
                if rho[j, i] > best:
                    best, bx, by = rho[j, i], i, j
        r, depth, light, misfit = gappy_window(patch, known, bx, by, inside, disc, sums[1])
        out[k, 2], out[k, 3], out[k, 4], out[k, 6] = r, depth, level + light, misfit
        out[k, 0], out[k, 1], out[k, 5] = bx - search, by - search, count / patch.size
        if 0 < bx < steps - 1:
            out[k, 0] += vertex(rho[by, bx - 1], rho[by, bx], rho[by, bx + 1])
        if 0 < by < steps - 1:
            out[k, 1] += vertex(rho[by - 1, bx], rho[by, bx], rho[by + 1, bx])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def vertex(before: float, best: float, after: float) -> float:
    """Place of the top of a parabola through three values, the middle one the largest."""
    bend = before - 2.0 * best + after
    return 0.5 * (before - after) / bend if bend < 0.0 else 0.0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def ring_windows(
    image: Any, usable: Any, sign: float, saturation: float, pixel: Any, disc_row: Any, reach: float, out: Any
) -> None:
    """What the disc's window says at the pixels (K, 2): rows of `WINDOW`, NaN where half of its pixels are missing."""
    size = 2 * int(math.ceil(reach)) + 1
    g = np.empty((10, size, size))
    inside, disc, flat, patch, known = (
        square_of(size),
        square_of(size),
        square_of(size),
        square_of(size),
        square_of(size),
    )
    sums = templates(disc_row, reach, pixel_table(disc_row[5]), g, inside, disc, flat)
    for k in range(len(pixel)):
        level, count = cut(
            image, usable, sign, saturation, pixel[k, 0] - size // 2, pixel[k, 1] - size // 2, patch, known
        )
        rho, depth, light, misfit = gappy_window(patch, known, 0, 0, inside, disc, sums[1])
        out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4] = rho, depth, level + light, misfit, count / patch.size
