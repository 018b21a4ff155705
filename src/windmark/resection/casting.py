"""First hits of camera rays on a mesh: the one operation that pixel maps, visibility and virtual images share.

All rays start at the camera, so a ray is a point (u, v) = (X/Z, Y/Z) of the ideal image plane. The
rays are binned on a grid over that plane and every triangle visits the bins under it: a z-buffer
whose samples lie exactly where they are wanted, at pixel centres or at nodes. There is no raster in
between, hence no depth bias and no speckle from one. Source: Johnson, Lee, Burns and Mark, "The
irregular Z-buffer", ACM Transactions on Graphics 24 (2005).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose

Array = NDArray[np.float64]

# Rays handled at a time: bounds the working memory (about 100 bytes a ray) whatever the image's size.
RAYS_AT_ONCE = 1 << 21


@dataclass(frozen=True)
class Hits:
    """What the rays met first.

    Parameters
    ----------
    triangle : (N,) int32, -1 where nothing was met
    weights : (N, 2) barycentric weights of the triangle's second and third vertex, NaN where nothing
    """

    triangle: NDArray[np.int32]
    weights: Array

    @staticmethod
    def none(count: int) -> Hits:
        """``count`` rays that have met nothing yet."""
        return Hits(np.full(count, -1, np.int32), np.full((count, 2), np.nan))

    def part(self, which: slice) -> Hits:
        """A view of some of them."""
        return Hits(self.triangle[which], self.weights[which])


def cast(
    vertices_cam: Array,
    triangles: NDArray[np.int32],
    rays: Array,
    *,
    cull_backfaces: bool = False,
    into: Hits | None = None,
) -> Hits:
    """First hits of rays from the origin.

    Parameters
    ----------
    vertices_cam : (V, 3) in the camera frame
    triangles : (T, 3)
    rays : (N, 2) directions (u, v, 1); a NaN ray meets nothing
    cull_backfaces : look through triangles whose normal points away from the camera
    into : `Hits.none` to be filled, made here if not given

    Notes
    -----
    Surfaces in front of the camera count (z > 0), whatever their orientation; a triangle through the
    camera plane counts with its front part. Triangles without area and triangles seen exactly edge-on
    are met by no ray. Of triangles at exactly the same depth the first one that faces the camera is taken, or else the
    first one.
    """
    hits = Hits.none(len(rays)) if into is None else into
    triangles = for_kernels(triangles)
    for first in range(0, len(rays), RAYS_AT_ONCE):
        part = slice(first, first + RAYS_AT_ONCE)
        _cast_part(vertices_cam, triangles, rays[part], cull_backfaces, hits.part(part))
    return hits


def _cast_part(
    vertices_cam: Array,
    triangles: NDArray[np.int32],
    rays: Array,
    cull: bool,
    hits: Hits,
    place: NDArray[np.int64] | None = None,
) -> None:
    """Cast rays that are a part of those of ``hits``, at ``place`` (None: all of them)."""
    from windmark.resection import _kernels

    count, *box = _kernels.ray_box(rays)
    if not count:
        return
    grid, columns, rows = _grid_over(np.array(box[:2]), np.array(box[2:]), count)
    start, order, binned = np.zeros(rows * columns + 1, np.int64), np.empty(count, np.int64), np.empty((count, 2))
    _kernels.bin_rays(rays, grid, columns, start, order, binned)
    if _crowded(start):
        # Nodes may crowd in a corner of the picture; halves have grids that fit them better.
        axis = int(np.argmax(np.array(box[2:]) - np.array(box[:2])))
        low = rays[:, axis] < np.median(binned[:, axis])
        if low.any():
            for half in (np.flatnonzero(low), np.flatnonzero(~low)):
                part = half if place is None else place[half]
                _cast_part(vertices_cam, triangles, rays[half], cull, hits, part)
            return
    depth = np.full(count, np.inf)
    order = order if place is None else place[order]
    _kernels.first_hits(
        vertices_cam, triangles, binned, order, grid, columns, start, cull, depth, hits.triangle, hits.weights
    )


def _crowded(start: NDArray[np.int64]) -> bool:
    """Whether the cell of a typical ray holds many other rays, so that triangles would test far too many."""
    occupancy = np.diff(start)
    return bool(start[-1] > 1024 and occupancy @ occupancy > 32 * start[-1])


def _grid_over(low: Array, high: Array, count: int) -> tuple[Array, int, int]:
    """About square cells, two rays to each, over a box: (u0, v0, cells per unit u, per unit v), columns, rows."""
    # Rays on a line (or one ray alone) still get a grid with an area.
    extent = np.maximum(high - low, 1e-6 * np.maximum((high - low).max(), 1e-6))
    cell = np.sqrt(2 * extent.prod() / count)
    columns, rows = (int(n) for n in np.clip(np.ceil(extent / cell), 1, count + 1))
    return np.array([low[0], low[1], columns / extent[0], rows / extent[1]]), columns, rows


def for_kernels(triangles: NDArray[np.int32]) -> NDArray[np.int32]:
    """Triangles in the one layout that the kernels are compiled for; seldom a copy."""
    return np.ascontiguousarray(triangles, dtype=np.int32)


def to_camera_frame(cam_from_model: Pose, points: Array) -> Array:
    """`Pose.apply` for many points, (N, 3)."""
    from windmark.resection import _points

    out = np.empty((len(points), 3))
    _points.transform(cam_from_model.rotation, cam_from_model.translation, np.ascontiguousarray(points, float), out)
    return out


def single_pose(cam_from_model: Pose, verb: str) -> Pose:
    """The pose, if it is one pose and not a batch of them."""
    if not isinstance(cam_from_model, Pose) or cam_from_model.rotation.ndim != 2:
        raise ValueError(f"{verb}: cam_from_model must be a single Pose, got {_describe(cam_from_model)}")
    return cam_from_model


def _describe(value: object) -> str:
    if isinstance(value, Pose):
        return f"a batch of shape {value.rotation.shape[:-2]}"
    return type(value).__name__
