"""Views and their spots as the kernels want them: ideal coordinates, stations, borders, densities, a raster."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.epipolar._kernels.arrays import Spots, Stations
from windmark.geometry import Camera, Pose
from windmark.scene import Detections

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

NEIGHBOURS = 8
"""Spots whose distance tells the local density."""
BORDER = 64
"""Places along each side of the picture that are followed through the lens."""
SPAN = 5.0
"""Points are looked for from so many times nearer to so many times farther than where the lines of sight meet."""


def ideal_spots(detections: Sequence[Detections], cameras: Sequence[Camera]) -> tuple[Array, Array]:
    """Ideal coordinates (S, 2) of all spots and their covariance (S, 3); NaN where the lens has no inverse."""
    pixels, pixel_cov = (np.concatenate([getattr(d, name) for d in detections]) for name in ("xy", "cov"))
    whose = np.repeat([id(camera) for camera in cameras], [len(d) for d in detections])
    xy, cov = np.empty((len(pixels), 2)), np.empty((len(pixels), 3))
    for camera in {id(c): c for c in cameras}.values():  # most views have the same one
        mine = whose == id(camera)
        rays = camera.unproject(pixels[mine])
        known = np.asarray(np.isfinite(rays).all(axis=1))
        _, _, d_xyz, _ = camera.project_jacobian(np.where(known[:, None], rays, [0.0, 0.0, 1.0]))
        back = np.linalg.inv(d_xyz[:, :, :2])
        c = back @ pixel_cov[mine] @ back.transpose(0, 2, 1)
        xy[mine], cov[mine] = rays[:, :2], np.stack([c[:, 0, 0], c[:, 0, 1], c[:, 1, 1]], axis=1)
    return xy, cov


def stations(
    cameras: Sequence[Camera],
    poses: Pose,
    pose_cov: Array,
    depth_range: tuple[float, float] | None,
    about: Array | None,
) -> tuple[Stations, Array]:
    """The stations, and for each view the depth (V,) of the scene's middle.

    ``about`` (N, 3) are points near which all others are, or None.
    """
    middle, spread = _middle(poses) if about is None else (about.mean(axis=0), float(np.ptp(about, axis=0).max()))
    depth = poses.rotation[:, 2] @ middle + poses.translation[:, 2]
    if depth_range is not None:
        near, far = (np.full(len(depth), float(value)) for value in depth_range)
        depth = np.where(
            (depth > near) & (depth < far), depth, np.where(np.isfinite(far), 0.5 * (near + far), 2 * near)
        )
    elif about is not None:
        near, far = np.maximum(depth - spread, depth / SPAN), depth + spread
    else:
        near, far = depth / SPAN, depth * SPAN
    border = {id(camera): _borders(camera) for camera in cameras}  # most views have the same one
    low, high = zip(*[border[id(camera)] for camera in cameras], strict=True)
    towards = middle - poses.center
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    order = np.argsort(-(towards @ towards.T) - 2 * np.eye(len(depth)), axis=1, kind="stable")
    rotation, translation = (np.ascontiguousarray(a) for a in (poses.rotation, poses.translation))
    return (
        Stations(
            rotation, translation, np.ascontiguousarray(poses.center), np.ascontiguousarray(pose_cov),
            np.array(low), np.array(high), near, far, order,
        ),
        depth,
    )  # fmt: skip


def _middle(poses: Pose) -> tuple[Array, float]:
    """Where the lines of sight come closest to each other; their spread there."""
    axis, center = poses.rotation[:, 2], poses.center
    across = np.eye(3) - axis[:, :, None] * axis[:, None, :]
    base = np.linalg.norm(center - center.mean(axis=0), axis=1).max()
    # Lines that hardly meet: some ten times the base away.
    weak = 1e-3 * np.eye(3)
    guess = center.mean(axis=0) + 10 * base * axis.mean(axis=0)
    middle = np.linalg.solve(across.sum(axis=0) + weak, np.einsum("vij,vj->i", across, center) + weak @ guess)
    ahead = np.einsum("vi,vi->v", axis, middle - center)
    return (middle if (ahead > 0).all() else guess), float(base)


def _borders(camera: Camera) -> tuple[Array, Array]:
    """Least and largest ideal coordinates in the picture."""
    w, h = camera.size_px
    s = np.linspace(0, 1, BORDER)
    x, y = np.concatenate([s, s, 0 * s, 0 * s + 1]), np.concatenate([0 * s, 0 * s + 1, s, s])
    rays = camera.unproject(np.stack([x * w - 0.5, y * h - 0.5], axis=1))[:, :2]
    return np.nanmin(rays, axis=0), np.nanmax(rays, axis=0)


def raster(xy: Array, cov: Array, count: Ints, free: Mask) -> Spots:
    """All spots (S,) of the views with ``count`` (V,) each; densities are those of the ``free`` ones."""
    views = len(count)
    start = np.concatenate([[0], np.cumsum(count)])
    view = np.repeat(np.arange(views), count)
    base, shape, origin, cell = np.zeros(views, int), np.ones((views, 2), int), np.zeros((views, 2)), np.ones(views)
    density, number, total = np.full(len(xy), 1e-300), np.zeros(len(xy), int), 0
    crowd, widest = np.full(views, 1e-300), np.zeros(views)
    for v in range(views):
        mine = np.arange(start[v], start[v + 1])
        base[v] = total
        if len(mine):
            low, extent = xy[mine].min(axis=0), np.maximum(np.ptp(xy[mine], axis=0), 1e-9)
            cell[v] = max(np.sqrt(extent.prod() / len(mine)), extent.max() / 500)
            origin[v], shape[v] = low, (extent // cell[v]).astype(int) + 1
            place = np.minimum(((xy[mine] - low) / cell[v]).astype(int), shape[v] - 1)
            number[mine] = total + place[:, 1] * shape[v, 0] + place[:, 0]
            density[mine] = local_density(xy[mine], free[mine], float(extent.prod()))
            crowd[v], widest[v] = density[mine].max(), cov[mine][:, [0, 2]].max()
        total += int(shape[v].prod())
    member = np.argsort(number, kind="stable")
    first = np.searchsorted(number[member], np.arange(total + 1))
    return Spots(view, start, xy, cov, density, crowd, widest, base, shape, origin, cell, first, member)


def local_density(xy: Array, free: Mask, area: float) -> Array:
    """Density of the free spots round each of (M, 2); at least that over the whole area."""
    count = int(free.sum())
    least = max(count, 1) / area
    if count <= NEIGHBOURS:
        return np.full(len(xy), least)
    reach = cKDTree(xy[free]).query(xy, NEIGHBOURS + 1)[0][:, -1]
    return np.maximum(NEIGHBOURS / (np.pi * np.maximum(reach, 1e-9) ** 2), least)
