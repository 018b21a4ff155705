"""The arrays that the kernels of a network work on, by name."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

INTERIOR = 15
"""Parameters of a camera."""
CHANGE = 3
"""By what a view may differ from its camera: relative change of the focal length, shift of the principal point."""
SHARED = INTERIOR + 6 + 6 + CHANGE
"""Dense parameters of a view at most: camera, rig member, frame, change."""
ROOM = SHARED + 3
"""The same with a point."""


class Marks(NamedTuple):
    """O observations, ordered by view."""

    views: Ints  # (O,)
    points: Ints  # (O,)
    starts: Ints  # (V + 1,) where the marks of each view begin
    xy: Array  # (O, 2)
    white: Array  # (O, 3): the whitener's xx, yx, yy
    shift: Array  # (O, 2) added to every projection: the disc's eccentricity


class Scene(NamedTuple):
    """Everything a projection needs."""

    camera: Array  # (C, 17) packed
    tilt: Array  # (C, 3, 3, 3): homography of the tilted sensor and its derivatives by the two angles
    view_camera: Ints  # (V,)
    view_frame: Ints  # (V,)
    view_offset: Ints  # (V,), -1: none
    change: Array  # (V, 3) factor on the focal length, shift of the principal point (px)
    frame_r: Array  # (F, 3, 3)
    frame_t: Array  # (F, 3)
    offset_r: Array  # (A, 3, 3)
    offset_t: Array  # (A, 3)
    xyz: Array  # (N, 3)


class Units(NamedTuple):
    """Natural units: what a step of one means."""

    camera: Array  # (C, 15)
    change: Array  # (V, 3)
    frame_pivot: Array  # (F, 3) in the frame's target system; rotations turn about it
    frame_scale: Array  # (F,)
    offset_pivot: Array  # (A, 3)
    offset_scale: Array  # (A,)
    point: float


class Columns(NamedTuple):
    """Where the free parameters stand: dense columns, and eliminated blocks; -1 where there is none."""

    camera: Ints  # (C, 15)
    offset: Ints  # (A,)
    frame: Ints  # (F,)
    change: Ints  # (V, 3)
    point: Ints  # (N,)
    frame_block: Ints  # (F,)
    point_block: Ints  # (N,)
    held: NDArray[np.bool_]  # (N, 3) coordinates that do not move


class Equations(NamedTuple):
    """Where the sums go: dense by dense (upper triangle), eliminated by dense, eliminated blocks, gradients."""

    h_dd: Array
    h_ed: Array
    h_ee: Array
    g_d: Array
    g_e: Array
