"""The camera: pinhole, aspect, principal point, Brown-Conrady distortion, sensor tilt.

Same meaning and signs as OpenCV (forward model, ideal -> distorted), so cameras can be
exchanged. Sources: Brown (1971); OpenCV calib3d for the tilted sensor; AIAA 2005-5007
section IV.A for the parameter set.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.camera_jacobian import point_jacobian, project_jacobian
from windmark.geometry.lens import distort, max_radius2, tilt_homography, undistort

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PARAMETERS = ("focal_px", "aspect", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "tilt_x", "tilt_y")
"""Names and order of a camera's parameters, in Jacobians, covariances and kernels."""


@dataclass(frozen=True)
class Camera:
    """Interior parameters of one camera.

    Parameters
    ----------
    size_px : (width, height)
    focal_px : focal length along x, pixels
    aspect : fy / fx
    cx, cy : principal point, pixels; the centre of the top-left pixel is (0, 0)
    k1, k2, k3, p1, p2 : distortion, OpenCV's meaning
    tilt_x, tilt_y : sensor tilts in radians, OpenCV's tau_x, tau_y
    cov : (11, 11) covariance in the order of `PARAMETERS`, or None
    """

    size_px: tuple[int, int]
    focal_px: float
    aspect: float = 1.0
    cx: float = float("nan")
    cy: float = float("nan")
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    tilt_x: float = 0.0
    tilt_y: float = 0.0
    cov: Array | None = None

    def __post_init__(self) -> None:
        size = np.asarray(self.size_px, dtype=float)
        if size.shape != (2,) or not (size > 0).all() or (size != np.floor(size)).any():
            raise ValueError(f"Camera: size_px must be two whole numbers (width, height) > 0, got {self.size_px}")
        width, height = int(size[0]), int(size[1])
        object.__setattr__(self, "size_px", (width, height))
        # The natural default of the principal point is the centre of the image.
        if np.isnan(self.cx):
            object.__setattr__(self, "cx", (width - 1) / 2)
        if np.isnan(self.cy):
            object.__setattr__(self, "cy", (height - 1) / 2)
        for name in PARAMETERS:
            value = float(getattr(self, name))
            if not np.isfinite(value):
                raise ValueError(f"Camera: {name} must be finite, got {value}")
            object.__setattr__(self, name, value)
        if self.focal_px <= 0 or self.aspect <= 0:
            raise ValueError(f"Camera: focal_px and aspect must be > 0, got {self.focal_px} and {self.aspect}")
        if self.cov is not None and np.shape(self.cov) != (len(PARAMETERS),) * 2:
            raise ValueError(f"Camera: cov must be (11, 11), got {np.shape(self.cov)}")

    # --- the parameters as an array ------------------------------------------------------
    def parameters(self) -> Array:
        """The eleven parameters in the order of `PARAMETERS`."""
        return np.array([getattr(self, name) for name in PARAMETERS])

    def with_parameters(self, values: ArrayLike, cov: Array | None = None) -> Camera:
        """A camera of the same size with the given eleven parameters."""
        v = np.asarray(values, dtype=float)
        named: dict[str, Any] = dict(zip(PARAMETERS, map(float, v), strict=True))
        return replace(self, **named, cov=cov)

    def packed(self) -> Array:
        """(12,): the parameters and the squared ideal radius up to which the lens is one to one; for kernels."""
        return self._packed.copy()

    @cached_property
    def _packed(self) -> Array:
        return np.append(self.parameters(), max_radius2(self.k1, self.k2, self.k3))

    @property
    def matrix(self) -> Array:
        """OpenCV's 3x3 camera matrix (without tilt)."""
        return np.array([[self.focal_px, 0, self.cx], [0, self.focal_px * self.aspect, self.cy], [0, 0, 1.0]])

    @property
    def fov_deg(self) -> float:
        """Full horizontal field of view in degrees, distortion ignored (as in `PoV`)."""
        return float(np.degrees(2 * np.arctan(self.size_px[0] / (2 * self.focal_px))))

    # --- projection ----------------------------------------------------------------------
    def project(self, xyz_cam: ArrayLike) -> tuple[Array, Mask]:
        """Project points of the camera frame.

        Parameters
        ----------
        xyz_cam : (..., 3)

        Returns
        -------
        xy : (..., 2) pixels, NaN where not valid
        valid : (...) bool: in front of the camera and where the lens model is one to one. A valid
            point may lie outside the image; `in_image` tells.
        """
        xyz = _points(xyz_cam, 3, "project")
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ideal = xyz[..., :2] / xyz[..., 2:]
            distorted, valid = distort(ideal, *self._lens())
            xy = self._to_pixels(distorted)
            valid &= (xyz[..., 2] > 0) & np.isfinite(xy).all(axis=-1)
        return np.where(valid[..., None], xy, np.nan), valid

    def project_jacobian(self, xyz_cam: ArrayLike) -> tuple[Array, Mask, Array, Array]:
        """Projection with analytic derivatives.

        Returns
        -------
        xy, valid : as `project`
        d_xyz : (..., 2, 3) derivative with respect to the point
        d_parameters : (..., 2, 11) derivative with respect to `PARAMETERS`
        """
        return project_jacobian(self.parameters(), _points(xyz_cam, 3, "project_jacobian"))

    def point_jacobian(self, xyz_cam: ArrayLike) -> tuple[Array, Mask, Array]:
        """Projection with its derivative by the point only: xy, valid and d_xyz of `project_jacobian`."""
        return point_jacobian(self.parameters(), _points(xyz_cam, 3, "point_jacobian"))

    def unproject(self, xy: ArrayLike) -> Array:
        """Rays of pixels: (..., 2) -> (..., 3) with z = 1 in the camera frame.

        The distortion is really inverted (safeguarded Newton, to rounding); NaN where the lens
        model has no inverse, that is beyond the radius at which the distorted radius stops growing.
        """
        p = _points(xy, 2, "unproject")
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ideal = undistort(self._from_pixels(p), *self._lens())
        return np.concatenate([ideal, np.where(np.isnan(ideal[..., :1]), np.nan, 1.0)], axis=-1)

    def in_image(self, xy: ArrayLike) -> Mask:
        """Whether pixels (..., 2) lie inside the image area, borders included; NaN (no image) does not."""
        p = np.asarray(xy, dtype=float)
        w, h = self.size_px
        with np.errstate(invalid="ignore"):
            inside = (p >= -0.5) & (p <= np.array([w - 0.5, h - 0.5]))
        return np.asarray(inside.all(axis=-1))

    # --- parts ---------------------------------------------------------------------------
    def _lens(self) -> tuple[float, float, float, float, float]:
        return self.k1, self.k2, self.p1, self.p2, self.k3

    def _to_pixels(self, distorted: Array) -> Array:
        if self.tilt_x or self.tilt_y:
            distorted = _homography(tilt_homography(self.tilt_x, self.tilt_y), distorted)
        f = np.array([self.focal_px, self.focal_px * self.aspect])
        return distorted * f + np.array([self.cx, self.cy])

    def _from_pixels(self, xy: Array) -> Array:
        f = np.array([self.focal_px, self.focal_px * self.aspect])
        p = (xy - np.array([self.cx, self.cy])) / f
        if self.tilt_x or self.tilt_y:
            p = _homography(np.asarray(np.linalg.inv(tilt_homography(self.tilt_x, self.tilt_y)), dtype=float), p)
        return p


def _homography(h: Array, p: Array) -> Array:
    """Apply to points (..., 2); NaN beyond the horizon, where the plane's image comes back from the other side."""
    q = p @ h[:, :2].T + h[:, 2]
    return q[..., :2] / np.where(q[..., 2:] > 0, q[..., 2:], np.nan)


def _points(values: ArrayLike, width: int, name: str) -> Array:
    p = np.asarray(values, dtype=float)
    if p.shape[-1:] != (width,):
        raise ValueError(f"Camera.{name}: expected an array (..., {width}), got {p.shape}")
    return p
