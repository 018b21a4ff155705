"""A fixed camera that stands no longer where it is said to: the markers on walls say so, found by themselves.

Near their places they take part with all others, and what they contradict is named. Farther off than a spot is looked
for they are not found, and the model alone would fit: with a motion that is the camera's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from windmark.errors import g2
from windmark.registration import Registration, register
from windmark.scene import Detections
from windmark.tasks.deform.spots import LEAST_PX, Labelled
from windmark.tasks.deform.task import DeformationTest, Station

LEAST_WALL = 4
"""So many markers on walls are wanted to find where a camera stands."""
THERE = 0.5
"""Part of the walls' markers in the picture that have a spot at their places where the camera stands as it should."""


def without_walls(test: DeformationTest, now: Mapping[str, Labelled], before: Mapping[str, Labelled]) -> str | None:
    """A fixed camera that has lost most of its markers on walls, which do not move; None where all have theirs."""
    wall = test.markers.role == "wall"
    for name, own in now.items():
        usual = int(wall[before[name].marker].sum()) if name in before else 0
        if usual >= LEAST_WALL and not test.station(name).moves and wall[own.marker].sum() < THERE * usual:
            return name
    return None


def off_its_walls(spots: Detections, test: DeformationTest, station: Station, options: dict[str, Any]) -> str:
    """Why a fixed camera is not to be believed, by all spots of its picture; empty where its walls do not say so.

    ``options`` of `register`. Walls that are dark or hidden say nothing.
    """
    wall = test.markers.take(np.flatnonzero(test.markers.role == "wall"))
    if station.moves or len(wall) < LEAST_WALL or not len(spots):
        return ""
    camera, pose = station.camera, station.cam_from_tunnel
    places, imaged = camera.project(pose.apply(wall.xyz))
    inside = imaged & camera.in_image(places)
    near = inside.copy()
    near[inside] = cKDTree(spots.xy).query(places[inside])[0] < LEAST_PX
    if inside.sum() < LEAST_WALL or near.sum() >= THERE * inside.sum():
        return ""
    answer = register(spots, wall, camera, prior=pose, **options)
    if not isinstance(answer, Registration):
        return ""
    marker = answer.matching.marker
    if 2 * near[marker].sum() >= len(marker):
        return ""
    off = np.linalg.norm(camera.project(answer.cam_from_model.apply(wall.xyz[marker]))[0] - places[marker], axis=1)
    return (
        f"it is not where it is said to be: {len(marker)} markers on walls are {g2(float(np.median(off)))} px from "
        "their places"
    )
