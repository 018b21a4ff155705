"""Numba kernels of the renderer: arrays in, arrays out. Readable twins are in tests/synth/test_kernels.py.

A *sample* is one ray: pixel slot s (row of the sample arrays) and sub-pixel k of n x n, in column
i = k % n and row j = k // n. Surfaces are sampled once in each sub-pixel (`screen.sample_offsets`);
decals are shared out over the square sub-pixels themselves. Rays are (u, v, 1) in
the camera's frame; inside a pixel they vary linearly (`ray`: u, v and their derivatives by x and y).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

BENDS = 3
"""Newton steps to where a ray crosses a curved decal: the next one moves it by less than 1e-6 of its radius."""


@nb.njit(cache=True, nogil=True)
def cast(
    vertices: Array, triangles: Ints, boxes: Ints, slot: Ints, ray: Array, dx: Array, dy: Array, hit: Ints, depth: Array
) -> None:
    """Nearest triangle along every sample, in triangle order; updates hit (S, n*n) and depth (S, n*n).

    vertices : (V, 3) in the camera's frame; boxes : (T, 4) pixel ranges x0, x1, y0, y1 that hold each
    triangle's image; slot : (H, W) row of the sample arrays or -1; ray : (H, W, 6).

    dx, dy : (n*n,) offsets of the samples from the pixel's centre.

    The three determinants of ray and edge decide: they are exactly opposite in the two triangles of
    an edge, so no ray slips between neighbours. Ties go to the lower triangle index.
    """
    for t in range(len(triangles)):
        if boxes[t, 1] < boxes[t, 0] or boxes[t, 3] < boxes[t, 2]:
            continue
        ax, ay, az = vertices[triangles[t, 0], 0], vertices[triangles[t, 0], 1], vertices[triangles[t, 0], 2]
        bx, by, bz = vertices[triangles[t, 1], 0], vertices[triangles[t, 1], 1], vertices[triangles[t, 1], 2]
        cx, cy, cz = vertices[triangles[t, 2], 0], vertices[triangles[t, 2], 1], vertices[triangles[t, 2], 2]
        px, py, pz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        qx, qy, qz = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
        rx, ry, rz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        volume = ax * px + ay * py + az * pz
        if volume == 0.0:
            continue
        sign = 1.0 if volume > 0.0 else -1.0
        for y in range(boxes[t, 2], boxes[t, 3] + 1):
            for x in range(boxes[t, 0], boxes[t, 1] + 1):
                s = slot[y, x]
                if s < 0:
                    continue
                for k in range(len(dx)):
                    u = ray[y, x, 0] + ray[y, x, 2] * dx[k] + ray[y, x, 3] * dy[k]
                    v = ray[y, x, 1] + ray[y, x, 4] * dx[k] + ray[y, x, 5] * dy[k]
                    wa = sign * (px * u + py * v + pz)
                    wb = sign * (qx * u + qy * v + qz)
                    wc = sign * (rx * u + ry * v + rz)
                    if wa >= 0.0 and wb >= 0.0 and wc >= 0.0:
                        z = abs(volume) / (wa + wb + wc) if wa + wb + wc > 0.0 else math.inf
                        if z < depth[s, k]:
                            depth[s, k] = z
                            hit[s, k] = t


@nb.njit(cache=True, nogil=True)
def interpolate(
    vertices: Array, triangles: Ints, hit: Ints, uv: Array, fields: Array, unit: NDArray[np.bool_], out: Array
) -> None:
    """Barycentric values (Q, S, 3) of vertex fields (V, 3 Q) where rays uv (S, 2) meet the plane of triangle hit (S,).

    Vectors whose ``unit`` (Q,) is set are brought to length one, but those of none.
    """
    w = np.empty(3)
    for s in range(len(hit)):
        a, b, c = triangles[hit[s], 0], triangles[hit[s], 1], triangles[hit[s], 2]
        u, v = uv[s, 0], uv[s, 1]
        total = 0.0
        for k in range(3):
            i, j = (b, c) if k == 0 else ((c, a) if k == 1 else (a, b))
            w[k] = (
                (vertices[i, 1] * vertices[j, 2] - vertices[i, 2] * vertices[j, 1]) * u
                + (vertices[i, 2] * vertices[j, 0] - vertices[i, 0] * vertices[j, 2]) * v
                + (vertices[i, 0] * vertices[j, 1] - vertices[i, 1] * vertices[j, 0])
            )
            total += w[k]
        for q in range(len(out)):
            for d in range(3):
                f = 3 * q + d
                out[q, s, d] = (w[0] * fields[a, f] + w[1] * fields[b, f] + w[2] * fields[c, f]) / total
            if unit[q]:
                x, y, z = out[q, s, 0], out[q, s, 1], out[q, s, 2]
                length = math.sqrt(x * x + y * y + z * z)
                if length > 0.0:
                    out[q, s, 0], out[q, s, 1], out[q, s, 2] = x / length, y / length, z / length


@nb.njit(cache=True, nogil=True)
def flag_edges(camera: Array, vertices: Array, xy: Array, edges: Ints, depth: Array, flag: NDArray[np.bool_]) -> None:
    """Flag every pixel (H, W) through which one of the edges (E, 2) passes and is not hidden.

    camera : Camera.packed(); vertices : (V, 3) camera frame; xy : (V, 2) their pixels, NaN where none;
    depth : (H, W) of the pixels' centres. The edge is walked in space in steps of about 1/4 px, so the
    lens may bend its image.
    """
    height, width = depth.shape
    for e in range(len(edges)):
        i, j = edges[e, 0], edges[e, 1]
        near = min(vertices[i, 2], vertices[j, 2])
        length = math.hypot(xy[i, 0] - xy[j, 0], xy[i, 1] - xy[j, 1])
        if near > 0.0 and length >= 0.0:
            length *= max(vertices[i, 2], vertices[j, 2]) / near
        else:
            length = 2.0 * (width + height)
        steps = int(min(4.0 * length, 16.0 * (width + height))) + 1
        for k in range(steps + 1):
            f = k / steps
            p0 = vertices[i, 0] + f * (vertices[j, 0] - vertices[i, 0])
            p1 = vertices[i, 1] + f * (vertices[j, 1] - vertices[i, 1])
            p2 = vertices[i, 2] + f * (vertices[j, 2] - vertices[i, 2])
            px, py, valid = project_point(camera, p0, p1, p2)
            if not valid or not (-0.5 <= px < width - 0.5 and -0.5 <= py < height - 0.5):
                continue
            x, y = int(px + 0.5), int(py + 0.5)
            if flag[y, x]:
                continue
            behind = 0.0
            for yy in range(max(0, y - 1), min(height, y + 2)):
                for xx in range(max(0, x - 1), min(width, x + 2)):
                    behind = max(behind, depth[yy, xx])
            flag[y, x] = p2 <= behind * 1.001


@nb.njit(cache=True, nogil=True)
def box_share(distance: float, gx: float, gy: float) -> float:
    """Share of the unit square on the inner side of a line: its centre's distance (positive inside), unit normal."""
    a, b = max(abs(gx), abs(gy)), min(abs(gx), abs(gy))
    t = abs(distance)
    if t >= 0.5 * (a + b):
        share = 1.0
    elif t <= 0.5 * (a - b):
        share = 0.5 + t / a
    else:
        share = 1.0 - (0.5 * (a + b) - t) ** 2 / (2.0 * a * b)
    return share if distance >= 0.0 else 1.0 - share


