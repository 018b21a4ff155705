"""A calibration or reconstruction in 3D: stations with their views, markers with their error ellipsoids."""

from __future__ import annotations

import numpy as np

from windmark.app.run_scene import marker_notes
from windmark.app.scene3d import STATION_COLOURS, Markers, Scene3D, Station
from windmark.calibration import Calibration
from windmark.errors import g2

PYRAMID = 0.2
"""How far the views are drawn, of the way to the markers: those of many stations hide each other."""


def network_scene(result: Calibration, unit: str) -> Scene3D:
    """All stations and markers of an adjusted network."""
    colour = {name: STATION_COLOURS[k % len(STATION_COLOURS)] for k, name in enumerate(result.cameras)}
    poses = [result.pose(view.name) for view in result.views]
    marks = np.bincount(result.observations.view[result.used], minlength=len(poses))
    stations = []
    for k, (view, pose) in enumerate(zip(result.views, poses, strict=True)):
        turned = result.pose_cov[k][3:, 3:]
        sigma = np.sqrt(np.maximum(np.diag(pose.rotation.T @ turned @ pose.rotation), 0.0))
        notes = [f"{marks[k]} marks"]
        if sigma.any():
            notes.append(f"1 sigma of its place: {', '.join(f'{g2(s)}' for s in sigma)} {unit}")
        if len(result.cameras) > 1:
            notes.insert(0, f"camera {view.camera}")
        stations.append(Station(view.name, result.cameras[view.camera], pose, colour[view.camera], tuple(notes),
                                PYRAMID))  # fmt: skip
    markers = result.markers
    up = -np.mean([pose.rotation[1] for pose in poses], axis=0)
    ahead = np.mean([markers.xyz.mean(axis=0) - pose.center for pose in poses], axis=0)
    if np.linalg.norm(np.cross(up, ahead)) < 1e-6 * max(float(np.linalg.norm(ahead)), 1e-300):
        up, ahead = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, -0.5])
    ahead = ahead / np.linalg.norm(ahead) - 0.45 * up / np.linalg.norm(up)
    shown = Markers(tuple(str(n) for n in markers.name), markers.xyz, result.marker_cov, marker_notes(markers, unit))
    focus = np.concatenate([markers.xyz, [pose.center for pose in poses]])
    return Scene3D(unit, ahead, up, stations=stations, markers=shown, focus=focus)
