"""In which unit numbers are that do not fit beside others: markers and points belong on the grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.scene import Mesh
from windmark.scene.units import IN_MM

Array = NDArray[np.float64]
Box = tuple[Array, Array]

FEW = 4
"""Points that say something about a size; fewer may be anywhere."""
LEAST_PART, MOST_PART = 0.2, 1.3
"""Size of markers over that of the grid that bears them, where they are spread over it."""
TOO_SMALL, BESIDE = 0.1, 0.1
"""Points of a smaller part of the grid's size may be in another unit; so are those of which so few are at the grid, if
they are there in that other unit."""
MOST = 0.9
"""As many must be at the grid to be taken for its markers."""


def model_box(mesh: Mesh) -> Box:
    """Lowest and highest coordinates of what is of the size that most of the grid is of: without its far field."""
    if not len(mesh.triangles):
        return mesh.box
    near = np.unique(mesh.triangles[mesh.sizes <= mesh.size])
    nodes = mesh.vertices[near]
    return nodes.min(axis=0), nodes.max(axis=0)


def likely_unit(points: Array, box: Box, unit: str, *, of_surface: bool = False) -> tuple[list[str], bool]:
    """The units in which points may be, where they do not fit the surface that should bear them.

    Parameters
    ----------
    points : (N, 3) taken in ``unit``
    box : `model_box` of the surface, in ``unit``
    unit : one of `LENGTH_UNITS`
    of_surface : whether the points are right, and the surface is in another unit

    Returns
    -------
    units, sure
        The units in which they would be at the surface and spread over it, that in which they are spread most first;
        ``sure`` where in ``unit`` they are beside it. None where they fit as they are, or in no unit.
    """
    size = float(np.linalg.norm(box[1] - box[0]))
    if len(points) < FEW or not (np.isfinite(size) and size > 0.0):
        return [], False
    own = float(np.linalg.norm(np.ptp(points, axis=0))) / size
    at = _at(points, box, size)
    if TOO_SMALL <= own <= MOST_PART and at > BESIDE:
        return [], False
    fitting = {}
    for other in IN_MM:
        factor = (IN_MM[other] / IN_MM[unit]) ** (-1 if of_surface else 1)  # of the points beside the surface as it is
        if other != unit and LEAST_PART < own * factor < MOST_PART and _at(points * factor, box, size) >= MOST:
            fitting[other] = own * factor
    return sorted(fitting, key=fitting.__getitem__, reverse=True), at <= BESIDE


def _at(points: Array, box: Box, size: float) -> float:
    """The part of points (N, 3) that is in a box, or beside it by no more than a twentieth of its size."""
    room = size / 20
    return float(((points >= box[0] - room) & (points <= box[1] + room)).all(axis=1).mean())
