"""A fixed camera that stands no longer where it is said to: the markers on walls say so, found by themselves.

Near their places they take part with all others, and what they contradict is named. Farther off than a spot is looked
for they are not found, and the model alone would fit: with a motion that is the camera's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.errors import g2
from windmark.registration import Registration, register
from windmark.scene import Detections, MarkerSet
from windmark.tasks.deform.spots import LEAST_PX, MOST_PX, Labelled, around
from windmark.tasks.deform.task import DeformationTest, Station

Ints = NDArray[np.int64]

LEAST_WALL = 4
"""So many markers on walls are wanted to find where a camera stands."""
LEAST_PLACED = 3
"""So many markers on walls at their places hold a camera."""
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


def walls_in_place(
    spots: Detections, placed: MarkerSet, wall: Ints, station: Station, taken: Ints
) -> tuple[Ints, Ints, int]:  # fmt: skip
    """Spots of markers on walls (indices ``wall``) where a camera's file puts them, within `MOST_PX`; and how many.

    Too few of those in the picture are taken for chance: a camera that moved farther shows others' spots there.
    ``taken`` : spots that are the model's.
    """
    free = np.setdiff1d(np.arange(len(spots)), taken)
    own, walls = spots.take(free), placed.take(wall)
    seen = around(own, station.camera, station.cam_from_tunnel, walls)
    places = station.camera.project(station.cam_from_tunnel.apply(walls.xyz))[0]
    near = np.linalg.norm(seen.xy - places[seen.marker], axis=1) < MOST_PX
    marker = seen.marker[near]
    if len(marker) < max(LEAST_PLACED, THERE * seen.expected):
        return free[:0], wall[:0], seen.expected
    spot = cKDTree(own.xy).query(seen.xy[near])[1]
    return free[spot], wall[marker], seen.expected


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
