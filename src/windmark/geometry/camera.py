"""The camera: pinhole, aspect, shear, principal point, distortion (Brown-Conrady, rational or fisheye), sensor tilt.

Same meaning and signs as OpenCV (forward model, ideal -> distorted), so cameras can be
exchanged. Sources: Brown (1971); OpenCV calib3d for the tilted sensor and the wide lenses; AIAA 2005-5007
section IV.A for the parameter set.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.geometry.camera_jacobian import point_jacobian, project_jacobian
from windmark.geometry.described import described, numbers
from windmark.geometry.lens import FISHEYE, LENSES, Lens, project, range2, tilt_homography
from windmark.geometry.lens_inverse import fisheye_angles, undistort

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PARAMETERS = (
    "focal_px", "aspect", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "tilt_x", "tilt_y", "k4", "k5", "k6", "shear",
)  # fmt: skip
"""Names and order of a camera's parameters, in Jacobians and covariances."""
PLAIN, WIDE = 11, 14
"""So many of them has a camera with Brown's lens; the other lenses' own follow, and the shear of any."""
LENS_PARAMETERS = {
    "brown": (*PARAMETERS[:PLAIN], "shear"),
    "rational": PARAMETERS,
    "fisheye": ("focal_px", "aspect", "cx", "cy", "k1", "k2", "k3", "tilt_x", "tilt_y", "k4", "shear"),
}
"""The parameters that each lens has; the others are zero."""
_LACKING = {lens: tuple(p for p in PARAMETERS if p not in has) for lens, has in LENS_PARAMETERS.items()}


def _lens_figures(c: Camera) -> str:
    """The model of the lens and what of it is not zero."""
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "tilt_x", "tilt_y", "shear")
    some = [f"{name} {getattr(c, name):.4g}" for name in names if getattr(c, name)]
    return " ".join([c.lens, *some] if some else ["none" if c.lens == "brown" else c.lens])


