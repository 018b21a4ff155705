"""Cameras, markers and residuals of instants in which a deforming model was followed, as scenes show them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.app.residual_shifts import SeenBy, residual_shifts
from windmark.app.run_scene import marker_notes
from windmark.app.scene3d import STATION_COLOURS, Markers, Shifts, Station
from windmark.geometry import Pose
from windmark.pipeline.deform.followed import Standing
from windmark.scene import MarkerSet

Array = NDArray[np.float64]

MOST = 3_000_000
"""Nodes times frames: of a large grid fewer frames are shown."""
FEWEST = 8


def spread(count: int, nodes: int, most: int) -> list[int]:
    """Which of ``count`` instants are shown: at most ``most``, of a large grid fewer, evenly spread."""
    shown = min(count, most, max(FEWEST, MOST // max(nodes, 1)))
    return np.unique(np.linspace(0, count - 1, shown).round().astype(int)).tolist()


def own_markers(markers: MarkerSet) -> NDArray[np.intp]:
    """Numbers of the markers that are not on walls."""
    return np.flatnonzero(markers.role != "wall")


def shown_markers(markers: MarkerSet, xyz: Array, unit: str) -> Markers:
    """The model's own markers where they stand in the drawing, which their table, named below, does not know."""
    own = own_markers(markers)
    some = markers.take(own)
    return Markers(tuple(str(n) for n in some.name), xyz[own], None, marker_notes(some, unit))


def frame_of(standing: Standing, *, of_model: bool) -> Pose:
    """The drawing's frame from the tunnel's: the model's own, or the tunnel."""
    return standing.tunnel_from_model.inverse() if of_model else Pose.identity()


def stations(standing: Standing, *, of_model: bool) -> tuple[Station, ...]:
    """The cameras, each with its colour and how its spots fit."""
    back = frame_of(standing, of_model=of_model).inverse()
    out = []
    for k, (name, (camera, pose)) in enumerate(standing.cameras.items()):
        residual = standing.residuals.get(name, (None, np.zeros((0, 2))))[1]
        notes: tuple[str, ...] = ()
        if len(residual):
            rms = float(np.sqrt((residual**2).sum(axis=1).mean()))
            notes = (f"{len(residual)} markers took part, RMS {rms:.2g} px",)
        out.append(Station(name, camera, pose @ back, STATION_COLOURS[k % len(STATION_COLOURS)], notes))
    return tuple(out)


def shifts(what: str, standing: Standing, markers: MarkerSet, unit: str, *, of_model: bool) -> Shifts | None:
    """Residuals of an instant by all its cameras, at the markers that `shown_markers` has."""
    to_drawn = frame_of(standing, of_model=of_model)
    number = np.full(len(markers), -1)
    own = own_markers(markers)
    number[own] = np.arange(len(own))
    seen = []
    for name, (marker, residual) in standing.residuals.items():
        camera, pose = standing.cameras[name]
        mine = number[marker] >= 0
        seen.append(SeenBy(name, camera, pose @ to_drawn.inverse(), number[marker[mine]], residual[mine]))
    return residual_shifts(what, seen, to_drawn.apply(standing.xyz[own]), unit)


def places(standing: Sequence[Standing], *, of_model: bool) -> Array:
    """(F, N, 3) all markers of the test at each instant."""
    return np.stack([frame_of(s, of_model=of_model).apply(s.xyz) for s in standing])
