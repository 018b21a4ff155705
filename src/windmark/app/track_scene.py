"""A followed model in 3D: its markers, and the camera's station in every image with the residuals of its spots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from windmark.app.residual_shifts import SeenBy, residual_shifts
from windmark.app.run_scene import markers_shown
from windmark.app.scene3d import STATION_COLOURS, Cut, Frames, Scene3D, Shifts, Station, looking_over
from windmark.app.standing_scene import spread
from windmark.errors import g2
from windmark.geometry import Camera
from windmark.pipeline.track_results import PoseRow
from windmark.scene import MarkerSet

MOST = 200
"""Images that the slider goes through; of more some, evenly spread."""


def track_scene(rows: Sequence[PoseRow], markers: MarkerSet, camera: Camera, unit: str) -> Scene3D | None:
    """The scene in the model's frame; None where no image has a pose."""
    located = [row for row in rows if row.cam_from_model is not None]
    if not located:
        return None
    chosen = [rows[k] for k in spread(len(rows), len(markers), MOST)]
    stations: list[tuple[Station, ...]] = []
    shifts: list[Shifts | None] = []
    for row in chosen:
        pose = row.cam_from_model
        if pose is None:
            stations.append(())
            shifts.append(None)
            continue
        marker, columns = row.matches
        said = f"{row.matched} of {row.expected} markers matched, RMS {g2(row.rms_px)} px"
        stations.append((Station(row.name, camera, pose, STATION_COLOURS[0], (said,)),))
        shifts.append(residual_shifts(row.name, [SeenBy(row.name, camera, pose, marker, columns[:, 2:])],
                                      markers.xyz, unit))  # fmt: skip
    path = np.array([row.cam_from_model.center for row in located if row.cam_from_model is not None])
    # A line from pose to pose; where one was lost between them, there is a gap.
    piece = np.cumsum([row.cam_from_model is None for row in rows])[[row.cam_from_model is not None for row in rows]]
    frames = Frames(
        tuple(_label(row) for row in chosen), np.zeros((len(chosen), 0, 3), np.float32), None, 1.0, "",
        stations=tuple(stations), shifts=tuple(shifts),
        first=next((k for k, of in enumerate(stations) if of), 0),
    )  # fmt: skip
    first = located[0].cam_from_model
    assert first is not None
    ahead, up = looking_over(first, markers.xyz)
    return Scene3D(unit, ahead, up, markers=markers_shown(markers, unit), cuts=[Cut("path of the camera", path, piece)],
                   cuts_are="path of the camera", frames=frames, focus=markers.xyz)  # fmt: skip


def _label(row: PoseRow) -> str:
    time = f", {row.time_s:.4g} s" if np.isfinite(row.time_s) else ""
    return f"{row.name}{time}: {'no pose' if row.cam_from_model is None else row.status}"
