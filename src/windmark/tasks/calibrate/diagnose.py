"""Why the pictures may not determine a calibration: from where they were taken, as far as rough markers tell."""

from __future__ import annotations

import numpy as np

from windmark.calibration.start import start_poses
from windmark.geometry import Pose
from windmark.tasks.calibrate.marks import Marks

SAME_PLACE = 0.05
"""Stations that scatter by less than this part of their distance to the markers are one place."""
SAME_SIDE_DEG = 6.0
"""Directions to the markers that differ by less (1 sigma) say hardly anything about depth."""
FLAT = 0.02
"""Thickness of a marker field, as part of its width, up to which it is flat."""


def diagnosis(marks: Marks) -> list[str]:
    """What is wrong with the set of pictures, in sentences; empty where nothing strikes.

    Poses come from the rough markers with the best of some focal lengths: good for a diagnosis only.
    """
    seen = np.unique(marks.observations.point)
    xyz = marks.markers.xyz[seen]
    poses = _poses(marks)
    out = []
    if len(poses) < 3:
        out.append(f"{len(poses)} pictures have a pose (four marks or more); a calibration needs many")
    if len(poses) < 2:
        return out
    middle = xyz.mean(axis=0)
    at = np.stack([p.center for p in poses])
    away = middle - at
    distance = float(np.median(np.linalg.norm(away, axis=1)))
    spread = float(np.sqrt(((at - at.mean(axis=0)) ** 2).sum(axis=1).mean()))
    sight = away / np.linalg.norm(away, axis=1, keepdims=True)
    mean = sight.mean(axis=0) / max(float(np.linalg.norm(sight.mean(axis=0))), 1e-12)
    around = float(np.degrees(np.sqrt((np.arccos(np.clip(sight @ mean, -1, 1)) ** 2).mean())))
    if spread < SAME_PLACE * distance:
        out.append(f"all pictures were taken from about one place (stations scatter by {100 * spread / distance:.1f} %"
                   " of their distance to the markers): walk round the model")  # fmt: skip
    elif around < SAME_SIDE_DEG:
        out.append(f"all pictures look at the markers from about the same side (directions scatter by {around:.1f}"
                   " deg): take pictures from 30 deg and more to all sides")  # fmt: skip
    size = np.linalg.svd(xyz - middle, compute_uv=False)
    tilt = np.array([_tilt_deg(p, xyz - middle) for p in poses])
    if size[2] < FLAT * size[0] and tilt.max() < 2 * SAME_SIDE_DEG:
        out.append(f"the markers lie in a plane and all pictures face it (tilts up to {tilt.max():.0f} deg): that does "
                   "not tell the focal length from the distance; tilt the camera by 30 deg and more")  # fmt: skip
    return out


def _poses(marks: Marks) -> list[Pose]:
    obs, out = marks.observations, []
    for name, camera in marks.cameras.items():
        mine = [v for v, view in enumerate(marks.views) if view.camera == name]
        pairs = [(obs.xy[obs.view == v], marks.markers.xyz[obs.point[obs.view == v]]) for v in mine]
        out += [
            p for p in start_poses(camera, pairs, scan_focal=True, rng=np.random.default_rng(0))[1] if p is not None
        ]
    return out


def _tilt_deg(pose: Pose, arms: np.ndarray) -> float:
    """Angle between the optical axis and the normal of the markers' best plane."""
    normal = np.linalg.svd(arms, full_matrices=False)[2][2]
    return float(np.degrees(np.arccos(min(1.0, abs(float(pose.rotation[2] @ normal))))))
