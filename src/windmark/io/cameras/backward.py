"""The photogrammetric lens model: it corrects measured points, in millimetres.

The middle of the sensor is the origin, x to the right, y *up*; with x' = x - xp, y' = y - yp and
r^2 = x'^2 + y'^2 a measured point becomes the point of a perfect camera with the distance C::

    x_ideal = x' + x' (K1 r^2 + K2 r^4 + K3 r^6) + P1 (r^2 + 2 x'^2) + 2 P2 x' y' + B1 x' + B2 y'
    y_ideal = y' + y' (K1 r^2 + K2 r^4 + K3 r^6) + P2 (r^2 + 2 y'^2) + 2 P1 x' y'

windmark's lens goes the other way (ideal to distorted), and no polynomial's inverse is a polynomial. So
cameras are refitted over the whole sensor, both ways, and the misfit is said: below 0.01 px where the lens
moves the corners by up to about 20 px, 0.1 px (in the corners) at 80 px.

Source: Fraser, "Digital camera self-calibration", ISPRS Journal 52 (1997): Australis, iWitness; PhotoModeler
has the same terms. tests/real/test_camera_formats_real.py holds the signs to a published bundle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import DataError, g2
from windmark.geometry import PARAMETERS, Camera

Array = NDArray[np.float64]

_GRID = (41, 31)
_STEPS = 50
_ABSURD = 1e100  # squares of larger numbers overflow
_FREE = [PARAMETERS.index(p) for p in ("focal_px", "aspect", "cx", "cy", "k1", "k2", "p1", "p2", "k3")]


@dataclass(frozen=True)
class BackwardCamera:
    """A camera with the backward lens model.

    Parameters
    ----------
    size_px : (width, height)
    pixel_mm : pitch of the pixels along x and y
    c : principal distance, mm
    xp, yp : principal point, mm from the middle of the sensor, y up
    k1, k2, k3 : radial, mm^-2, mm^-4, mm^-6
    p1, p2 : decentring, mm^-1
    b1, b2 : affinity, shear
    """

    size_px: tuple[int, int]
    pixel_mm: tuple[float, float]
    c: float
    xp: float = 0.0
    yp: float = 0.0
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    b1: float = 0.0
    b2: float = 0.0

    def unproject(self, xy: ArrayLike) -> Array:
        """Rays of pixels: (..., 2) -> (..., 3) with z = 1 in the camera frame (y down)."""
        ideal = _corrected(self, _millimetres(np.asarray(xy, dtype=float), self.size_px, self.pixel_mm))
        return np.stack([ideal[..., 0] / self.c, -ideal[..., 1] / self.c, np.ones(ideal.shape[:-1])], axis=-1)


@dataclass(frozen=True)
class Refit:
    """How well one lens model stands for the other: distances in pixels over a grid on the whole sensor."""

    rms_px: float
    max_px: float

    def __str__(self) -> str:
        return f"RMS {g2(self.rms_px)} px, largest {g2(self.max_px)} px over the sensor"


def forward_camera(backward: BackwardCamera) -> tuple[Camera, Refit]:
    """The forward camera nearest to a backward one: least squares of the pixels in which the same rays are seen.

    Focal length, aspect, principal point, k1, k2, k3, p1 and p2 are all fitted, the shear where there is a B2.

    Raises
    ------
    ValueError
        Where no forward lens shows all the sensor's rays.
    """
    width, height = backward.size_px
    focal = backward.c / (backward.pixel_mm[0] * (1 + backward.b1))
    aspect = backward.pixel_mm[0] / backward.pixel_mm[1] * (1 + backward.b1)
    cx = (width - 1) / 2 + backward.xp / backward.pixel_mm[0]
    cy = (height - 1) / 2 - backward.yp / backward.pixel_mm[1]
    shear = backward.b2 * backward.pixel_mm[0] * focal / backward.c  # to first order
    start = Camera(backward.size_px, focal, aspect, cx, cy, shear=shear)
    xy = _grid(backward.size_px)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # absurd numbers end as not finite
        rays = backward.unproject(xy)
        distorted = any((backward.k1, backward.k2, backward.k3, backward.p1, backward.p2, backward.b2))
        free = [*_FREE, PARAMETERS.index("shear")] if backward.b2 else _FREE
        camera = _fit(start, rays, xy, free) if distorted else start
        refit = None if camera is None else _misfit(camera.project(rays)[0] - xy)
    if camera is None or refit is None or not np.isfinite(refit.rms_px):
        raise DataError("no lens with k1 k2 p1 p2 k3 shows all rays of the sensor: is the lens one to one there?")
    return camera, refit


def _fit(camera: Camera, rays: Array, xy: Array, free: list[int]) -> Camera | None:
    """Gauss-Newton over the ``free`` `PARAMETERS` from a camera without distortion; None where it does not converge."""
    for _ in range(_STEPS):
        seen, valid, _, jacobian = camera.project_jacobian(rays)
        if not (valid.all() and np.abs(jacobian).max() < _ABSURD):
            return None
        step = _solve(jacobian[..., free].reshape(-1, len(free)), (xy - seen).reshape(-1))
        values = camera.parameters()
        values[free] += step
        if values[0] <= 0 or values[1] <= 0:
            return None
        camera = camera.with_parameters(values)
        if np.abs(jacobian[..., free] @ step).max() < 1e-9:
            return camera
    return None


def backward_camera(camera: Camera, pixel_mm: tuple[float, float]) -> tuple[BackwardCamera, Refit]:
    """The backward camera nearest to a forward one, distances in the corrected image.

    B1 is fitted where the camera's aspect differs from that of the pixels, B2 where it has a shear.

    Raises
    ------
    ValueError
        Where the camera's lens has no inverse on some part of the sensor.
    """
    from scipy.optimize import least_squares

    xy = _grid(camera.size_px)
    rays = camera.unproject(xy)[:, :2]
    if not np.isfinite(rays).all():
        raise DataError("the lens is not one to one over the whole sensor: it cannot be written as a correction")
    pitch = np.array(pixel_mm)
    square = abs(camera.aspect * pitch[1] / pitch[0] - 1) < 1e-12
    size = float(np.linalg.norm(np.array(camera.size_px) * pitch) / 2)  # makes all unknowns about one
    units = np.array([size, size, size, size**-2, size**-4, size**-6, 1 / size, 1 / size, 1.0, 1.0])
    units = units[: 10 if camera.shear else 8 if square else 9]
    mm = _millimetres(xy, camera.size_px, pixel_mm)

    def made(values: Array) -> BackwardCamera:
        return BackwardCamera(camera.size_px, pixel_mm, *(values * units).tolist())

    def misfit(values: Array) -> Array:
        one = made(values)
        return np.asarray((_corrected(one, mm) - rays * np.array([one.c, -one.c])) / pitch)

    middle = (np.array(camera.size_px) - 1) / 2
    start = [camera.focal_px * pitch[0], (camera.cx - middle[0]) * pitch[0], (middle[1] - camera.cy) * pitch[1]]
    first = np.append(np.array(start) / size, np.zeros(len(units) - 3))
    found = least_squares(lambda v: misfit(v).ravel(), first, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return made(found.x), _misfit(misfit(found.x))


def _corrected(camera: BackwardCamera, mm: Array) -> Array:
    x, y = mm[..., 0] - camera.xp, mm[..., 1] - camera.yp
    s = x * x + y * y
    radial = 1 + s * (camera.k1 + s * (camera.k2 + s * camera.k3))
    return np.stack(
        [
            x * (radial + camera.b1) + y * camera.b2 + camera.p1 * (s + 2 * x * x) + 2 * camera.p2 * x * y,
            y * radial + camera.p2 * (s + 2 * y * y) + 2 * camera.p1 * x * y,
        ],
        axis=-1,
    )


def _millimetres(xy: Array, size_px: tuple[int, int], pixel_mm: tuple[float, float]) -> Array:
    """Pixels (centre of the top-left one is (0, 0), y down) -> mm from the middle of the sensor, y up."""
    middle = (np.array(size_px) - 1) / 2
    return np.asarray((xy - middle) * np.array([pixel_mm[0], -pixel_mm[1]]))


def _grid(size_px: tuple[int, int]) -> Array:
    """Pixels spread evenly from border to border, (N, 2)."""
    sides = [np.linspace(-0.5, side - 0.5, count) for side, count in zip(size_px, _GRID, strict=True)]
    return np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)


def _solve(a: Array, b: Array) -> Array:
    """Least squares with columns of one size: focal lengths and k3 differ by many powers of ten."""
    scale = np.linalg.norm(a, axis=0)
    return np.asarray(np.linalg.lstsq(a / scale, b, rcond=None)[0] / scale)


def _misfit(difference: Array) -> Refit:
    distance = np.linalg.norm(difference, axis=-1)
    return Refit(float(np.sqrt(np.mean(distance**2))), float(distance.max()))