@nb.njit(cache=True, nogil=True)
def slab_share(near: float, far: float, scale: float, gx: float, gy: float) -> float:
    """Share of the unit square between two parallel lines, distances times ``scale``: thin strokes need both."""
    return max(box_share(near * scale, gx, gy) + box_share(far * scale, gx, gy) - 1.0, 0.0)


@nb.njit(cache=True, nogil=True)
def rectangle_distance(p: float, q: float, a: float, b: float) -> tuple[float, float, float]:
    """Distance of (p, q) to the rectangle of half sides a, b round the origin (negative inside), and its gradient."""
    sp, sq = abs(p) - a, abs(q) - b
    if sp > 0.0 and sq > 0.0:
        distance = math.hypot(sp, sq)
        gp, gq = sp / distance, sq / distance
    elif sp > sq:
        distance, gp, gq = sp, 1.0, 0.0
    else:
        distance, gp, gq = sq, 0.0, 1.0
    return distance, math.copysign(gp, p), math.copysign(gq, q)


@nb.njit(cache=True, nogil=True)
def paint_decals(
    frame: Array, shape: Array, volume: Ints, boxes: Ints, slot: Ints, ray: Array, n: int, hit: Ints, depth: Array,
    code: Ints, factor: Array, partial: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Multiply factor (S, n*n) by 1 - contrast * coverage of each decal; set partial (S,) near edges.

    frame : (K, 3, 3) centre, first and second direction in the camera's frame; shape : (K, 9) half sides,
    outer, inner radius, contrast, gate (largest distance of the hit point from the centre), curvature ee, ef, ff;
    volume : (K,) code of the decal's volume; code : (T,) code of each triangle's.
    Coverage is that of the sub-pixel's square by the strip between the outline's nearest point and the
    point across: exact up to the outline's curvature within one sub-pixel.
    """
    for d in range(len(frame)):
        c, e, f = frame[d, 0], frame[d, 1], frame[d, 2]
        nx, ny, nz = e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]
        offset = nx * c[0] + ny * c[1] + nz * c[2]
        a, b, outer, inner, contrast, gate = (
            shape[d, 0], shape[d, 1], shape[d, 2], shape[d, 3], shape[d, 4], shape[d, 5],
        )  # fmt: skip
        ee, ef, ff = shape[d, 6], shape[d, 7], shape[d, 8]
        steps = 0 if ee == 0.0 and ef == 0.0 and ff == 0.0 else BENDS
        for y in range(boxes[d, 2], boxes[d, 3] + 1):
            for x in range(boxes[d, 0], boxes[d, 1] + 1):
                s = slot[y, x]
                if s < 0:
                    continue
                for k in range(n * n):
                    if hit[s, k] < 0 or code[hit[s, k]] != volume[d]:
                        continue
                    dx, dy = ((k % n) + 0.5) / n - 0.5, ((k // n) + 0.5) / n - 0.5
                    u = ray[y, x, 0] + ray[y, x, 2] * dx + ray[y, x, 3] * dy
                    v = ray[y, x, 1] + ray[y, x, 4] * dx + ray[y, x, 5] * dy
                    z = depth[s, k]
                    if (z * u - c[0]) ** 2 + (z * v - c[1]) ** 2 + (z - c[2]) ** 2 > gate * gate:
                        continue
                    slant = nx * u + ny * v + nz
                    if slant == 0.0:
                        continue
                    z = offset / slant
                    # In-plane coordinates of the crossing, and the rectangle's distance with its gradient.
                    rx, ry, rz = z * u - c[0], z * v - c[1], z - c[2]
                    p, q = rx * e[0] + ry * e[1] + rz * e[2], rx * f[0] + ry * f[1] + rz * f[2]
                    mx, my, mz = nx, ny, nz  # the surface's own normal at the crossing
                    for _ in range(steps):
                        # Newton along the ray: how far it is above the surface that lies below the plane.
                        above = rx * nx + ry * ny + rz * nz + 0.5 * (ee * p * p + 2 * ef * p * q + ff * q * q)
                        sp, sq = ee * p + ef * q, ef * p + ff * q
                        mx, my, mz = nx + sp * e[0] + sq * f[0], ny + sp * e[1] + sq * f[1], nz + sp * e[2] + sq * f[2]
                        slant = mx * u + my * v + mz
                        z -= above / slant
                        rx, ry, rz = z * u - c[0], z * v - c[1], z - c[2]
                        p, q = rx * e[0] + ry * e[1] + rz * e[2], rx * f[0] + ry * f[1] + rz * f[2]
                    if steps and not slant < 0.0:
                        continue  # behind the surface's horizon
                    distance, gp, gq = rectangle_distance(p, q, a, b)
                    # The same gradient per pixel: plane coordinates by u and v, then u and v by x and y.
                    gu, gv = gp * e[0] + gq * f[0], gp * e[1] + gq * f[1]
                    ge = gu * u + gv * v + gp * e[2] + gq * f[2]
                    gu, gv = z * (gu - ge * mx / slant), z * (gv - ge * my / slant)
                    gx = gu * ray[y, x, 2] + gv * ray[y, x, 4]
                    gy = gu * ray[y, x, 3] + gv * ray[y, x, 5]
                    size = math.hypot(gx, gy)
                    if size == 0.0:
                        continue
                    gx, gy, scale = gx / size, gy / size, n / size
                    cover = slab_share(outer - distance, outer + distance + 2 * min(a, b), scale, gx, gy)
                    if inner >= 0.0:
                        cover -= slab_share(inner - distance, inner + distance + 2 * min(a, b), scale, gx, gy)
                    factor[s, k] *= 1.0 - contrast * cover
                    # The distance is of first order: up to 1.5 px from an edge a pixel is not judged by it.
                    if abs(outer - distance) < 1.5 * size or (inner >= 0.0 and abs(inner - distance) < 1.5 * size):
                        partial[s] = True


@nb.njit(cache=True, nogil=True)
def lattice_noise(xyz: Array, table: Array, per_unit: float) -> Array:
    """(N,) smooth noise: values of a periodic (n, n, n) lattice, blended with smooth steps."""
    n = table.shape[0]
    out = np.empty(len(xyz))
    for s in range(len(xyz)):
        x, y, z = xyz[s, 0] * per_unit, xyz[s, 1] * per_unit, xyz[s, 2] * per_unit
        i, j, k = math.floor(x), math.floor(y), math.floor(z)
        fx, fy, fz = x - i, y - j, z - k
        fx, fy, fz = fx * fx * (3 - 2 * fx), fy * fy * (3 - 2 * fy), fz * fz * (3 - 2 * fz)
        i0, j0, k0 = i % n, j % n, k % n
        i1, j1, k1 = (i + 1) % n, (j + 1) % n, (k + 1) % n
        near = (table[i0, j0, k0] * (1 - fx) + table[i1, j0, k0] * fx) * (1 - fy) + (
            table[i0, j1, k0] * (1 - fx) + table[i1, j1, k0] * fx
        ) * fy
        far = (table[i0, j0, k1] * (1 - fx) + table[i1, j0, k1] * fx) * (1 - fy) + (
            table[i0, j1, k1] * (1 - fx) + table[i1, j1, k1] * fx
        ) * fy
        out[s] = near * (1 - fz) + far * fz
    return out
