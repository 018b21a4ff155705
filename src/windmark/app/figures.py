"""The pictures of a result: which arrays of it go into which of `pictures`."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from windmark.app import pictures
from windmark.errors import UsageError
from windmark.pipeline.outputs import projected_xy
from windmark.pipeline.results import ImageResult, RunResult
from windmark.pipeline.surface import surface_view
from windmark.pipeline.wireframe import grid_lines
from windmark.scene import MarkerSet, Mesh


def matched(item: ImageResult, markers: MarkerSet) -> tuple[list[str], NDArray[np.float64], NDArray[np.float64]]:
    """Names, projected places and residuals (projected − detected) of the matched markers."""
    answer = item.registered
    if answer is None or item.detections is None:
        raise UsageError(f"image {item.name} is not registered, it has no matches to draw")
    projected = projected_xy(answer, item.detections)
    names = [str(n) for n in markers.name[answer.matching.marker]]
    return names, projected, answer.residuals


def matching_figure(item: ImageResult, markers: MarkerSet) -> Figure:
    """Which spot is which marker, over the image."""
    names, projected, _ = matched(item, markers)
    answer = item.registered
    assert answer is not None
    assert item.image is not None
    assert item.detections is not None
    missing = np.setdiff1d(item.expected if item.expected is not None else [], answer.matching.marker)
    missing_xy = answer.camera.project(answer.cam_from_model.apply(markers.xyz[missing]))[0]
    return pictures.matching_picture(
        item.image, item.detections, answer.matching.detection, names, projected,
        missing_xy, [str(n) for n in markers.name[missing]], item.name,
    )  # fmt: skip


def wireframe_figure(item: ImageResult, mesh: Mesh) -> Figure:
    """Visible grid lines over the image."""
    assert item.image is not None
    assert item.nodes is not None
    return pictures.wireframe_picture(
        item.image, grid_lines(mesh, item.nodes), f"{item.name}: the grid over the image"
    )  # fmt: skip


def surface_figure(item: ImageResult, mesh: Mesh) -> Figure:
    """The values on the surface, from a little higher and more to the left than the camera, so that relief shows."""
    pose, nodes, values = item.cam_from_model, item.nodes, item.values
    assert pose is not None
    assert nodes is not None
    assert values is not None
    seen = mesh.vertices[nodes.visible]
    ahead = seen.mean(axis=0) - pose.center
    right, down = pose.rotation[0], pose.rotation[1]
    direction = ahead / np.linalg.norm(ahead) + 0.35 * down + 0.5 * right
    shown = surface_view(mesh, values, direction=direction, up=-down, focus=seen)
    title = f"{item.name} mapped onto the surface"
    return pictures.surface_picture(shown.value, shown.shade, title, item.quantity.label)


def alignment_figure(item: ImageResult, result: RunResult) -> Figure | None:
    """Difference to the reference before and after alignment; None for the reference itself and where there is none."""
    if result.project.align is None or item.aligned is None or item.image is None:
        return None
    reference = next(i for i in result.images if i.name == result.project.align.reference)
    if reference is item or reference.image is None:
        return None
    taken = item.quantity.of(item.image)
    return pictures.alignment_picture(
        reference.quantity.of(reference.image), taken, item.aligned, item.name, item.quantity.label
    )
