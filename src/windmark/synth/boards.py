"""Dot boards as a detector would report them: a perfect board and camera first, what goes wrong on top."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.scene import Detections

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class BoardSpots:
    """Spots of a virtual picture of a board, and the truth.

    Parameters
    ----------
    detections : spots, in random order
    cell : (M, 2) true column and row of each spot; (-1, -1) for false spots
    camera, cam_from_board : that took it; the board's x is along columns, y along rows, z away from the viewer
    places : (rows, columns, 2) where every dot is in the picture without noise, NaN outside the picture
    """

    detections: Detections
    cell: Ints
    camera: Camera
    cam_from_board: Pose
    places: Array


def board_spots(
    rng: np.random.Generator,
    columns: int,
    rows: int,
    *,
    aspect: float = 1.0,
    staggered: bool = False,
    size_px: tuple[int, int] = (2000, 1500),
    focal_px: float | None = None,
    max_tilt_deg: float = 60.0,
    tilt_deg: float | None = None,
    corner_px: float = 20.0,
    fill: float = 0.9,
    missing: float = 0.2,
    clutter: float = 0.5,
    noise_px: float = 0.1,
    large: tuple[tuple[int, int], ...] = (),
) -> BoardSpots:
    """A board seen from a random side.

    Parameters
    ----------
    columns, rows : dots; spacing 1 along columns. A staggered board has dots where column + row is even
    aspect : spacing of rows / spacing of columns
    focal_px : None draws 0.9 to 4 picture widths
    max_tilt_deg, tilt_deg : tilt of the board's normal, drawn from 0 to the largest unless given; roll is any
    corner_px : lens distortion at the picture's corners, pixels, of random sign
    fill : size of the board's picture by that of the picture; above 1 it is seen in part
    missing : share of the dots not found
    clutter : false spots per dot in the picture, uniform; none within 0.3 spacings of a spot that is a dot
    noise_px : 1 sigma per coordinate
    large : cells whose dots have 1.5 times the radius of the others
    """
    i, j = (index.ravel() for index in np.meshgrid(np.arange(columns), np.arange(rows)))
    kept = (i + j) % 2 == 0 if staggered else np.ones(len(i), bool)
    xyz = np.column_stack([i - (columns - 1) / 2, (j - (rows - 1) / 2) * aspect, np.zeros(len(i))])
    focal = float(size_px[0] * np.exp(rng.uniform(np.log(0.9), np.log(4)))) if focal_px is None else focal_px
    k1 = rng.choice([-1, 1]) * corner_px / focal / (np.hypot(*size_px) / 2 / focal) ** 3
    camera = Camera(size_px, focal, k1=float(k1))
    tilt = np.radians(rng.uniform(0, max_tilt_deg) if tilt_deg is None else tilt_deg)
    pose = _pose(rng, camera, xyz[kept], tilt, fill)
    xy, valid = camera.project(pose.apply(xyz))
    inside = valid & camera.in_image(xy)
    places = np.where(inside[:, None], xy, np.nan).reshape(rows, columns, 2)
    spacing = np.sqrt(_cell_area(camera, pose, xyz))
    seen = np.flatnonzero(inside & kept & (rng.random(len(xy)) >= missing))
    false = rng.uniform(-0.5, np.array(size_px) - 0.5, (round(clutter * float((inside & kept).sum())), 2))
    if len(seen) and len(false):
        gap = np.hypot(*(false[:, None] - xy[seen]).transpose(2, 0, 1))
        false = false[(gap > 0.3 * spacing[seen]).all(axis=1)]
    radius = 0.25 * spacing * np.where([(a, b) in large for a, b in zip(i, j, strict=True)], 1.5, 1.0)
    typical = float(np.median(radius[inside])) if inside.any() else 1.0
    cell = np.concatenate([np.column_stack([i, j])[seen], np.full((len(false), 2), -1)])
    spots = np.concatenate([xy[seen] + rng.normal(0, noise_px, (len(seen), 2)), false])
    radii = np.concatenate([radius[seen], typical * np.exp(rng.uniform(-0.5, 0.5, len(false)))])
    order = rng.permutation(len(spots))
    found = Detections.make(spots[order], sigma_px=max(noise_px, 1e-3), radius_px=radii[order])
    return BoardSpots(found, cell[order], camera, pose, places)


def _pose(rng: np.random.Generator, camera: Camera, xyz: Array, tilt: float, fill: float) -> Pose:
    """The board tilted and rolled at random, at the distance where its picture has the wanted size."""
    around, roll = rng.uniform(0, 2 * np.pi, 2)
    turn = Pose.from_rotvec([0, 0, roll], np.zeros(3)).rotation
    lean = Pose.from_rotvec(tilt * np.array([np.cos(around), np.sin(around), 0]), np.zeros(3)).rotation
    seen = xyz @ (lean @ turn).T
    half = np.array(camera.size_px) / 2 / camera.focal_px
    # Largest of |x| / (z + d) = fill * half over all dots, solved for the distance d, then centred once.
    far = float((np.abs(seen[:, :2]) / (fill * half) - seen[:, 2:]).max())
    shift = rng.uniform(-0.5, 0.5, 2) * max(fill - 1.0, 0.05) * half * 2 * far
    return Pose(lean @ turn, np.array([*shift, far]))


def _cell_area(camera: Camera, pose: Pose, xyz: Array) -> Array:
    """Area of a cell of spacing 1 x 1 in the picture, px^2."""
    at = pose.apply(xyz)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(camera.focal_px**2 * np.abs(at @ pose.rotation[:, 2]) / at[:, 2] ** 3)