@described(lambda c: {
    "size px": f"{c.size_px[0]} x {c.size_px[1]}", "focal px": f"{c.focal_px:.6g}", "fov deg": f"{c.fov_deg:.4g}",
    "centre px": numbers([c.cx, c.cy]), "lens": _lens_figures(c), "covariance": "no" if c.cov is None else "yes",
})  # fmt: skip
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
    cov : (15, 15) covariance in the order of `PARAMETERS`, or None; (14, 14) where the shear is known, (11, 11) where
        k4 to k6 are, too, are filled up
    k4, k5, k6 : of a rational lens, OpenCV's meaning; k4 is the last coefficient of a fisheye lens
    lens : "brown", "rational" or "fisheye", see `lens`. With a fisheye lens the focal length is pixels per radian on
        the axis, k1 to k4 belong to the angle (`cv2.fisheye`), and points beyond 90 degrees have images
    shear : of the pixels' axes: x gets ``focal_px * shear`` times the sensor's y. A camera with a digital sensor has
        none; other programs have it (skew; B2 of Australis, b2 of Metashape), and with a sensor's tilt it says the same

    Examples
    --------
    >>> import windmark as wm
    >>> camera = wm.Camera((640, 480), 800.0, k1=-0.1)
    >>> xy, valid = camera.project([[0.0, 0.0, 2.0], [0.1, 0.0, 2.0]])
    >>> xy.round(2).tolist(), valid.tolist()
    ([[319.5, 239.5], [359.49, 239.5]], [True, True])
    >>> camera.unproject(xy).round(6).tolist()
    [[0.0, 0.0, 1.0], [0.05, 0.0, 1.0]]
    >>> round(camera.fov_deg, 1)
    43.6
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
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0
    lens: str = LENSES[0]
    shear: float = 0.0

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
        if self.lens not in LENSES:
            raise UsageError(f"Camera: lens must be one of {', '.join(LENSES)}, got {self.lens!r}")
        for name in _LACKING[self.lens]:
            if getattr(self, name) != 0.0:
                raise ValueError(f"Camera: a {self.lens} lens has no {name}; expected 0, got {getattr(self, name)}")
        if self.cov is not None:
            object.__setattr__(self, "cov", filled_up(self.cov, "Camera: cov"))

    # --- the parameters as an array ------------------------------------------------------
    def parameters(self) -> Array:
        """(15,) parameters in the order of `PARAMETERS`."""
        return np.array([getattr(self, name) for name in PARAMETERS])

    def with_parameters(self, values: ArrayLike, cov: Array | None = None) -> Camera:
        """A camera of the same size and lens with the given (15,) parameters; of (11,) or (14,) the others stay."""
        v = np.asarray(values, dtype=float)
        names = PARAMETERS[: len(v)] if len(v) in (PLAIN, WIDE) else PARAMETERS
        named: dict[str, Any] = dict(zip(names, map(float, v), strict=True))
        return replace(self, **named, cov=cov)

    def packed(self) -> Array:
        """(17,) for kernels: eleven parameters, the lens' `range2`, k4, k5, k6, the number of the lens model, shear."""
        return self._packed.copy()

    @cached_property
    def _packed(self) -> Array:
        p, lens = self.parameters(), self._lens()
        return np.concatenate([p[:PLAIN], [range2(lens)], p[PLAIN:WIDE], [lens.kind], p[WIDE:]])

    @property
    def matrix(self) -> Array:
        """OpenCV's 3x3 camera matrix (without tilt)."""
        f = self.focal_px
        return np.array([[f, f * self.shear, self.cx], [0, f * self.aspect, self.cy], [0, 0, 1.0]])

    @property
    def fov_deg(self) -> float:
        """Full horizontal field of view in degrees without distortion (as in `PoV`); fisheye: width / focal length."""
        if self.lens == "fisheye":
            return float(np.degrees(self.size_px[0] / self.focal_px))
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
        valid : (...) bool: in front of the camera and where the lens model is one to one; a fisheye lens sees
            points behind, too, up to the angle at which its model folds. A valid point may lie outside the image;
            `in_image` tells.
        """
        xyz = _points(xyz_cam, 3, "project")
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            distorted, valid = project(xyz, self._lens())
            xy = self._to_pixels(distorted)
            valid &= np.isfinite(xy).all(axis=-1)
        return np.where(valid[..., None], xy, np.nan), valid

    def project_jacobian(self, xyz_cam: ArrayLike) -> tuple[Array, Mask, Array, Array]:
        """Projection with analytic derivatives.

        Returns
        -------
        xy, valid : as `project`
        d_xyz : (..., 2, 3) derivative with respect to the point
        d_parameters : (..., 2, 15) derivative with respect to `PARAMETERS`
        """
        return project_jacobian(self.parameters(), _points(xyz_cam, 3, "project_jacobian"), self._lens().kind)

    def point_jacobian(self, xyz_cam: ArrayLike) -> tuple[Array, Mask, Array]:
        """Projection with its derivative by the point only: xy, valid and d_xyz of `project_jacobian`."""
        return point_jacobian(self.parameters(), _points(xyz_cam, 3, "point_jacobian"), self._lens().kind)

    def unproject(self, xy: ArrayLike) -> Array:
        """Rays of pixels: (..., 2) -> (..., 3) with z = 1 in the camera frame.

        The distortion is really inverted (safeguarded Newton, to rounding); NaN where the lens
        model has no inverse, that is beyond the radius at which the distorted radius stops growing, and where a
        fisheye lens looks at 90 degrees and more from its axis: no ray there has z = 1 (`directions` has it).
        """
        p = _points(xy, 2, "unproject")
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ideal = self._ideal(self._from_pixels(p))
        return np.concatenate([ideal, np.where(np.isnan(ideal[..., :1]), np.nan, 1.0)], axis=-1)

    def directions(self, xy: ArrayLike) -> Array:
        """Unit vectors of pixels, (..., 2) -> (..., 3), in the camera frame: `unproject`, and beyond 90 degrees too."""
        lens = self._lens()
        if lens.kind != FISHEYE:
            rays = self.unproject(xy)
            return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            q = self._from_pixels(_points(xy, 2, "directions"))
            angle, size = fisheye_angles(q, lens)[..., None], np.linalg.norm(q, axis=-1, keepdims=True)
        across = q / np.where(size > 0, size, 1.0)
        return np.concatenate([across * np.sin(angle), np.cos(angle)], axis=-1)

    def in_image(self, xy: ArrayLike) -> Mask:
        """Whether pixels (..., 2) lie inside the image area, borders included; NaN (no image) does not."""
        p = np.asarray(xy, dtype=float)
        w, h = self.size_px
        with np.errstate(invalid="ignore"):
            inside = (p >= -0.5) & (p <= np.array([w - 0.5, h - 0.5]))
        return np.asarray(inside.all(axis=-1))

    # --- parts ---------------------------------------------------------------------------
    def _ideal(self, distorted: Array) -> Array:
        """`undistort`: in a kernel, a few points take NumPy a millisecond; with care where that finds nothing."""
        lens = self._lens()
        if lens.none or lens.kind == FISHEYE:
            return undistort(distorted, lens)
        from windmark.geometry._ray_kernels import undistort_points

        q = np.ascontiguousarray(distorted.reshape(-1, 2))
        ideal = np.empty_like(q)
        undistort_points(self._packed, q, ideal)
        lost = np.isnan(ideal[:, 0]) & np.isfinite(q).all(axis=1)
        if lost.any():
            ideal[lost] = undistort(q[lost], lens)
        return ideal.reshape(distorted.shape)

    def _lens(self) -> Lens:
        kind = LENSES.index(self.lens)
        return Lens(self.k1, self.k2, self.p1, self.p2, self.k3, self.k4, self.k5, self.k6, kind)

    def _to_pixels(self, distorted: Array) -> Array:
        if self.tilt_x or self.tilt_y:
            distorted = _homography(tilt_homography(self.tilt_x, self.tilt_y), distorted)
        f = np.array([self.focal_px, self.focal_px * self.aspect])
        xy = distorted * f + np.array([self.cx, self.cy])
        if self.shear:
            xy[..., 0] += self.focal_px * self.shear * distorted[..., 1]
        return xy

    def _from_pixels(self, xy: Array) -> Array:
        f = np.array([self.focal_px, self.focal_px * self.aspect])
        p = (xy - np.array([self.cx, self.cy])) / f
        if self.shear:
            p[..., 0] -= self.shear * p[..., 1]
        if self.tilt_x or self.tilt_y:
            p = _homography(np.asarray(np.linalg.inv(tilt_homography(self.tilt_x, self.tilt_y)), dtype=float), p)
        return p


def filled_up(cov: ArrayLike, what: str) -> Array:
    """(15, 15) covariance of a camera; of the first 14 or 11 parameters the others are taken as known."""
    matrix = np.asarray(cov, dtype=float)
    if matrix.shape not in {(n, n) for n in (PLAIN, WIDE, len(PARAMETERS))}:
        shapes = "(15, 15), or (14, 14) without the shear, or (11, 11) without k4 to k6"
        raise ValueError(f"{what} must be {shapes}, got {matrix.shape}")
    lacking = len(PARAMETERS) - len(matrix)
    return np.pad(matrix, (0, lacking)) if lacking else matrix


def _homography(h: Array, p: Array) -> Array:
    """Apply to points (..., 2); NaN beyond the horizon, where the plane's image comes back from the other side."""
    q = p @ h[:, :2].T + h[:, 2]
    return q[..., :2] / np.where(q[..., 2:] > 0, q[..., 2:], np.nan)


def _points(values: ArrayLike, width: int, name: str) -> Array:
    p = np.asarray(values, dtype=float)
    if p.shape[-1:] != (width,):
        raise ValueError(f"Camera.{name}: expected an array (..., {width}), got {p.shape}")
    return p
