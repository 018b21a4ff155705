"""Are the markers where a pose that was given has them?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.detection import AUTO
from windmark.errors import WindmarkError
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Mesh
from windmark.tasks.predictions import from_camera, look
from windmark.tasks.sight import sight

SEARCH_PX = 6.0
"""Markers are looked for so far from where the pose has them."""


@dataclass(frozen=True)
class AtPose:
    """What a picture shows at the places of the markers that must be in view.

    Parameters
    ----------
    expected, found : how many there are, and of how many there is a disc near
    off_px : how far these are from where the pose has them, root mean square per coordinate; NaN without any
    """

    expected: int
    found: int
    off_px: float


def markers_at_pose(
    image: NDArray[np.generic], camera: Camera, pose: Pose, markers: MarkerSet, mesh: Mesh | None, polarity: str
) -> AtPose | None:
    """Look for the markers near their places; None where no picture or table tells their size.

    Of both polarities the one that finds more counts where ``polarity`` is "auto". Markers that the grid hides are not
    expected.
    """
    if (of_model := markers.role != "wall").any():  # walls do not move with a model that is at its pose
        markers = markers.take(np.flatnonzero(of_model))
    if not np.isfinite(markers.radius).all():
        return None
    if mesh is not None:
        markers = markers.take(np.flatnonzero(sight(markers, mesh)(pose, camera)))
    expected = from_camera(camera, pose, markers)
    if not len(expected):
        return AtPose(0, 0, np.nan)
    best = AtPose(len(expected), 0, np.nan)
    for kind in ("dark", "bright") if polarity == AUTO else (polarity,):
        try:
            seen = look(image, expected, search_px=SEARCH_PX, polarity=kind)
        except WindmarkError:  # nothing in the picture tells its noise
            continue
        off = (seen.xy - expected.xy)[seen.found]
        if len(off) > best.found:
            best = AtPose(len(expected), len(off), float(np.sqrt((off**2).mean())))
    return best
