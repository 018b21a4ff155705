"""Numba kernels on points and triangles: into the camera, values between nodes, sides and angles.

Readable twins: `Pose.apply`, `Camera.project`, `Mesh.vertex_normals`, and brute force in
tests/resection/resection_shapes.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb
from windmark.geometry._kernels import project_point, to_camera
from windmark.resection.reasons import LENS, OUTSIDE, VISIBLE

Array = NDArray[np.float64]
Ints = NDArray[np.int32]
Floats3 = tuple[float, float, float]


@nb.njit(cache=True, nogil=True)
def transform(rotation: Array, translation: Array, points: Array, out: Array) -> None:
    """Points (N, 3) turned and moved."""
    for n in range(points.shape[0]):
        out[n, 0], out[n, 1], out[n, 2] = to_camera(rotation, translation, points[n, 0], points[n, 1], points[n, 2])


@nb.njit(cache=True, nogil=True)
def look(rotation: Array, translation: Array, camera: Array, size: Array, points: Array, cam: Array, xy: Array,
         state: NDArray[np.uint8]) -> None:  # fmt: skip
    """Camera coordinates and pixels of points (N, 3), and whether they are in the picture (VISIBLE, OUTSIDE, LENS)."""
    for n in range(points.shape[0]):
        x, y, z = to_camera(rotation, translation, points[n, 0], points[n, 1], points[n, 2])
        cam[n, 0], cam[n, 1], cam[n, 2] = x, y, z
        px, py, ok = project_point(camera, x, y, z)
        xy[n, 0], xy[n, 1] = px, py
        # A fisheye lens sees behind the plane through the camera, where rays are not cast.
        if ok and z > 0.0:
            inside = px >= -0.5 and py >= -0.5 and px <= size[0] - 0.5 and py <= size[1] - 0.5
            state[n] = VISIBLE if inside else OUTSIDE
        else:
            state[n] = LENS if z > 0.0 or ok else OUTSIDE


@nb.njit(cache=True, nogil=True)
def interpolate(triangles: Ints, values: Array, triangle: Ints, weights: Array, out: Array) -> None:
    """Node values (V, K) at points given by triangle (N,) and weights (N, 2); NaN where triangle is -1."""
    for n in range(triangle.shape[0]):
        t = triangle[n]
        for m in range(values.shape[1]):
            if t < 0:
                out[n, m] = math.nan
            else:
                a = values[triangles[t, 0], m]
                out[n, m] = (
                    a
                    + weights[n, 0] * (values[triangles[t, 1], m] - a)
                    + weights[n, 1] * (values[triangles[t, 2], m] - a)
                )


@nb.njit(cache=True, nogil=True)
def distance_behind(cam: Array, triangles: Ints, points: Array, triangle: Ints, out: Array) -> None:
    """Distance of points (N, 3) behind the planes of the triangles (N,) they were tested against.

    Positive on the far side as seen from the camera; -inf where there is no triangle (-1). All in the camera frame.
    """
    for n in range(points.shape[0]):
        out[n] = -math.inf
        t = triangle[n]
        if t < 0:
            continue
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        normal, _ = _normal_of(cam, i, j, k)
        length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        away = (
            normal[0] * (points[n, 0] - cam[i, 0])
            + normal[1] * (points[n, 1] - cam[i, 1])
            + normal[2] * (points[n, 2] - cam[i, 2])
        )
        camera_side = -(normal[0] * cam[i, 0] + normal[1] * cam[i, 1] + normal[2] * cam[i, 2])
        if length > 0.0:
            out[n] = -away / length if camera_side > 0.0 else away / length


@nb.njit(cache=True, nogil=True)
def sight_cosines(cam: Array, triangles: Ints, points: Array, triangle: Ints, out: Array) -> None:
    """Cosine between the normal of each point's triangle and the line from the point to the camera; NaN for none."""
    for n in range(points.shape[0]):
        out[n] = math.nan
        t = triangle[n]
        if t >= 0:
            m, _ = _normal_of(cam, triangles[t, 0], triangles[t, 1], triangles[t, 2])
            x, y, z = points[n, 0], points[n, 1], points[n, 2]
            lengths = math.sqrt((m[0] ** 2 + m[1] ** 2 + m[2] ** 2) * (x * x + y * y + z * z))
            if lengths > 0.0:
                out[n] = -(m[0] * x + m[1] * y + m[2] * z) / lengths


