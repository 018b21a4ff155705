"""The poses that three markers leave, and what a fourth says to each (AIAA 2005-5007, section III.B)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import DataError, UsageError
from windmark.geometry import Camera, Pose, p3p
from windmark.geometry.described import described
from windmark.geometry.rotations import hat
from windmark.scene.shown import ARRAY, check_kinds

Array = NDArray[np.float64]

COMPATIBLE = 4.0
"""A marker whose spot lies more sigmas off than this (of its two-dimensional distance) contradicts a candidate."""


@described(lambda p: {"poses": len(p), "compatible": int(p.compatible.sum())})  # fmt: skip
@dataclass(frozen=True)
class PoseCandidates:
    """Every pose that sees three markers where their spots are, best first.

    Parameters
    ----------
    cam_from_model : (n,) the poses, up to four; none where no camera can see the three markers so
    residual_px : (n, K) distance of each marker's projection from its spot, 0 but rounding for the three; NaN where the
        pose has the marker behind the camera
    sigmas : (n, K) the same in sigmas, with what the noise of the three spots leaves to the pose

    Examples
    --------
    >>> import windmark as wm
    >>> camera = wm.Camera((640, 480), 800.0)
    >>> xyz = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [1.0, 1.0, 1.0]]
    >>> true = wm.Pose.look_at([3.0, 2.0, 9.0], [0.5, 0.5, 0.0], [0.0, 1.0, 0.0])
    >>> xy, _ = camera.project(true.apply(xyz))
    >>> found = wm.pose_candidates(xy, xyz, camera)
    >>> found.compatible.tolist()  # the fourth marker contradicts the second pose
    [True, False]
    >>> found.decided is found.cam_from_model[0]
    True
    """

    cam_from_model: tuple[Pose, ...]
    residual_px: Array
    sigmas: Array

    def __len__(self) -> int:
        return len(self.cam_from_model)

    @property
    def compatible(self) -> NDArray[np.bool_]:
        """(n,): no further marker contradicts the pose."""
        away = np.where(np.isnan(self.sigmas), np.inf, self.sigmas)
        return np.asarray((away <= COMPATIBLE).all(axis=1))

    @property
    def decided(self) -> Pose | None:
        """The pose, if exactly one candidate is left and a fourth marker was asked; else None."""
        left = np.flatnonzero(self.compatible)
        return self.cam_from_model[int(left[0])] if len(left) == 1 and self.sigmas.shape[1] > 3 else None


def pose_candidates(xy: ArrayLike, xyz: ArrayLike, camera: Camera, *, sigma_px: float = 0.1) -> PoseCandidates:
    """All camera poses that see the first three markers where their spots are; the others are asked about each.

    Parameters
    ----------
    xy : (K, 2) spots in pixels, K at least 3
    xyz : (K, 3) their markers
    camera : interior parameters
    sigma_px : of a spot, per coordinate

    Returns
    -------
    PoseCandidates, the poses that the others contradict least first

    Raises
    ------
    ValueError
        For wrong shapes, values that are not finite, or spots that the lens model cannot invert.
    DegenerateGeometry
        When the first three markers lie on one line.

    Notes
    -----
    Three markers leave two poses always and sometimes four; double solutions (camera on the danger cylinder) are listed
    once. A further marker's distance is compared with its own noise and with that of the pose, to first order: near the
    danger cylinder, and for a fourth marker near the plane of the three under a long lens, it decides nothing.

    Examples
    --------
    >>> import windmark as wm
    >>> camera = wm.Camera((640, 480), 800.0)
    >>> xyz = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [1.0, 1.0, 1.0]]
    >>> true = wm.Pose.look_at([3.0, 2.0, 9.0], [0.5, 0.5, 0.0], [0.0, 1.0, 0.0])
    >>> xy, _ = camera.project(true.apply(xyz))
    >>> best = wm.pose_candidates(xy, xyz, camera).cam_from_model[0]
    >>> bool(best.angle_to(true) < 1e-6)
    True
    """
    check_kinds("pose_candidates", xy=(xy, ARRAY), xyz=(xyz, ARRAY), camera=(camera, Camera))
    spots, markers = np.asarray(xy, dtype=float), np.asarray(xyz, dtype=float)
    if spots.ndim != 2 or spots.shape[1] != 2 or len(spots) < 3:
        raise ValueError(f"pose_candidates: xy must be (K, 2) with K at least 3, got {spots.shape}")
    if markers.shape != (len(spots), 3):
        raise ValueError(f"pose_candidates: xyz must be ({len(spots)}, 3) for {len(spots)} spots, got {markers.shape}")
    if not (np.isfinite(spots).all() and np.isfinite(markers).all()):
        raise ValueError("pose_candidates: xy and xyz must be finite")
    if not sigma_px > 0:
        raise UsageError(f"pose_candidates: sigma_px must be positive, got {sigma_px}")
    rays = camera.unproject(spots[:3])
    if not np.isfinite(rays).all():
        raise DataError("pose_candidates: the lens model has no inverse at one of the first three spots")
    poses = _distinct(p3p(rays, markers[:3]).poses())
    looks = [_look(pose, spots, markers, camera, sigma_px) for pose in poses]
    worst = [np.inf if np.isnan(s).any() else float(s.max()) for _, s in looks]
    order = np.argsort(worst, kind="stable")
    shape = (len(poses), len(spots))
    return PoseCandidates(
        tuple(poses[k] for k in order),
        np.array([looks[k][0] for k in order]).reshape(shape),
        np.array([looks[k][1] for k in order]).reshape(shape),
    )


def _distinct(poses: list[Pose]) -> list[Pose]:
    kept: list[Pose] = []
    for pose in poses:
        if all(np.linalg.norm((pose @ other.inverse()).log()[:3]) > 1e-7 for other in kept):
            kept.append(pose)
    return kept


def _look(pose: Pose, spots: Array, markers: Array, camera: Camera, sigma_px: float) -> tuple[Array, Array]:
    """Distances (K,) of the projections from the spots: in pixels and in sigmas."""
    places = pose.apply(markers)
    seen, valid, by_point, _ = camera.project_jacobian(places)
    off = seen - spots
    distance = np.where(valid, np.linalg.norm(off, axis=1), np.nan)
    # d(place) / d(rotation, translation) = [-[place]x, 1] for exp(delta) @ pose.
    by_pose = by_point @ np.concatenate([-hat(places), np.broadcast_to(np.eye(3), (len(places), 3, 3))], axis=2)
    sigmas = np.zeros(len(spots))
    try:
        back = np.linalg.inv(by_pose[:3].reshape(6, 6))
    except np.linalg.LinAlgError:  # on the danger cylinder the three say nothing in one direction
        return distance, np.where(valid, sigmas, np.nan)
    for k in range(3, len(spots)):
        if valid[k]:
            lever = by_pose[k] @ back
            cov = sigma_px**2 * (np.eye(2) + lever @ lever.T)
            sigmas[k] = np.sqrt(off[k] @ np.linalg.solve(cov, off[k]))
        else:
            sigmas[k] = np.nan
    return distance, sigmas
