"""Rigid poses (SE(3)) and their name in the paper, the point of view."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import DataError, UsageError, g2
from windmark.geometry import rotations
from windmark.geometry.described import described, numbers

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PoV:
    """The paper's point of view: angles in degrees, distances in the length unit.

    ``R = Rz(rz) Ry(ry) Rx(rx)``, ``t = (dx, dy, dz)``; ``fov_deg`` is the full horizontal
    field of view, NaN where no camera was given. Source: AIAA 2005-5007, Fig. 5.

    A PoV is a name for a pose and a focal length: `pose` and `focal_px` give them back, `Pose.to_pov` names them.
    Any angles are taken (270 for -90); `canonical` gives the same point of view in the angles that `Pose.to_pov` uses.

    Examples
    --------
    >>> import windmark as wm
    >>> pov = wm.PoV(10.0, -20.0, 30.0, 1.0, 2.0, 50.0)
    >>> again = pov.pose.to_pov()
    >>> round(again.rx_deg, 6), round(again.ry_deg, 6), round(again.rz_deg, 6), round(again.dz, 6)
    (10.0, -20.0, 30.0, 50.0)
    >>> round(wm.PoV(0.0, 0.0, 0.0, 0.0, 0.0, 50.0, fov_deg=90.0).focal_px(640), 6)
    320.0
    """

    rx_deg: float
    ry_deg: float
    rz_deg: float
    dx: float
    dy: float
    dz: float
    fov_deg: float = float("nan")

    def focal_px(self, width_px: float) -> float:
        """Focal length in pixels of an image ``width_px`` wide with this field of view.

        Raises
        ------
        ValueError
            For a field of view that is not between 0 and 180 degrees.
        """
        if not 0 < self.fov_deg < 180:
            raise UsageError(f"PoV: fov_deg must be between 0 and 180 degrees, got {self.fov_deg:g}")
        return float(width_px / (2 * np.tan(np.radians(self.fov_deg) / 2)))

    @property
    def pose(self) -> Pose:
        """The pose (cam_from_model) of these angles and distances."""
        return Pose.from_pov(self)

    @property
    def canonical(self) -> PoV:
        """The same point of view with ry in [-90, 90] and rx, rz in (-180, 180] degrees."""
        return replace(self.pose.to_pov(), fov_deg=self.fov_deg)

    @property
    def singular(self) -> bool:
        """Whether ry is ±90 degrees (to rounding): then only rz - rx (ry = 90) or rz + rx (ry = -90) is defined."""
        return bool(abs(math.cos(math.radians(self.ry_deg))) < 1e-9)


@described(lambda p: {
    "turned deg": numbers(np.degrees(p.rotvec)), "translation": numbers(p.translation), "centre": numbers(p.center),
})  # fmt: skip
@dataclass(frozen=True)
class Pose:
    """Rigid transformation target-from-source: ``x_target = rotation @ x_source + translation``.

    Parameters
    ----------
    rotation : (..., 3, 3) orthonormal, determinant +1 (checked to 1e-6)
    translation : (..., 3) in the project's length unit

    Examples
    --------
    >>> import windmark as wm
    >>> cam_from_model = wm.Pose.look_at([1.0, 2.0, 10.0], [1.0, 2.0, 0.0], [0.0, 1.0, 0.0])
    >>> cam_from_model.center.round(6).tolist()
    [1.0, 2.0, 10.0]
    >>> cam_from_model.apply([2.0, 3.0, 0.0]).round(6).tolist()  # x right, y down, z away from the camera
    [1.0, -1.0, 10.0]
    >>> there_and_back = cam_from_model.inverse() @ cam_from_model
    >>> bool(there_and_back.angle_to(wm.Pose.identity()) < 1e-9)
    True
    """

    rotation: Array
    translation: Array

    __array_ufunc__ = None  # `pose @ array` is a TypeError; without this NumPy would try it entry by entry

    def __post_init__(self) -> None:
        r = np.asarray(self.rotation, dtype=float)
        t = np.asarray(self.translation, dtype=float)
        if r.shape[-2:] != (3, 3) or t.shape[-1:] != (3,) or r.shape[:-2] != t.shape[:-1]:
            raise ValueError(
                f"Pose: expected rotation (..., 3, 3) and translation (..., 3), got {r.shape} and {t.shape}"
            )
        if not (_finite(r) and _finite(t)):
            raise ValueError("Pose: rotation and translation must be finite")
        error, least_det = _off_orthonormal(r)
        if error <= 1e-6 and least_det < 0:
            raise ValueError(
                "Pose: rotation is mirrored: its determinant is -1; expected +1 (an axis has the wrong sign, or the "
                "axes are left-handed)"
            )
        if error > 1e-6:
            raise ValueError(
                f"Pose: rotation must be orthonormal with determinant +1, it is off by {g2(error)}"
                " (a mirrored or scaled matrix is not a rotation)"
            )
        object.__setattr__(self, "rotation", r)
        object.__setattr__(self, "translation", t)

    @staticmethod
    def trusted(rotation: Array, translation: Array) -> Pose:
        """The pose of arrays that are known to be one: nothing is checked, as where poses are made by the thousand."""
        pose = object.__new__(Pose)
        object.__setattr__(pose, "rotation", rotation)
        object.__setattr__(pose, "translation", translation)
        return pose

    @staticmethod
    def identity() -> Pose:
        """The pose that changes nothing."""
        return Pose(np.eye(3), np.zeros(3))

    @staticmethod
    def from_rotvec(rotvec: ArrayLike, translation: ArrayLike) -> Pose:
        """Pose of a rotation vector (..., 3) in radians (OpenCV's rvec) and a translation (..., 3)."""
        return Pose(rotations.exp_so3(rotvec), np.asarray(translation, dtype=float))

    @staticmethod
    def exp(delta: ArrayLike) -> Pose:
        """SE(3) exponential of ``delta`` = [rotation, translation], (..., 6)."""
        d = np.asarray(delta, dtype=float)
        if d.shape[-1:] != (6,):
            raise ValueError(f"Pose.exp: expected delta (..., 6), got {d.shape}")
        v = rotations.left_jacobian(d[..., :3]) @ d[..., 3:, None]
        return Pose(rotations.exp_so3(d[..., :3]), v[..., 0])

    def log(self) -> Array:
        """Inverse of `exp`: (..., 6), rotation angle at most pi."""
        w = rotations.log_so3(self.rotation)
        v = np.linalg.solve(rotations.left_jacobian(w), self.translation[..., None])[..., 0]
        return np.concatenate([w, v], axis=-1)

    def __matmul__(self, other: Pose) -> Pose:
        """Composition: ``a_from_b @ b_from_c`` is a_from_c."""
        if not isinstance(other, Pose):
            return NotImplemented
        t = (self.rotation @ other.translation[..., None])[..., 0] + self.translation
        return Pose.trusted(self.rotation @ other.rotation, t)

    def inverse(self) -> Pose:
        """Source-from-target."""
        rt = np.swapaxes(self.rotation, -1, -2)
        return Pose.trusted(rt, -(rt @ self.translation[..., None])[..., 0])

    @property
    def center(self) -> Array:
        """Origin of the target frame in the source frame (for cam_from_model: the camera's station), (..., 3)."""
        return self.inverse().translation

    @property
    def rotvec(self) -> Array:
        """Rotation vector in radians (OpenCV's rvec), (..., 3)."""
        return rotations.log_so3(self.rotation)

    def apply(self, xyz: ArrayLike) -> Array:
        """Transform points. A single pose takes (..., 3); a batch (B,) of poses takes (B, N, 3) or (N, 3)."""
        p = np.asarray(xyz, dtype=float)
        if p.shape[-1:] != (3,):
            raise ValueError(f"Pose.apply: expected points (..., 3), got {p.shape}")
        if self.rotation.ndim == 2:
            return p @ self.rotation.T + self.translation
        return p @ np.swapaxes(self.rotation, -1, -2) + self.translation[..., None, :]

    def rotate(self, vectors: ArrayLike) -> Array:
        """Turn directions (no translation), same shapes as `apply`."""
        return np.asarray(vectors, dtype=float) @ np.swapaxes(self.rotation, -1, -2)

    def rotate_form(self, forms: ArrayLike) -> Array:
        """Turn bilinear forms (N, 3, 3), covariances or curvatures of N points, with a single pose."""
        if self.rotation.ndim != 2:
            raise ValueError("Pose.rotate_form: expected a single pose, this is a batch")
        return np.asarray(self.rotation @ np.asarray(forms, dtype=float) @ self.rotation.T)

    def angle_to(self, other: Pose) -> Array:
        """Angle in radians of the rotation between two poses, in [0, pi]."""
        rel = np.swapaxes(self.rotation, -1, -2) @ other.rotation
        return np.linalg.norm(rotations.log_so3(rel), axis=-1)

    def to_pov(self, focal_px: float | None = None, width_px: float | None = None) -> PoV:
        """The paper's name of this (single) pose; with focal length and image width also the field of view."""
        if self.rotation.ndim != 2:
            raise ValueError("Pose.to_pov: a PoV names a single pose, this is a batch")
        rx, ry, rz = (float(np.degrees(a)) for a in rotations.to_xyz_angles(self.rotation))
        fov = float("nan")
        if focal_px is not None and width_px is not None:
            fov = float(np.degrees(2 * np.arctan(width_px / (2 * focal_px))))
        dx, dy, dz = (float(v) for v in self.translation)
        return PoV(rx, ry, rz, dx, dy, dz, fov)

    @staticmethod
    def from_pov(pov: PoV) -> Pose:
        """Inverse of `to_pov`."""
        r = rotations.from_xyz_angles(*np.radians([pov.rx_deg, pov.ry_deg, pov.rz_deg]))
        return Pose(r, np.array([pov.dx, pov.dy, pov.dz]))

    def pov_sigma(self, cov: ArrayLike, focal_px: float | None = None, width_px: float | None = None,
                  focal_sigma_px: float = float("nan")) -> PoV:  # fmt: skip
        """Standard deviations of the seven numbers of `to_pov`.

        Parameters
        ----------
        cov : (6, 6) covariance of ``delta`` in ``exp(delta) @ pose``, rotation (rad) first
        focal_px, width_px, focal_sigma_px : for the field of view; NaN without

        Notes
        -----
        A turn w about the camera's axes changes the angles by E^-1 w with E = [Rz Ry e_x, Rz e_y, e_z], and the
        distances by w x t. Where ry is ±90 degrees E has no inverse: rx and rz are infinitely uncertain, ry is not.
        """
        c = np.asarray(cov, dtype=float)
        if c.shape != (6, 6) or self.rotation.ndim != 2:
            raise ValueError(f"Pose.pov_sigma: expected a single pose and cov (6, 6), got {c.shape}")
        _, turn_y, turn_z = rotations.to_xyz_angles(self.rotation)
        sine, cosine = np.sin(turn_z), np.cos(turn_z)
        # ry turns about Rz e_y; what is left of the turn in the plane of Rz e_x and e_z is shared by rx and rz.
        about_y = np.array([-sine, cosine, 0.0])
        rows = np.full((3, 3), np.inf)
        rows[1] = about_y
        if abs(np.cos(turn_y)) > 1e-9:
            about_x = np.array([cosine, sine, 0.0]) / np.cos(turn_y)
            rows[0], rows[2] = about_x, np.array([0.0, 0.0, 1.0]) + np.sin(turn_y) * about_x
        out = np.full(6, np.inf)
        for k in range(3):
            if np.isfinite(rows[k]).all():
                out[k] = np.degrees(np.sqrt(max(0.0, rows[k] @ c[:3, :3] @ rows[k])))
        d = np.hstack([-rotations.hat(self.translation), np.eye(3)])
        out[3:] = np.sqrt(np.maximum(np.diag(d @ c @ d.T), 0.0))
        fov = float("nan")
        if focal_px is not None and width_px is not None:
            fov = float(np.degrees(width_px / (focal_px**2 + width_px**2 / 4) * focal_sigma_px))
        rx, ry, rz, dx, dy, dz = out.tolist()
        return PoV(rx, ry, rz, dx, dy, dz, fov)

    @staticmethod
    def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike) -> Pose:
        """cam_from_model of a camera at ``eye`` that looks at ``target``; ``up`` points to the top of the image.

        Raises
        ------
        ValueError
            When eye and target coincide or ``up`` is parallel to the line of sight.
        """
        eye, target, up = (np.asarray(v, dtype=float) for v in (eye, target, up))
        # By their largest coordinates first: squares of very long ones are no numbers.
        z, up = _scaled(target - eye), _scaled(up)
        x = np.cross(z, up)
        if np.linalg.norm(z) == 0 or np.linalg.norm(x) < 1e-12 * np.linalg.norm(z) * np.linalg.norm(up):
            raise DataError("Pose.look_at: eye and target coincide, or up is parallel to the line of sight")
        z = z / np.linalg.norm(z)
        x = x / np.linalg.norm(x)
        r = np.stack([x, np.cross(z, x), z])
        return Pose(r, -r @ eye)


def _scaled(a: Array) -> Array:
    """A vector whose largest coordinate is 1; zero stays zero."""
    return a / (float(np.abs(a).max()) or 1.0)


def _finite(a: Array) -> bool:
    """Whether all elements are; plain floats are faster for the few of a single pose."""
    return all(map(math.isfinite, a.ravel().tolist())) if a.size < 12 else bool(np.isfinite(a).all())


def _off_orthonormal(r: Array) -> tuple[float, float]:
    """Largest element of R R' - 1 over all rotations (..., 3, 3), and their least determinant."""
    if r.ndim == 2:  # a single pose is made per frame; plain floats are ten times faster here
        (a, b, c), (d, e, f), (g, h, i) = r.tolist()
        error = max(
            abs(a * a + b * b + c * c - 1.0), abs(d * d + e * e + f * f - 1.0), abs(g * g + h * h + i * i - 1.0),
            abs(a * d + b * e + c * f), abs(a * g + b * h + c * i), abs(d * g + e * h + f * i),
        )  # fmt: skip
        return error, a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    error = float(np.abs(r @ np.swapaxes(r, -1, -2) - np.eye(3)).max(initial=0.0))
    return error, float(np.linalg.det(r).min(initial=1.0))
