"""The last refinement of an accepted labelling: what the search plane leaves out.

- A disc's image is an ellipse whose centre is not the image of the disc's centre (`geometry.discs`). Where a marker
  has a normal and a radius, its spot is corrected by that eccentricity at the pose at hand, and the pose is refined
  again; the eccentricity changes so little with the pose that two rounds are enough.
- With a free focal length the search keeps the lens as it bends the *image*. The lens parameters belong to normalised
  coordinates: a camera with the focal length found bends the image otherwise. So the spots are straightened and
  labelled again with the camera as found, until it stands still, and the full camera model has the last word. The
  focal length is then read out of the distortion, too, as far as the lens is known: `Camera.cov` takes part.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import SolveReport, refine_pose
from windmark.geometry import PARAMETERS, Camera, DegenerateGeometry, Pose, imaged_ellipse
from windmark.registration._kernels.fit import Spots
from windmark.registration.bent.solution import BentSolution, accepted_bent
from windmark.registration.result import Deformation
from windmark.registration.search.plane import Plane, spots_at
from windmark.registration.search.pool import Candidate
from windmark.registration.solution import Solution, accepted, settle

Array = NDArray[np.float64]

LENS_ROUNDS, SAME_FOCAL = 12, 1e-4
"""How often the lens is moved to the focal length found, and the relative change at which that is done."""
DISC_ROUNDS = 2
LENS = ("k1", "k2", "p1", "p2", "k3", "tilt_x", "tilt_y")


@dataclass(frozen=True, eq=False)
class Final:
    """An accepted solution as it is reported.

    Parameters
    ----------
    solution : labels, evidence, expected markers, excess
    cam_from_model, camera, cov, report : of the last adjustment; see `Registration`
    eccentricity_px : (K, 2) ellipse's centre less image of the disc's centre; 0 where normal or radius is unknown
    deformation : of the model, or None
    """

    solution: Solution
    cam_from_model: Pose
    camera: Camera
    cov: Array
    report: SolveReport
    eccentricity_px: Array
    deformation: Deformation | None = None


def finish(plane: Plane, best: Solution) -> Final:
    """The last refinement of an accepted solution."""
    given = plane.task.camera
    bent = is_bent(given)
    if plane.task.free_focal and bent:
        plane, best = _with_its_lens(plane, best)
    best = _accepted(plane, best, plane.spots)
    off = np.zeros((best.count, 2))
    for _ in range(DISC_ROUNDS if are_discs(plane).any() else 0):
        off = eccentricity(plane, best)
        best = _accepted(plane, best, moved(plane, best, off))
    if plane.task.free_focal and (bent or given.cov is not None):
        full = _with_full_camera(plane, best, off)
        if full is not None:
            return full
    camera = _camera(plane, best)
    deformation = best.deformation(plane, camera) if isinstance(best, BentSolution) else None
    return Final(best, best.cam_from_model, camera, best.cov, best.report, off, deformation)


def _accepted(plane: Plane, best: Solution, spots: Spots) -> Solution:
    return accepted_bent(plane, best, spots) if isinstance(best, BentSolution) else accepted(plane, best, spots)


def is_bent(camera: Camera) -> bool:
    """Whether the lens does anything but a pinhole does."""
    return any(getattr(camera, name) != 0.0 for name in LENS)


def _with_its_lens(plane: Plane, best: Solution) -> tuple[Plane, Solution]:
    """The search plane and the solution of the lens at the focal length found."""
    for _ in range(LENS_ROUNDS):
        camera = replace(plane.task.camera, focal_px=best.focal_px)
        if abs(np.log(camera.focal_px / plane.task.camera.focal_px)) < SAME_FOCAL:
            break
        if not np.isfinite(camera.unproject(plane.task.xy)).all():
            break
        other = Plane(replace(plane.task, camera=camera), plane.layout)
        again = settle(other, Candidate(best.cam_from_model, best.focal_px, 0.0, best.count, best.state.match))
        if again is None:
            break
        plane, best = other, again
    return plane, best


def _camera(plane: Plane, best: Solution) -> Camera:
    """The camera as found; only the variance of a free focal length is new."""
    if not plane.task.free_focal:
        return plane.task.camera
    cov = np.zeros((len(PARAMETERS),) * 2)
    cov[0, 0] = best.cov[6, 6]
    return replace(plane.task.camera, focal_px=best.focal_px, cov=cov)


def are_discs(plane: Plane) -> NDArray[np.bool_]:
    """(N,) markers whose normal and radius are known."""
    markers = plane.task.markers
    return np.isfinite(markers.radius) & np.isfinite(markers.normal).all(axis=1)


def eccentricity(plane: Plane, best: Solution) -> Array:
    """(K, 2) of the matched markers, 0 where they are no discs or a part of the outline has no image."""
    off, discs = np.zeros((best.count, 2)), are_discs(plane)[best.marker]
    markers = plane.task.markers.take(best.marker[discs])
    pose, camera = best.cam_from_model, replace(plane.task.camera, focal_px=best.focal_px)
    seen = imaged_ellipse(camera, pose.apply(markers.xyz), pose.rotate(markers.normal), markers.radius)
    off[discs] = np.nan_to_num(seen.eccentricity_px)
    return off


def moved(plane: Plane, best: Solution, off: Array) -> Spots:
    """The spots with those of matched discs moved to the images of the discs' centres."""
    xy = plane.task.xy.copy()
    xy[best.detection] -= off
    return spots_at(plane, xy)


def _with_full_camera(plane: Plane, best: Solution, off: Array) -> Final | None:
    """Pose, focal length and what `Camera.cov` leaves open of the other parameters; None if that has no solution."""
    task = plane.task
    markers, camera = task.markers.take(best.marker), replace(task.camera, focal_px=best.focal_px)
    known = np.zeros((len(PARAMETERS),) * 2) if camera.cov is None else np.array(camera.cov)
    known[0, :], known[:, 0] = 0.0, 0.0
    open_ = tuple(name for name, variance in zip(PARAMETERS, np.diag(known), strict=True) if variance > 0)
    d_xyz = camera.project_jacobian(best.cam_from_model.apply(markers.xyz))[2] @ best.cam_from_model.rotation
    table = d_xyz * np.nan_to_num(markers.sigma)[:, None, :]
    cov = task.cov[best.detection] + table @ np.swapaxes(table, 1, 2) + best.excess_px**2 * np.eye(2)
    try:
        found = refine_pose(
            camera, best.cam_from_model, markers.xyz, task.xy[best.detection] - off, cov,
            free=("focal_px", *open_), camera_cov=known,
        )  # fmt: skip
    except (DegenerateGeometry, ValueError):
        return None
    return Final(best, found.cam_from_model, found.camera, found.cov[:7, :7], found.report, off)