@nb.njit(cache=True, nogil=True)
def node_normals(cam: Array, triangles: Ints, normals: Array, faces: NDArray[np.uint8]) -> None:
    """Area-weighted sum of the normals round each node (V, 3), started at 0, in the camera frame.

    ``faces`` (V,), started at 0: 1 for a node in a triangle, 2 where one of its triangles faces the camera.
    """
    for t in range(triangles.shape[0]):
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        n, sight = _normal_of(cam, i, j, k)
        face = np.uint8(2) if sight < 0.0 else np.uint8(1)
        for m in range(3):
            v = triangles[t, m]
            normals[v, 0] += n[0]
            normals[v, 1] += n[1]
            normals[v, 2] += n[2]
            faces[v] = max(faces[v], face)


@nb.njit(cache=True, nogil=True)
def _normal_of(cam: Array, i: int, j: int, k: int) -> tuple[Floats3, float]:
    """Normal of a triangle (length = twice the area) and its product with the line of sight (< 0: it faces us)."""
    x, y, z = cam[i, 0], cam[i, 1], cam[i, 2]
    ex, ey, ez = cam[j, 0] - x, cam[j, 1] - y, cam[j, 2] - z
    fx, fy, fz = cam[k, 0] - x, cam[k, 1] - y, cam[k, 2] - z
    n = (ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx)
    return n, n[0] * x + n[1] * y + n[2] * z


@nb.njit(cache=True, nogil=True)
def silhouette(
    cam: Array, triangles: Ints, triangle: Ints, weights: Array, step: float, out: NDArray[np.bool_]
) -> None:
    """Mark pixels (H, W), started False, whose right or lower neighbour is across a silhouette, and that neighbour.

    ``step`` is the smallest depth of a step that counts, per unit of depth.
    """
    height, width = triangle.shape
    for i in range(height):
        for j in range(width):
            for m in range(2):
                k, n = i + m, j + 1 - m
                if k >= height or n >= width or triangle[i, j] == triangle[k, n]:
                    continue
                t, s = triangle[i, j], triangle[k, n]
                apart = t < 0 or s < 0
                if not apart:
                    p = _point_of(cam, triangles, t, weights[i, j, 0], weights[i, j, 1])
                    q = _point_of(cam, triangles, s, weights[k, n, 0], weights[k, n, 1])
                    # Across a crease one of the two is near the other's plane, however oblique the view.
                    least = min(_off_plane(cam, triangles, t, q), _off_plane(cam, triangles, s, p))
                    apart = least > step * min(p[2], q[2])
                if apart:
                    out[i, j] = True
                    out[k, n] = True


@nb.njit(cache=True, nogil=True)
def _point_of(cam: Array, triangles: Ints, t: int, wb: float, wc: float) -> Floats3:
    i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    wa = 1.0 - wb - wc
    return (
        wa * cam[i, 0] + wb * cam[j, 0] + wc * cam[k, 0],
        wa * cam[i, 1] + wb * cam[j, 1] + wc * cam[k, 1],
        wa * cam[i, 2] + wb * cam[j, 2] + wc * cam[k, 2],
    )


@nb.njit(cache=True, nogil=True)
def _off_plane(cam: Array, triangles: Ints, t: int, point: Floats3) -> float:
    """Distance of a point from the plane of a triangle."""
    i = triangles[t, 0]
    n, _ = _normal_of(cam, i, triangles[t, 1], triangles[t, 2])
    along = n[0] * (point[0] - cam[i, 0]) + n[1] * (point[1] - cam[i, 1]) + n[2] * (point[2] - cam[i, 2])
    length = math.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
    return abs(along) / length if length > 0.0 else 0.0
