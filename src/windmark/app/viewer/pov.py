"""The viewer's point of view: the grid as a camera in any place would see it, and the virtual image from there.

The seven numbers are the paper's (AIAA 2005-5007, Fig. 5; `PoV`). The picture's own lens stays: only its focal length
follows the field of view.
"""

from __future__ import annotations

import io as byte_io
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from windmark import io, resection
from windmark.app.photo import greys, polyline
from windmark.errors import DataError, UsageError
from windmark.geometry import Camera, Pose, PoV
from windmark.pipeline.project_entries import ResectOptions
from windmark.pipeline.results import ImageResult, RunResult
from windmark.pipeline.views import frame_view, perfect_camera
from windmark.pipeline.wireframe import grid_lines

Array = NDArray[np.float64]
NUMBERS = ("rx", "ry", "rz", "dx", "dy", "dz", "fov")
WIDEST_DEG = 170.0
"""Field of view of a virtual image, as of a project's ``[[view]]``."""
LINES_PER_BLOCK, EDGES = 16, 4000
"""Of the grid, as in a report's pictures."""


def first_pov(item: ImageResult, result: RunResult) -> PoV:
    """Where the sliders begin: at the image's pose; without one, at that of its camera's file, else over the model."""
    pose = item.cam_from_model or item.published
    if pose is None:
        points = np.zeros((0, 3)) if result.mesh is None else result.mesh.vertices[result.mesh.used]
        if not len(points) and result.markers is not None:
            points = result.markers.xyz
        pose = _above(points, item.camera)
    return replace(pose.to_pov(), fov_deg=item.camera.fov_deg)


def _above(points: Array, camera: Camera) -> Pose:
    if len(points) < 2:
        return Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 1.0]))
    fov = min(camera.fov_deg, 120.0)
    return frame_view(points, direction=(0, 0, -1), up=(0, 1, 0), size_px=camera.size_px, fov_deg=fov)[1]


def read_pov(said: Mapping[str, Any]) -> PoV:
    """The seven numbers of a request.

    Raises
    ------
    UsageError
        Where one is missing, no finite number, or the field of view is not between 0 and 360 degrees.
    """
    values = []
    for name in NUMBERS:
        value = said.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise UsageError(f"{name} must be a number, got {str(value)[:40]!r}")
        values.append(float(value))
    if not 0 < values[6] < 360:
        raise UsageError(f"fov must be above 0 and below 360 degrees, got {values[6]:g}")
    return PoV(*values)


def camera_at(camera: Camera, pov: PoV) -> Camera:
    """The camera with the field of view of ``pov``, the rest of its lens as it is.

    Raises
    ------
    UsageError
        For 180 degrees and more with a lens that is no fisheye.
    """
    width = camera.size_px[0]
    focal = width / math.radians(pov.fov_deg) if camera.lens == "fisheye" else pov.focal_px(width)
    return replace(camera, focal_px=focal, cov=None)


def seen_at(item: ImageResult, result: RunResult, pov: PoV) -> dict[str, Any]:
    """What the picture's camera would see from ``pov``: grid lines as an SVG path, markers, and how well they fit.

    ``markers``: [name, x, y] of those that the camera has in its picture; ``rms`` of the distances of the matched
    markers to their spots, pixels, None where there are none.
    """
    camera, pose = camera_at(item.camera, pov), pov.pose
    out: dict[str, Any] = {"path": "", "nodes": 0, "markers": [], "rms": None}
    if result.mesh is not None:
        view = resection.see_nodes(result.mesh, camera, pose, max_obliquity_deg=result.project.resect.max_obliquity_deg)
        lines = grid_lines(result.mesh, view, per_block=LINES_PER_BLOCK, edges=EDGES)
        out |= {"path": "".join(polyline(line, 1.5) for line in lines), "nodes": int(view.visible.sum())}
    if result.markers is not None:
        xy, valid = camera.project(pose.apply(result.markers.xyz))
        inside = np.flatnonzero(valid & camera.in_image(xy))
        out["markers"] = [[str(result.markers.name[k]), *np.round(xy[k], 2).tolist()] for k in inside]
        answer = item.registered
        if answer is not None and item.detections is not None and len(answer.matching):
            apart = xy[answer.matching.marker] - item.detections.xy[answer.matching.detection]
            rms = float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))
            out["rms"] = rms if math.isfinite(rms) else None
    return out


def virtual_view(item: ImageResult, result: RunResult, pov: PoV, kind: str) -> tuple[bytes, int]:
    """The image as a perfect camera at ``pov`` would see the surface, as a file, and how many pixels have a value.

    ``kind``: "tiff" has the values themselves (float32, NaN where there is none), "png" grey levels for showing
    (0.5 to 99.5 % of the values stretched over 8 bits, transparent where there is none).

    Raises
    ------
    UsageError
        Without a grid or a pose, for an unknown kind and a field of view of over 170 degrees.
    DataError
        Where no pixel of it shows what the image has seen.
    """
    if kind not in ("png", "tiff"):
        raise UsageError(f"a virtual view is written as png or tiff, got {kind[:20]!r}")
    if result.mesh is None:
        raise UsageError("a virtual view needs a grid: add [grid] file = ... to the project")
    if item.image is None or item.cam_from_model is None:
        raise UsageError(f"{item.name} has no pose, so nothing is known of where its pixels are on the model")
    if pov.fov_deg > WIDEST_DEG:
        raise UsageError(f"a virtual view has at most {WIDEST_DEG:g} degrees, got {pov.fov_deg:g}")
    values, valid = _virtual(item, result, pov, result.project.resect)
    if not valid.any():
        raise DataError(f"from there nothing of what {item.name} shows of the surface is in the picture")
    if kind == "tiff":
        with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            place = Path(folder) / "view.tif"
            io.write_image(place, values, description=item.quantity.words)
            return place.read_bytes(), int(valid.sum())
    stream = byte_io.BytesIO()
    alpha = np.where(np.isfinite(values), 255, 0).astype(np.uint8)
    Image.fromarray(np.dstack([np.asarray(greys(values)), alpha])).save(stream, "png")
    return stream.getvalue(), int(valid.sum())


def _virtual(
    item: ImageResult, result: RunResult, pov: PoV, options: ResectOptions
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    assert result.mesh is not None
    assert item.image is not None
    assert item.cam_from_model is not None
    pixels = resection.map_pixels(result.mesh, perfect_camera(item.camera.size_px, pov.fov_deg), pov.pose)
    return resection.virtual_image(
        item.quantity.of(item.image), pixels, item.camera, item.cam_from_model, interpolation=options.interpolation
    )
