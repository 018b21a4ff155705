"""Which side of the markers the cameras saw: a mirrored table or mirrored pictures.

Markers in a plane leave the same residuals when the table, or every picture, is mirrored: the cameras come out on the
other side of the plane. Two things tell: the table's normals, which say the printed side, and relief, which comes out
turned over. Without either nothing in the data does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.calibration.result import Calibration
from windmark.geometry import Pose
from windmark.scene import Doubt, MarkerSet, Observations

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST = 0.5
"""Part of the marks that must be seen from behind: single normals that are wrong are no mirror."""
SURE = 5.0
"""Standard deviations by which relief must be there, or be turned over."""
LEAST = 1e-6
"""Relief as part of the markers' size below which a table has none."""


def mirror_doubts(
    table: MarkerSet, points: Array, seen: Mask, observations: Observations, used: Mask, poses: list[Pose]
) -> tuple[Doubt, ...]:
    """What says that table or pictures are mirrored.

    Parameters
    ----------
    table : the markers as they were given, with the normals that it has
    points, seen : (N, 3) where they are in the table's frame, and (N,) which took part
    observations, used : all marks (O), and (O,) which were used
    poses : ``cam_from_model`` of every view
    """
    behind, asked = _from_behind(table, points, observations, used, poses)
    if asked and behind > MOST * asked:
        words = (
            f"{behind} of {asked} marks are on the back of their markers, by the normals of the table: the table or "
            "the pictures are mirrored, or the normals point into the model"
        )
        return (Doubt((), words, "mirrored"),)
    if relief(table.xyz[seen], points[seen]) < -SURE:
        words = "the markers' relief came out turned over, hollows stand out: the table or the pictures are mirrored"
        return (Doubt((), words, "mirrored"),)
    return ()


def side_unseen(table: MarkerSet, result: Calibration) -> str:
    """Why nothing tells whether table or pictures are mirrored, in words; empty where something does."""
    took = np.isin(table.name, result.markers.name)
    own = table.take(took)
    order = np.argsort(result.markers.name)
    at = order[np.searchsorted(result.markers.name[order], own.name)]
    if np.isfinite(own.normal).all(axis=1).any() or abs(relief(own.xyz, result.markers.xyz[at])) > SURE:
        return ""
    return (
        f"the cameras came out on the {_side(result)} side of the markers' plane. See that they stood there: the table "
        "has no normals, and if it or the pictures were mirrored, all would fit as well"
    )


def _side(result: Calibration) -> str:
    """The axis of the table along which the cameras stand before the markers' plane: +z, -x, ..."""
    middle = result.markers.xyz.mean(axis=0)
    normal = np.linalg.svd(result.markers.xyz - middle, full_matrices=False)[2][2]
    stations = np.array([result.pose(v.name).center for v in result.views])
    normal *= np.sign(np.median((stations - middle) @ normal))
    axis = int(np.abs(normal).argmax())
    return f"{'+' if normal[axis] > 0 else '-'}{'xyz'[axis]}"


def relief(table: Array, points: Array) -> float:
    """Standard deviations by which heights (N, 3) over a plane are those of the table, negative: turned over; 0 where
    the table is flat.
    """
    middle = table.mean(axis=0)
    _, size, axes = np.linalg.svd(table - middle, full_matrices=False)
    if len(table) < 4 or not size[2] > LEAST * size[0]:
        return 0.0
    design = np.column_stack([np.ones(len(table)), (table - middle) @ axes[:2].T])
    there = (points - middle) @ axes[2]
    there -= design @ np.linalg.lstsq(design, there, rcond=None)[0]
    slope = float(there @ ((table - middle) @ axes[2])) / size[2] ** 2
    left = there - slope * ((table - middle) @ axes[2])
    spread = float(np.sqrt(left @ left / max(len(table) - 4, 1))) / size[2]
    return slope / max(spread, 1e-12)


def _from_behind(
    table: MarkerSet, points: Array, observations: Observations, used: Mask, poses: list[Pose]
) -> tuple[int, int]:
    """Used marks on the back of their markers, and all used ones of markers that have a normal."""
    if not np.isfinite(table.normal).all(axis=1).any():
        return 0, 0
    stations = np.array([p.center for p in poses]).reshape(-1, 3)
    view, point = observations.view[used], observations.point[used]
    facing = np.einsum("oi,oi->o", table.normal[point], stations[view] - points[point])
    facing = facing[np.isfinite(facing)]
    return int((facing < 0).sum()), len(facing)
