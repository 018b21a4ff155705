"""The rays of all pixels of a camera, quickly."""

from __future__ import annotations

import threading
from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.camera import Camera
from windmark.geometry.lens import FISHEYE, tilt_homography

Array = NDArray[np.float64]

KEPT_BYTES = 1 << 26
"""Memory for rays that are kept: two cameras of two megapixels. Those of larger pictures are found anew each time."""


def pixel_rays(camera: Camera, first_row: int, rows: int) -> Array:
    """Rays (rows, width, 2) through the pixel centres of some rows; NaN where the lens model has no inverse.

    The same as the first two columns of `Camera.unproject`, but found from neighbour to neighbour.
    """
    from windmark.geometry import _ray_kernels

    matrix = camera.matrix @ tilt_homography(camera.tilt_x, camera.tilt_y)
    packed = camera.packed()
    # Of a fisheye lens that is the angle's: what is in front of the camera is its whole plane, or less.
    max_s = packed[11] if packed[15] != FISHEYE else np.tan(min(np.sqrt(packed[11]), 0.5 * np.pi * (1 - 1e-9))) ** 2
    plain = not (packed[4:9].any() or packed[12:16].any())
    rays = np.empty((rows, camera.size_px[0], 2))
    _ray_kernels.pixel_rays(np.linalg.inv(matrix), packed, max_s, plain, first_row, rays)
    lost = np.argwhere(np.isnan(rays[..., 0]))
    if len(lost):
        rays[lost[:, 0], lost[:, 1]] = camera.unproject(lost[:, ::-1] + np.array([0, first_row]))[:, :2]
    return rays


def kept_rays(camera: Camera, first_row: int, rows: int) -> Array:
    """`pixel_rays`, found once for all pictures of a camera, as a series maps them. Not to be written into."""
    return _KEPT.of(camera, first_row, rows)


class _Kept:
    """The rays that were asked for last, as far as there is room for them; for threads."""

    def __init__(self) -> None:
        self._rays: OrderedDict[tuple[bytes, tuple[int, int], int, int], Array] = OrderedDict()
        self._lock = threading.Lock()

    def of(self, camera: Camera, first_row: int, rows: int) -> Array:
        key = camera.packed().tobytes(), camera.size_px, first_row, rows
        with self._lock:
            if key in self._rays:
                self._rays.move_to_end(key)
                return self._rays[key]
        found = pixel_rays(camera, first_row, rows)
        if found.nbytes > KEPT_BYTES:
            return found
        with self._lock:
            self._rays[key] = found
            while sum(r.nbytes for r in self._rays.values()) > KEPT_BYTES:
                self._rays.popitem(last=False)
        return found


_KEPT = _Kept()
