"""The image of a flat disc: an ellipse whose centre is not the image of the disc's centre.

What a detector measures is the centre of the ellipse; what an adjustment wants is where the disc's centre is imaged.
The difference, the eccentricity, is about r^2 sin(2 tilt) / (2 f) pixels for a disc of r pixels: it is the camera
model's business, where normal and radius are known, and detectors leave it alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.camera import Camera

__all__ = ["ImagedEllipse", "imaged_ellipse", "tangent"]

Array = NDArray[np.float64]

POINTS = 32  # on the outline; exact to rounding while radius * sin(tilt) is below a third of the distance
FEW_POINTS, FAR = 12, 0.02  # these are enough, to 1e-10 of the radius, where all radii are below 2 % of the distance


@dataclass(frozen=True)
class ImagedEllipse:
    """N imaged discs; NaN where a part of the outline has no image.

    Parameters
    ----------
    xy : (N, 2) centroid of the disc's image: the ellipse's centre, what a detector measures
    center_xy : (N, 2) image of the disc's centre
    axes_px, angle : (N, 2), (N,) half axes (large first) and direction of the first from x towards y, radians
    """

    xy: Array
    center_xy: Array
    axes_px: Array
    angle: Array

    def __len__(self) -> int:
        return len(self.xy)

    @property
    def eccentricity_px(self) -> Array:
        """Ellipse's centre less image of the disc's centre (N, 2): subtract it from a detected centre."""
        return self.xy - self.center_xy


def imaged_ellipse(camera: Camera, xyz_cam: ArrayLike, normal_cam: ArrayLike, radius: ArrayLike) -> ImagedEllipse:
    """Images of flat discs.

    Area, first and second moments of the image are integrals along its outline (Green's theorem); the periodic
    trapezoid rule with the outline's derivative by Fourier makes them exact to rounding for the conic of a pinhole
    camera, and nearly so under a lens, which is taken as it is (no local linearisation).

    Parameters
    ----------
    camera : the camera
    xyz_cam, normal_cam : (N, 3) centres and normals in the camera's frame, normals of any length and sign
    radius : (N,) or one number, length unit of xyz_cam

    Returns
    -------
    ImagedEllipse
        Seen edge-on the small axis goes to zero and the centre is NaN. Whether a disc faces the camera is not asked.

    Raises
    ------
    ValueError
        For shapes that do not fit each other.
    """
    center, normal = np.asarray(xyz_cam, dtype=float), np.asarray(normal_cam, dtype=float)
    if center.ndim != 2 or center.shape[1] != 3 or normal.shape != center.shape:
        raise ValueError(f"imaged_ellipse: xyz_cam and normal_cam must be (N, 3), got {center.shape}, {normal.shape}")
    r = np.asarray(radius, dtype=float)
    if r.shape not in ((), (len(center),)):
        raise ValueError(f"imaged_ellipse: radius must be one number or {len(center)}, got shape {r.shape}")
    with np.errstate(invalid="ignore"):
        far = bool(np.all(np.nan_to_num(r) < FAR * np.linalg.norm(center, axis=1)))
    count = FEW_POINTS if far else POINTS
    theta = 2.0 * np.pi * np.arange(count) / count
    with np.errstate(divide="ignore", invalid="ignore"):
        n = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    a = tangent(n)
    across = np.cos(theta)[:, None] * a[:, None] + np.sin(theta)[:, None] * np.cross(n, a)[:, None]
    outline, _ = camera.project(center[:, None] + np.broadcast_to(r, len(center))[:, None, None] * across)
    origin = outline.mean(axis=1)
    moment, axes, angle = _ellipse(outline - origin[:, None])
    return ImagedEllipse(origin + moment, camera.project(center)[0], axes, angle)


def tangent(normal: Array) -> Array:
    """(N, 3) a unit vector at right angles to each unit normal: the x axis laid into the plane, or y."""
    n = np.asarray(normal, dtype=float)
    reference = np.where(np.abs(n[..., :1]) < 0.9, np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
    a = reference - (reference * n).sum(axis=-1, keepdims=True) * n
    return np.asarray(a / np.linalg.norm(a, axis=-1, keepdims=True))


def _ellipse(outline: Array) -> tuple[Array, Array, Array]:
    """Centroid (N, 2), half axes (N, 2), direction (N,) of ellipses with the moments of closed outlines (N, P, 2)."""
    x, y = outline[..., 0], outline[..., 1]
    dx, dy = np.moveaxis(_derivative(outline.shape[1]) @ outline, -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        area = 0.5 * (x * dy - y * dx).sum(axis=1)
        first = np.stack([(x * x * dy).sum(axis=1), -(y * y * dx).sum(axis=1)], axis=1) / (2 * area[:, None])
        xx = (x**3 * dy).sum(axis=1) / (3 * area) - first[:, 0] ** 2
        yy = -(y**3 * dx).sum(axis=1) / (3 * area) - first[:, 1] ** 2
        xy = 0.5 * (x * x * y * dy - x * y * y * dx).sum(axis=1) / (2 * area) - first[:, 0] * first[:, 1]
        # A uniform ellipse has the second moments axis^2 / 4.
        middle, spread = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
        axes = 2 * np.sqrt(np.maximum(np.stack([middle + spread, middle - spread], axis=1), 0))
    return first, axes, 0.5 * np.arctan2(2 * xy, xx - yy)


@cache
def _derivative(count: int) -> Array:
    """Matrix (P, P) of the derivative of a periodic function by its P samples, times the step 2 pi / P."""
    k = np.arange(count)
    apart = k[:, None] - k[None, :]
    sign = np.where(apart % 2 == 0, 1.0, -1.0)
    return np.asarray(np.where(apart == 0, 0.0, 0.5 * sign / np.tan(np.pi * apart / count + (apart == 0)))) * (
        2.0 * np.pi / count
    )
