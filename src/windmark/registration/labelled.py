"""Pose from labelled spots without a starting pose: P3P on a few wide triplets, then least squares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.adjust import PoseEstimate, refine_pose
from windmark.errors import DataError, g3
from windmark.geometry import Camera, DegenerateGeometry, Pose, p3p
from windmark.registration.task import with_focal
from windmark.scene.shown import ARRAY, check_kinds

Array = NDArray[np.float64]

TRIPLETS, DRAWN = 32, 400
"""Triplets tried, the widest of so many drawn at random."""
STARTS = 3
"""Distinct starting poses that are refined."""
FOCAL_FACTORS = tuple(np.geomspace(0.4, 2.5, 7))
"""Starting values of a free focal length, relative to the camera's."""
CLEAR = 4.5
"""Another pose fits as well if its cost (half the chi-square) is less than this higher: three sigma."""


def pose_from_labels(
    xy: ArrayLike,
    xyz: ArrayLike,
    camera: Camera,
    *,
    cov: ArrayLike | None = None,
    free: Sequence[str] = (),
    loss: str = "none",
    prior_sigma: Mapping[str, float] | None = None,
    seed: int = 0,
) -> PoseEstimate:
    """Camera pose from spots whose markers are known (hand-labelled, coded, or from another program).

    Parameters
    ----------
    xy : (K, 2) spots in pixels
    xyz : (K, 3) their markers
    camera : interior parameters; with ``"focal_px"`` in ``free`` the focal length may be wrong by a factor of two
    cov : (K, 2, 2) covariance of xy in px^2; None means 1 px^2
    free, loss, prior_sigma : see `windmark.adjust.refine_pose`. The start is the pose with the smallest median
        residual, so with a robust loss up to a third or so of the labels may be wrong
    seed : of the choice of triplets

    Raises
    ------
    ValueError
        For wrong shapes, values that are not finite, or spots that the lens model cannot invert.
    DegenerateGeometry
        Fewer than four pairs, markers on one line, free parameters that the pairs do not determine, or two
        distinct poses that fit equally well (a small flat set of markers under a long lens).

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> camera = wm.Camera((640, 480), 800.0)
    >>> xyz = [[0, 0, 0], [2, 0, 0], [0, 2, 0], [2, 2, 0], [1, 1, 1]]
    >>> true = wm.Pose.look_at([3.0, 2.0, 9.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0])
    >>> xy, _ = camera.project(true.apply(xyz))
    >>> found = wm.pose_from_labels(xy, xyz, camera, cov=np.tile(0.01 * np.eye(2), (5, 1, 1)))
    >>> bool(found.cam_from_model.angle_to(true) < 1e-6), found.cov.shape
    (True, (6, 6))
    """
    check_kinds("pose_from_labels", xy=(xy, ARRAY), xyz=(xyz, ARRAY), camera=(camera, Camera))
    spots, markers = _checked(xy, xyz)
    cameras = [camera]
    if "focal_px" in free:
        cameras = [with_focal(camera, camera.focal_px * f) for f in FOCAL_FACTORS]
    found: list[PoseEstimate] = []
    failure: DegenerateGeometry | None = None
    for _, start_camera, pose in poses_of(spots, markers, cameras, seed)[:STARTS]:
        # The lens parameters of the given camera are the start, whatever the focal length.
        start_camera = replace(camera, focal_px=start_camera.focal_px)
        if not start_camera.project(pose.apply(markers))[1].all():
            continue
        try:
            found.append(
                refine_pose(start_camera, pose, markers, spots, cov, free=free, loss=loss, prior_sigma=prior_sigma)
            )
        except DegenerateGeometry as error:
            failure = error
    if not found:
        raise failure or DegenerateGeometry("pose_from_labels: no pose puts all markers in front of the camera")
    return _clear_best(found)


def poses_of(
    spots: Array, markers: Array, cameras: Sequence[Camera], seed: int = 0, triplets: int = TRIPLETS
) -> list[tuple[float, Camera, Pose]]:
    """Distinct poses that put three of the markers (K, 3) on their spots (K, 2), with the median residual of all."""
    some = _wide_triplets(spots, markers, np.random.default_rng(seed))[:triplets]
    starts = [start for camera in cameras for start in _starts(spots, markers, camera, some)]
    return _distinct(sorted(starts, key=lambda start: start[0])[: 4 * STARTS])


