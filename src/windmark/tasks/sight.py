"""Which markers the grid does not hide."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from windmark import resection
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Mesh

UNDER_GRID = 2e-3
"""A marker's table place may lie so far under the grid's flat triangles (part of `Mesh.sizes`) without being hidden."""
HIDDEN = resection.REASONS.index("hidden")


def sight(markers: MarkerSet, mesh: Mesh) -> Callable[[Pose, Camera], NDArray[np.bool_]]:
    """What registration asks: which markers the grid does not hide."""
    under = UNDER_GRID * mesh.sizes

    def visible(cam_from_model: Pose, camera: Camera) -> NDArray[np.bool_]:
        seen = resection.see_points(markers.xyz, camera, cam_from_model, mesh=mesh, tolerance=under)
        return np.asarray(seen.reason != HIDDEN)

    return visible
