"""Points that hang beside a surface, and the mirror image of the surface that would go through them.

A body that is symmetric carries its markers under the mirror image of its grid as well, so only what is not symmetric
tells it: a few markers in the air beside a surface on which all others lie. Markers on a part that is not in the grid
hang in the same way, but no mirror image goes through them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.scene import Mesh

Array = NDArray[np.float64]

LEAD = 6.0
"""Nats by which a mirror image has to explain the points better than chance."""
LOST = 0.1
"""Points that a right mirror image may lose, of those that it gains: one that is right loses none but odd ones."""
STILL = 0.5
"""Part of the points off the surface that a mirror image may leave there: another part may lack as well."""
LIKELY = (1e-3, 0.5)
"""Bounds of the chance that a place near a surface is on it."""


@dataclass(frozen=True)
class Mirrored:
    """A plane about which the surface, mirrored, goes through points that are off it.

    Parameters
    ----------
    axis : 0, 1 or 2, the coordinate that is mirrored
    about : its value at the plane
    gained : points that the mirror image goes through, and the surface as it is does not
    still : points that it does not go through
    lead : nats by which it explains the points better than chance
    """

    axis: int
    about: float
    gained: int
    still: int
    lead: float


def mirrored(
    mesh: Mesh, points: Array, off: NDArray[np.bool_], within: float, distance: Callable[[Array], Array]
) -> Mirrored | None:
    """The mirror image of a surface that goes through points (N, 3) which it is beside; None where none does clearly.

    Parameters
    ----------
    off : (N,) points farther than ``within`` from the surface
    within : distance up to which a point is on the surface
    distance : of points (N, 3) from the surface (N,), any number beyond ``within`` where they are farther

    Notes
    -----
    Planes across an axis through the origin (files have one half with a sign changed), through the middle of the grid
    and of what of it the points are on. Every point that a mirror image gains speaks for it by the logarithm of the
    part of the space that the surface fills within that distance; one that it loses contradicts it, so a grid of one
    half of a model with markers on both is not taken for the mirror image of the other half.
    """
    if not off.any():
        return None
    planes = _planes(mesh, points[~off], within)
    low, high = mesh.box
    room = float(np.prod(np.maximum(high - low, within)))
    chance = 2 * within * float(np.linalg.norm(mesh.triangle_normals(), axis=1).sum()) / 2 / room
    each, best = -np.log(np.clip(chance, *LIKELY)), None
    for axis, about in planes:
        image = points.copy()
        image[:, axis] = 2 * about - image[:, axis]
        # The points that are off first: of most planes none of them is gained, and the rest needs no look.
        gained = int((distance(image[off]) <= within).sum())
        lead = gained * each - np.log(len(planes))
        if lead <= max(LEAD, best.lead if best else 0.0) or off.sum() - gained > STILL * off.sum():
            continue
        lost = int((distance(image[~off]) > within).sum()) if (~off).any() else 0
        if lost <= LOST * gained:
            best = Mirrored(axis, about, gained, int(off.sum()) - gained + lost, float(lead))
    return best


def _planes(mesh: Mesh, on: Array, within: float) -> list[tuple[int, float]]:
    """Axis and place of the planes that are tried, each once."""
    boxes = [np.stack(mesh.box)] + ([np.stack([on.min(axis=0), on.max(axis=0)])] if len(on) else [])
    piece = mesh.pieces
    largest = np.argmax(np.bincount(piece)) if len(piece) else 0
    corners = mesh.vertices[np.unique(mesh.triangles[piece == largest])]
    boxes.append(np.stack([corners.min(axis=0), corners.max(axis=0)]))
    out: list[tuple[int, float]] = []
    for axis in range(3):
        for about in [0.0, *(float(box[:, axis].mean()) for box in boxes)]:
            if all(k != axis or abs(c - about) > 0.1 * within for k, c in out):
                out.append((axis, about))
    return out
