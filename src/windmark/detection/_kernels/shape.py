"""What a found spot looks like and how well its centre is known. Private; arrays in, arrays out."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.detection._kernels.spot import BOWL_EDGE_PX, bowl_quadratic, plane_window, smallest, soft_disc
from windmark.geometry._jit import nb

RING_INNER, RING_OUTER = 1.5, 2.0  # of r0: where the background round the spot is measured (+ 0.5 px outside)


@nb.njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def bowl_covariance(
    g: Any, x: float, y: float, r0: float, bowl: Any, fit: Any, w: Any, e: Any, inv: Any, jac: Any, cov: Any
) -> None:
    """Covariance (xx, xy, yy) of the bowl's vertex for white noise of variance 1.

    The centre c is where the bowl's gradient G(c, image) is 0, so dc = -(dG/dc)^-1 dG. dG/dc is taken by differences:
    the bowl is pointed, and the second derivative of the fitted quadratic is a fifth too large. G is a weighted sum of
    explained(k) = (t'_k . g)^2 / |t'_k|^2, whose derivative to pixel p is -2 depth_k t'_k(p).
    """
    slopes, q, h = np.empty((2, 2)), np.empty(5), 0.2
    cov[0] = cov[1] = cov[2] = math.nan
    for m in range(2):
        for sign in (-1.0, 1.0):
            u, v = (x + sign * h, y) if m == 0 else (x, y + sign * h)
            if not bowl_quadratic(g, u, v, r0, bowl, fit, w, e, inv, q):
                return
            for k in range(2):
                slopes[k, m] = (0.0 if sign < 0 else slopes[k, m]) + sign * q[k] / (2.0 * h)
    det = slopes[0, 0] * slopes[1, 1] - slopes[0, 1] * slopes[1, 0]
    if not (det > 0.0 and slopes[0, 0] > 0.0) or plane_window(g, x, y, r0, w, e, inv)[0] <= 0.0:
        return
    half = w.shape[0] // 2
    ox, oy = x - math.floor(x + 0.5), y - math.floor(y + 0.5)
    jac[:, :, :] = 0.0
    slope = np.zeros((2, 3))  # what all templates have in common outside their discs: a plane, added at the end
    reach = r0 + 0.5 * BOWL_EDGE_PX
    for k in range(bowl.shape[0]):
        u, v = ox + bowl[k, 0], oy + bowl[k, 1]
        j0, j1 = max(-half, math.ceil(v - reach)), min(half, math.floor(v + reach))
        i0, i1 = max(-half, math.ceil(u - reach)), min(half, math.floor(u + reach))
        t1 = tx = ty = tt = te = 0.0
        for j in range(j0, j1 + 1):
            wr, er, r1 = w[j + half], e[j + half], 0.0
            for i in range(i0, i1 + 1):
                t = soft_disc(r0, math.sqrt((i - u) ** 2 + (j - v) ** 2), BOWL_EDGE_PX)
                q = wr[i + half] * t
                r1, tx, tt, te = r1 + q, tx + q * i, tt + q * t, te + er[i + half] * t
            t1, ty = t1 + r1, ty + j * r1
        a = inv[0] * t1 + inv[1] * tx + inv[2] * ty
        b = inv[1] * t1 + inv[3] * tx + inv[4] * ty
        c = inv[2] * t1 + inv[4] * tx + inv[5] * ty
        free = tt - a * t1 - b * tx - c * ty
        if not free > 1e-3 * tt:
            continue
        s0, s1 = 2.0 * te / free * fit[0, k], 2.0 * te / free * fit[1, k]
        for m, s in ((0, s0), (1, s1)):
            slope[m, 0] -= s * a
            slope[m, 1] -= s * b
            slope[m, 2] -= s * c
        for j in range(j0, j1 + 1):
            jx, jy = jac[0, j + half], jac[1, j + half]
            for i in range(i0, i1 + 1):
                t = soft_disc(r0, math.sqrt((i - u) ** 2 + (j - v) ** 2), BOWL_EDGE_PX)
                jx[i + half] += s0 * t
                jy[i + half] += s1 * t
    _outer_sum(w, jac, slope, slopes / det, cov)


@nb.njit(cache=True, nogil=True)
def _outer_sum(w: Any, jac: Any, slope: Any, a: Any, cov: Any) -> None:
    """Sum over the window of (A^-1 j)(A^-1 j)^T with j = w (jac + slope); `a` is A / det A."""
    half = w.shape[0] // 2
    cov[:] = 0.0
    for j in range(-half, half + 1):
        for i in range(-half, half + 1):
            q = w[j + half, i + half]
            gx = q * (jac[0, j + half, i + half] + slope[0, 0] + slope[0, 1] * i + slope[0, 2] * j)
            gy = q * (jac[1, j + half, i + half] + slope[1, 0] + slope[1, 1] * i + slope[1, 2] * j)
            jx, jy = a[1, 1] * gx - a[0, 1] * gy, a[0, 0] * gy - a[1, 0] * gx
            cov[0] += jx * jx
            cov[1] += jx * jy
            cov[2] += jy * jy


@nb.njit(cache=True, nogil=True)
def median(a: Any, n: int) -> Any:
    """Median of a[:n], which is reordered; n is at least 1."""
    middle = smallest(a, n, n // 2)
    if n % 2 == 1:
        return middle
    below = a[0]
    for i in range(1, n // 2):
        below = max(below, a[i])
    return 0.5 * (below + middle)


@nb.njit(cache=True, nogil=True)
def _ring_fit(ring: Any, n: int, limit: float, plane: Any) -> bool:
    """Least-squares plane through the ring's pixels whose residual is within the limit; False if there is none."""
    m = sx = sy = sxx = sxy = syy = sg = sgx = sgy = 0.0
    for k in range(n):
        if abs(ring[k, 3]) <= limit:
            u, v, value = ring[k, 0], ring[k, 1], ring[k, 2]
            m, sx, sy, sg = m + 1.0, sx + u, sy + v, sg + value
            sxx, sxy, syy = sxx + u * u, sxy + u * v, syy + v * v
            sgx, sgy = sgx + value * u, sgy + value * v
    c00, c01, c02 = sxx * syy - sxy * sxy, sxy * sy - sx * syy, sx * sxy - sxx * sy
    det = m * c00 + sx * c01 + sy * c02
    if not det > 1e-6 * m * sxx * syy:
        return False
    c11, c12, c22 = m * syy - sy * sy, sx * sy - m * sxy, m * sxx - sx * sx
    plane[0] = (c00 * sg + c01 * sgx + c02 * sgy) / det
    plane[1] = (c01 * sg + c11 * sgx + c12 * sgy) / det
    plane[2] = (c02 * sg + c12 * sgx + c22 * sgy) / det
    return True


@nb.njit(cache=True, nogil=True)
def ring_plane(g: Any, x: float, y: float, r0: float, ring: Any, plane: Any) -> tuple[float, int]:
    """Robust plane through the ring round the spot: (a, b, c) of a + b (x' - x) + c (y' - y) into `plane`.

    Returns the scatter about it (1.4826 x median of the absolute residuals) and the number of ring pixels,
    which lie in `ring` with their residual in the fourth column. Three passes, each without the pixels beyond
    2.5 scatters of the pass before: a neighbour or a line in the ring does not tilt the plane.
    """
    cx, cy, n = math.floor(x + 0.5), math.floor(y + 0.5), 0
    outer, inner = RING_OUTER * r0 + 0.5, RING_INNER * r0
    step = max(1, int(r0 / 8.0))  # some hundred pixels of a large ring are enough
    h = (int(outer) // step + 1) * step
    for j in range(-h, h + 1, step):
        for i in range(-h, h + 1, step):
            if not (0 <= cy + j < g.shape[0] and 0 <= cx + i < g.shape[1]):
                continue
            u, v, value = cx + i - x, cy + j - y, float(g[cy + j, cx + i])
            if inner * inner <= u * u + v * v <= outer * outer and value == value:
                ring[n, 0], ring[n, 1], ring[n, 2], ring[n, 3] = u, v, value, 0.0
                n += 1
    limit, scatter = math.inf, math.nan
    size = ring[:, 4]
    for _ in range(3):
        if not _ring_fit(ring, n, limit, plane):
            return math.nan, n
        for k in range(n):
            ring[k, 3] = ring[k, 2] - plane[0] - plane[1] * ring[k, 0] - plane[2] * ring[k, 1]
            size[k] = abs(ring[k, 3])
        scatter = 1.4826 * median(size, n)
        limit = max(2.5 * scatter, 1e-6 * abs(plane[0]) + 1e-30)
    return scatter, n


@nb.njit(cache=True, nogil=True)
def hole_moments(g: Any, x: float, y: float, r0: float, plane: Any, out: Any) -> None:
    """Depth at the core, volume, second moments (xx, xy, yy) below the plane, pixels used, pixels missing.

    The core is the disc of radius r0/2; volume and moments are taken out to 1.5 r0.
    """
    cx, cy = math.floor(x + 0.5), math.floor(y + 0.5)
    h = int(1.5 * r0 + 0.5) + 1
    core = core_n = vol = vol_n = mxx = mxy = myy = missing = 0.0
    for j in range(-h, h + 1):
        for i in range(-h, h + 1):
            u, v = cx + i - x, cy + j - y
            r = math.sqrt(u * u + v * v)
            q = soft_disc(1.5 * r0, r, 1.0)
            if q == 0.0:
                continue
            inside = 0 <= cy + j < g.shape[0] and 0 <= cx + i < g.shape[1]
            value = float(g[cy + j, cx + i]) if inside else math.nan
            if value != value:
                missing += q
                continue
            hole = plane[0] + plane[1] * u + plane[2] * v - value
            vol += q * hole
            vol_n += q
            mxx, mxy, myy = mxx + q * hole * u * u, mxy + q * hole * u * v, myy + q * hole * v * v
            p = soft_disc(max(0.5 * r0, 0.8), r, 1.0)
            core += p * hole
            core_n += p
    out[0] = core / core_n if core_n > 0.0 else math.nan
    out[1], out[2], out[3], out[4], out[5], out[6] = vol, mxx, mxy, myy, vol_n, missing


@nb.njit(cache=True, nogil=True)
def count_above(g: Any, x: float, y: float, radius: float, level: float, sign: float) -> float:
    """Share of the pixels within `radius` whose sign * g is at or above the level."""
    cx, cy, h = math.floor(x + 0.5), math.floor(y + 0.5), int(radius) + 1
    n = hit = 0
    for j in range(max(-h, -cy), min(h, g.shape[0] - 1 - cy) + 1):
        for i in range(max(-h, -cx), min(h, g.shape[1] - 1 - cx) + 1):
            if (cx + i - x) ** 2 + (cy + j - y) ** 2 <= radius * radius:
                n += 1
                hit += sign * g[cy + j, cx + i] >= level
    return hit / max(n, 1)


@nb.njit(cache=True, nogil=True)
def describe(g: Any, xy: Any, r0: float, clip: float, sign: float) -> Any:
    """Rows of `shape.COLUMNS` for the spots at xy (K, 2)."""
    size = 2 * (int(2.0 * r0 + 0.5) + 1) + 3
    ring, plane, out = np.empty((size * size, 5)), np.zeros(3), np.full((xy.shape[0], 10), math.nan)
    for s in range(xy.shape[0]):
        x, y = xy[s, 0], xy[s, 1]
        scatter, n = ring_plane(g, x, y, r0, ring, plane)
        if not scatter >= 0.0:
            continue
        out[s, 0] = scatter
        hole_moments(g, x, y, r0, plane, out[s, 1:8])
        outliers = 0
        for k in range(n):
            outliers += abs(ring[k, 3]) > max(5.0 * scatter, 0.1 * abs(out[s, 1]))
        out[s, 8] = outliers / max(n, 1)
        out[s, 9] = count_above(g, x, y, 2.0 * r0, clip, sign)
    return out


@nb.njit(cache=True, nogil=True)
def centre_covariances(g: Any, xy: Any, r0: float, bowl: Any, fit: Any) -> Any:
    """Covariances (K, 3: xx, xy, yy) of the centres xy (K, 2) for white noise of variance 1."""
    size = 2 * (int(2.0 * r0 + 0.5) + 1) + 1
    w, e, jac = np.empty((size, size)), np.empty((size, size)), np.empty((2, size, size))
    inv, out = np.empty(6), np.empty((xy.shape[0], 3))
    for s in range(xy.shape[0]):
        bowl_covariance(g, xy[s, 0], xy[s, 1], r0, bowl, fit, w, e, inv, jac, out[s])
    return out