def _checked(xy: ArrayLike, xyz: ArrayLike) -> tuple[Array, Array]:
    spots, markers = np.asarray(xy, dtype=float), np.asarray(xyz, dtype=float)
    if spots.ndim != 2 or spots.shape[1] != 2:
        raise ValueError(f"pose_from_labels: xy must be (K, 2), got {spots.shape}")
    if markers.shape != (len(spots), 3):
        raise ValueError(f"pose_from_labels: xyz must be ({len(spots)}, 3) for {len(spots)} spots, got {markers.shape}")
    for name, values in (("xy", spots), ("xyz", markers)):
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values).all(axis=1)))
            raise ValueError(f"pose_from_labels: {name} must be finite, row {row} is not")
    if len(spots) < 4:
        raise DegenerateGeometry(f"pose_from_labels: {len(spots)} pairs; three leave up to four poses, give at least 4")
    size = np.linalg.svd(markers - markers.mean(axis=0), compute_uv=False)
    if not size[1] > 1e-6 * size[0]:
        raise DegenerateGeometry("pose_from_labels: the markers lie on one line", ("rotation_x",))
    return spots, markers


def _wide_triplets(spots: Array, markers: Array, rng: np.random.Generator) -> NDArray[np.int64]:
    """(T, 3) triplets that are wide both in the image and on the model."""
    k = len(spots)
    drawn = np.argsort(rng.random((DRAWN, k)), axis=1)[:, :3] if k <= 64 else rng.integers(0, k, (DRAWN, 3))
    drawn = np.unique(np.sort(drawn, axis=1), axis=0)
    drawn = drawn[(drawn[:, 0] != drawn[:, 1]) & (drawn[:, 1] != drawn[:, 2])]
    u, v = (spots[drawn[:, n]] - spots[drawn[:, 0]] for n in (1, 2))
    seen = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    a, b = (markers[drawn[:, n]] - markers[drawn[:, 0]] for n in (1, 2))
    width = np.sqrt(seen / max(seen.max(), 1e-300)) * np.linalg.norm(np.cross(a, b), axis=1)
    # Every second one of the widest: neighbours in this order share corners, and a wrong label with them.
    return drawn[np.argsort(-width, kind="stable")[: 2 * TRIPLETS : 2]]


def _starts(
    spots: Array, markers: Array, camera: Camera, triplets: NDArray[np.int64]
) -> list[tuple[float, Camera, Pose]]:
    """Poses of all triplets with their median residual."""
    rays = camera.unproject(spots)
    if not np.isfinite(rays).all():
        row = int(np.argmin(np.isfinite(rays).all(axis=1)))
        raise DataError(f"pose_from_labels: the lens model has no inverse at spot {row}, {spots[row].tolist()}")
    solutions = p3p(rays[triplets], markers[triplets])
    starts = []
    for n in range(len(triplets)):
        for pose in solutions.poses(n):
            residual = np.linalg.norm(camera.project(pose.apply(markers))[0] - spots, axis=1)
            starts.append((float(np.median(np.where(np.isnan(residual), np.inf, residual))), camera, pose))
    return starts


def _distinct(starts: list[tuple[float, Camera, Pose]]) -> list[tuple[float, Camera, Pose]]:
    """The best start, and others that are turned against every better one by more than 5 degrees."""
    kept: list[tuple[float, Camera, Pose]] = []
    for start in starts:
        if all(start[2].angle_to(other[2]) > np.radians(5.0) for other in kept):
            kept.append(start)
    return kept


def _clear_best(found: list[PoseEstimate]) -> PoseEstimate:
    """The estimate of least cost, if no distinct one comes near in units of the residuals' own scale."""
    found = sorted(found, key=lambda e: e.report.final_cost)
    best = found[0]
    scale = best.sigma0**2 if np.isfinite(best.sigma0) else 1.0
    for other in found[1:]:
        apart = (best.cam_from_model @ other.cam_from_model.inverse()).log()
        same = apart @ np.linalg.solve(best.cov[:6, :6] * max(scale, 1e-12), apart) < 36.0
        angle = float(np.degrees(best.cam_from_model.angle_to(other.cam_from_model)))
        if not same and angle > 0.1 and other.report.final_cost - best.report.final_cost < CLEAR * scale:
            raise DegenerateGeometry(
                f"pose_from_labels: two poses {angle:.1f} degrees apart fit equally well "
                f"({g3(best.rms_px)} and {g3(other.rms_px)} px), as for a small flat set of markers under a long lens",
                ("rotation_x", "rotation_y"),
            )
    return best
