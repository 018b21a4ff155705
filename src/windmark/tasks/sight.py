"""Which markers the grid does not hide."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.resection.reasons import VISIBLE
from windmark.resection.visibility import look
from windmark.scene import MarkerSet, Mesh
from windmark.scene.triangle_tree import TriangleTree

UNDER_GRID = 2e-3
"""A marker's table place may lie so far under the grid's flat triangles (part of `Mesh.sizes`) without being hidden."""


def sight(markers: MarkerSet, mesh: Mesh) -> Callable[[Pose, Camera], NDArray[np.bool_]]:
    """What registration asks, of hundreds of poses: which markers the grid does not hide.

    As `resection.see_points` with a tolerance of `UNDER_GRID`, by a tree that is made once.
    """
    if not len(mesh.triangles):
        return lambda cam_from_model, camera: np.ones(len(markers), bool)
    tree = TriangleTree.of(mesh)
    under = UNDER_GRID * mesh.sizes[tree.order]

    def visible(cam_from_model: Pose, camera: Camera) -> NDArray[np.bool_]:
        out = np.ones(len(markers), bool)
        asked = np.flatnonzero(look(camera, cam_from_model, markers.xyz)[2] == VISIBLE)
        out[asked] = ~tree.hides(cam_from_model.center, markers.xyz[asked], under)
        return out

    return visible
