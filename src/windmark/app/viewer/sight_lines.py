"""The line of sight through a spot, as the cameras of the other pictures see it: their epipolar lines, lens included.

All poses are in the model's frame, so pictures of a model that moved between them belong together, too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.app.viewer.spots import spot_of
from windmark.errors import UsageError
from windmark.pipeline.results import ImageResult, RunResult

Array = NDArray[np.float64]
SAMPLES = 240
MARGIN = 0.05
"""The line is drawn for all depths of the model, and so much of their range beyond."""


def lines_of_sight(item: ImageResult, result: RunResult, spot: Any) -> dict[str, list[list[float]]]:
    """Image -> (x, y) along the line there, pixels; images without a pose, or that do not see any of it, have none.

    Raises
    ------
    UsageError
        For an unknown spot, a picture without a pose, and where there is neither a grid nor a marker.
    """
    if item.cam_from_model is None:
        raise UsageError(f"{item.name} has no pose, so its lines of sight are not known")
    points = _along(item, result, np.asarray(spot_of(item, spot)[1]))
    out = {}
    for other in result.images:
        if other is item or other.cam_from_model is None:
            continue
        xy, valid = other.camera.project(other.cam_from_model.apply(points))
        # The run of neighbours that are in the picture, with one beyond either end.
        inside = np.flatnonzero(valid & other.camera.in_image(xy))
        if len(inside):
            part = slice(max(inside[0] - 1, 0), inside[-1] + 2)
            out[other.name] = np.round(xy[part][valid[part]], 2).tolist()
    return out


def _along(item: ImageResult, result: RunResult, xy: Array) -> Array:
    """(S, 3) points of the model's frame on the line of sight of a pixel, at all depths of the model."""
    pose = item.cam_from_model
    assert pose is not None
    known = [result.mesh.vertices[result.mesh.used]] if result.mesh is not None else []
    known += [] if result.markers is None else [result.markers.xyz]
    model = np.concatenate(known) if known else np.zeros((0, 3))
    if not len(model):
        raise UsageError("there is neither a grid nor a marker, so nothing says how deep the model is")
    direction = item.camera.directions(xy) @ pose.rotation
    depth = (model - pose.center) @ direction
    margin = MARGIN * float(np.ptp(depth))
    near = max(float(depth.min()) - margin, 1e-3 * float(depth.max()))
    if not (np.isfinite(direction).all() and near < depth.max()):
        raise UsageError("the line of sight of this spot does not pass the model")
    return np.asarray(pose.center + np.linspace(near, float(depth.max()) + margin, SAMPLES)[:, None] * direction)
