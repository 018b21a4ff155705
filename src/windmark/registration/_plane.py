"""The search plane: spots and markers as the hypothesis kernels want them.

Lens distortion and aspect are undone once, for the spots; from there on a marker at (X, Y, Z) in the
camera frame is seen at f (X, Y) / Z. Markers are centred and scaled to unit size, so that no constant
depends on the length unit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.geometry import Camera, Pose
from windmark.registration._hypothesis_kernels import EMPTY, OUT, Model, Picture

Array = NDArray[np.float64]

NEIGHBOURS = 48  # markers looked at in the neighbourhood test
FIRST_SPOTS, PER_MARKER = 40, 1.25
"""Spots come best first: so many at least, and so many per marker, are searched, then twice as many, ..."""
_CELLS = 512  # raster cells along the longer side at most
_COARSE = 4  # raster cells per cell of the image mask


@dataclass(frozen=True)
class Frame:
    """Centre and size of the marker set: ``xyz = centre + scale * unit``."""

    centre: Array
    scale: float

    def pose(self, rotation: Array, translation: Array) -> Pose:
        """cam_from_model of a pose of the unit model."""
        return Pose(rotation, self.scale * translation - rotation @ self.centre)

    def unit(self, pose: Pose) -> tuple[Array, Array]:
        """Rotation and translation of a pose for the unit model."""
        return pose.rotation, pose.apply(self.centre) / self.scale


def unit_model(xyz: Array, normal: Array) -> tuple[Model, Frame]:
    """Markers for the kernels, (N, 3) and (N, 3) with NaN where unknown; N >= 2."""
    centre = xyz.mean(axis=0)
    scale = float(np.sqrt(((xyz - centre) ** 2).sum(axis=1).mean()))
    unit = (xyz - centre) / scale
    known = np.where(np.isfinite(normal).all(axis=1, keepdims=True), normal, 0.0)
    near = _nearest(unit, min(NEIGHBOURS, len(xyz) - 1))
    return Model(unit, np.ascontiguousarray(known), near), Frame(centre, scale)


def to_plane(camera: Camera, xy: Array) -> Array:
    """Ideal pixels (M, 2) of image points: principal point at the origin, square; NaN where the lens has no inverse."""
    return camera.focal_px * camera.unproject(xy)[:, :2]


def picture(camera: Camera, xy: Array, reach_px: float) -> Picture:
    """Spots (M, 2) of an image for the kernels; the raster knows the nearest spot up to ``reach_px`` away.

    Spots must have a finite `to_plane`.
    """
    p = np.ascontiguousarray(to_plane(camera, xy))
    low, high = _bounds(camera, p)
    cell = max(float((high - low).max()) / _CELLS, 0.25)
    shape = np.maximum(1, np.ceil((high - low) / (cell * _COARSE)).astype(int))
    mask = _image_mask(camera, low, cell * _COARSE, shape)
    raster = np.repeat(np.repeat(mask, _COARSE, axis=0), _COARSE, axis=1)
    _splat(raster, p, low, cell, reach_px)
    near = _nearest(p, min(len(p) - 1, 64))
    return Picture(p, local_density(p, camera), near, raster, float(low[0]), float(low[1]), 1 / cell)


def spot_spacing(p: Array) -> float:
    """Median distance to the nearest other spot."""
    return float(np.median(cKDTree(p).query(p, k=2)[0][:, 1]))


def _nearest(points: Array, k: int) -> NDArray[np.int32]:
    """(N, k) indices of the k nearest other points, nearest first."""
    index = cKDTree(points).query(points, k=k + 1)[1].reshape(len(points), k + 1)
    # The point itself comes first, but for coincident points; where it is missing, the farthest goes.
    other = index != np.arange(len(points))[:, None]
    other[other.all(axis=1), -1] = False
    return np.ascontiguousarray(index[other].reshape(len(points), k), dtype=np.int32)


def local_density(xy: Array, camera: Camera) -> Array:
    """(M,) spots per px^2: round each spot (four neighbours) or on average, whichever is more.

    Dust and rivet rows come in clusters; with the average alone they would pass for evidence.
    """
    average = len(xy) / (camera.size_px[0] * camera.size_px[1])
    k = min(4, len(xy) - 1)
    if k < 1:
        return np.full(len(xy), average)
    distance = cKDTree(xy).query(xy, k=k + 1)[0][:, k]
    return np.maximum(average, k / (np.pi * np.maximum(distance, 1e-3) ** 2))


def lead_sizes(spots: int, markers: int) -> list[int]:
    """Numbers of best spots to look at: some, twice as many, ..., all."""
    sizes, n = [], max(FIRST_SPOTS, int(np.ceil(PER_MARKER * markers)))
    while 1.3 * n < spots:
        sizes.append(n)
        n *= 2
    return [*sizes, spots]


def _bounds(camera: Camera, p: Array) -> tuple[Array, Array]:
    """Rectangle of the plane that holds the image's border and all spots."""
    w, h = camera.size_px
    x, y = np.linspace(-0.5, w - 0.5, 33), np.linspace(-0.5, h - 0.5, 33)
    low, high = np.full(33, -0.5), np.full(33, 1.0)
    border = np.concatenate(
        [np.stack(side, axis=-1) for side in ((x, low), (x, high * (h - 0.5)), (low, y), (high * (w - 0.5), y))]
    )
    seen = np.concatenate([to_plane(camera, border), p])
    seen = seen[np.isfinite(seen).all(axis=1)]
    # A border where the lens model ends maps far out; the spots and a generous frame bound it.
    frame = 1.5 * np.array([w, h])
    low2 = np.maximum(seen.min(axis=0), np.minimum(p.min(axis=0), -frame))
    high2 = np.minimum(seen.max(axis=0), np.maximum(p.max(axis=0), frame))
    return low2 - 1.0, high2 + 1.0


def _image_mask(camera: Camera, low: Array, cell: float, shape: NDArray[np.int64]) -> NDArray[np.int32]:
    """EMPTY for the cells that are wholly in the image (all four corners), else OUT."""
    columns, rows = int(shape[0]), int(shape[1])
    x, y = low[0] + cell * np.arange(columns + 1), low[1] + cell * np.arange(rows + 1)
    corners = np.stack([*np.meshgrid(x, y), np.full((rows + 1, columns + 1), camera.focal_px)], axis=-1)
    xy, valid = camera.project(corners)
    inside = valid & camera.in_image(xy)
    inside = inside[:-1, :-1] & inside[1:, :-1] & inside[:-1, 1:] & inside[1:, 1:]
    return np.where(inside, EMPTY, OUT).astype(np.int32)


def _splat(raster: NDArray[np.int32], p: Array, low: Array, cell: float, reach: float) -> None:
    """Write the index of the nearest spot into every cell within reach of one."""
    rows, columns = raster.shape
    best = np.full(raster.shape, reach * reach)
    for j, (u, v) in enumerate(p):
        c0, r0 = (int(np.floor((w - reach - o) / cell)) for w, o in ((u, low[0]), (v, low[1])))
        n = int(np.ceil(2 * reach / cell)) + 2
        c = np.arange(max(c0, 0), min(c0 + n, columns))
        r = np.arange(max(r0, 0), min(r0 + n, rows))
        if not (c.size and r.size):
            continue
        d2 = (low[0] + (c + 0.5) * cell - u) ** 2 + ((low[1] + (r + 0.5) * cell - v) ** 2)[:, None]
        box = np.s_[r[0] : r[-1] + 1, c[0] : c[-1] + 1]
        closer = d2 < best[box]
        best[box][closer] = d2[closer]
        raster[box][closer] = j
