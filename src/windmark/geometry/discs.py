"""The image of a disc: an ellipse whose centre is not the image of the disc's centre.

What a detector measures is the centre of the ellipse; what an adjustment wants is where the disc's centre is imaged.
The difference, the eccentricity, is about r^2 sin(2 tilt) / (2 f) pixels for a flat disc of r pixels, and r^2 sin(tilt)
/ (2 R) for one on a sphere of R pixels, whose rim lies below its centre: it is the camera model's business, where
normal, radius and curvature are known, and detectors leave it alone.
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


def imaged_ellipse(
    camera: Camera, xyz_cam: ArrayLike, normal_cam: ArrayLike, radius: ArrayLike, curvature_cam: ArrayLike | None = None
) -> ImagedEllipse:
    """Images of discs that lie flat or on a curved surface.

    Area, first and second moments of the image are integrals along its outline (Green's theorem); the periodic
    trapezoid rule with the outline's derivative by Fourier makes them exact to rounding for the conic of a pinhole
    camera, and nearly so under a lens, which is taken as it is (no local linearisation).

    Parameters
    ----------
    camera : the camera
    xyz_cam, normal_cam : (N, 3) centres and normals in the camera's frame, normals of any length and sign
    radius : (N,) or one number, length unit of xyz_cam
    curvature_cam : (N, 3, 3) second fundamental form of the surface, one over the length unit: what is d away from the
        centre along the tangent plane lies d C d / 2 below it, against the normal. None: flat

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
    form = np.zeros((len(center), 3, 3)) if curvature_cam is None else np.asarray(curvature_cam, dtype=float)
    if form.shape != (len(center), 3, 3):
        raise ValueError(f"imaged_ellipse: curvature_cam must be ({len(center)}, 3, 3), got {form.shape}")
    with np.errstate(invalid="ignore"):
        far = not (r >= FAR * np.linalg.norm(center, axis=1)).any()
    count = FEW_POINTS if far else POINTS
    from windmark.geometry._disc_kernels import image_discs

    total = len(center)
    out = ImagedEllipse(np.empty((total, 2)), np.empty((total, 2)), np.empty((total, 2)), np.empty(total))
    # Views and what may not be written to are of other types, for which the kernel would be compiled anew.
    arrays = (np.require(v, requirements=("C", "W")) for v in (center, normal, np.broadcast_to(r, total), form))
    image_discs(
        camera.packed(), *arrays, _derivative(count), out.xy, out.center_xy, out.axes_px, out.angle
    )  # fmt: skip
    return out


def tangent(normal: Array) -> Array:
    """(N, 3) a unit vector at right angles to each unit normal: the x axis laid into the plane, or y."""
    n = np.asarray(normal, dtype=float)
    reference = np.where(np.abs(n[..., :1]) < 0.9, np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
    a = reference - (reference * n).sum(axis=-1, keepdims=True) * n
    return np.asarray(a / np.linalg.norm(a, axis=-1, keepdims=True))


@cache
def _derivative(count: int) -> Array:
    """Matrix (P, P) of the derivative of a periodic function by its P samples, times the step 2 pi / P."""
    k = np.arange(count)
    apart = k[:, None] - k[None, :]
    sign = np.where(apart % 2 == 0, 1.0, -1.0)
    return np.asarray(np.where(apart == 0, 0.0, 0.5 * sign / np.tan(np.pi * apart / count + (apart == 0)))) * (
        2.0 * np.pi / count
    )
