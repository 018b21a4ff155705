"""The second part of the main job: what images with known poses show of the grid, all in the same views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark import resection
from windmark.geometry import Camera, Pose
from windmark.pipeline.clock import Clock, Progress
from windmark.pipeline.project import Project, ResectOptions, SectionEntry
from windmark.pipeline.results import FramedView, ImageResult, SectionValues, ViewImage
from windmark.pipeline.views import frame_view, units_per_px
from windmark.resection import PixelMap
from windmark.scene import Mesh

Array = NDArray[np.float64]


def frame_views(project: Project, mesh: Mesh) -> tuple[FramedView, ...]:
    """The virtual cameras of a job: one per ``[[view]]``, the same for all its images and cameras.

    They are framed on the nodes of the grid that take part, whatever the images show of them, so that a picture
    of one job can be laid over that of another with the same grid, and no failed image moves the others.

    Raises
    ------
    ValueError
        When a view cannot be framed, naming it.
    """
    surface = mesh.vertices[mesh.used]
    framed = []
    for entry in project.view:
        try:
            camera, pose = frame_view(
                surface, direction=entry.direction, up=entry.up, size_px=entry.size_px, fov_deg=entry.fov_deg
            )
        except ValueError as error:
            raise ValueError(f"view {entry.name}: {error}") from error
        framed.append(FramedView(entry.name, camera, pose, units_per_px(camera, pose, surface)))
    return tuple(framed)


def map_views(framed: Sequence[FramedView], mesh: Mesh) -> tuple[PixelMap, ...]:
    """Which point of the surface each pixel of each view shows; made once for all images."""
    return tuple(resection.map_pixels(mesh, view.camera, view.cam_from_model) for view in framed)


def map_image(
    result: ImageResult,
    project: Project,
    mesh: Mesh,
    framed: Sequence[FramedView],
    pixels: Sequence[PixelMap],
    progress: Progress,
) -> ImageResult:
    """Values of one located image on nodes, in views and along sections; as it is where it has no pose.

    ``framed`` are the views and ``pixels`` their maps. A failure that the data cause becomes ``problem``.
    """
    options, pose, image = project.resect, result.cam_from_model, result.image
    if pose is None or image is None:
        return result
    clock = Clock(progress, result.name)
    try:
        with clock("visibility"):
            nodes = resection.see_nodes(mesh, result.camera, pose, max_obliquity_deg=options.max_obliquity_deg)
        with clock("node values"):
            values = resection.node_values(image, nodes, interpolation=options.interpolation)
        views: list[ViewImage] = []
        sections: list[SectionValues] = []
        if project.view and not nodes.visible.any():
            raise ValueError("no node of the grid is visible in the image, there is nothing to show in the views")
        for view, seen in zip(framed, pixels, strict=True):
            with clock("virtual images"):
                views.append(_view(view, seen, image, result.camera, pose, options))
        for cut in project.section:
            with clock("sections"):
                sections.append(_section(cut, image, result.camera, pose, mesh, options))
        result = replace(result, nodes=nodes, values=values, views=tuple(views), sections=tuple(sections))
        if project.output.pixels:
            with clock("pixel map"):
                result = replace(result, pixels=resection.map_pixels(mesh, result.camera, pose))
    except ValueError as error:
        result = replace(result, problem=str(error))
    return replace(result, seconds={**result.seconds, **clock.seconds})


def _view(
    view: FramedView,
    pixels: PixelMap,
    image: NDArray[np.generic],
    camera: Camera,
    cam_from_model: Pose,
    options: ResectOptions,
) -> ViewImage:
    values, valid = resection.virtual_image(image, pixels, camera, cam_from_model, interpolation=options.interpolation)
    return ViewImage(view.name, values, valid, view.camera, view.cam_from_model, view.units_per_px)


def _section(
    entry: SectionEntry,
    image: NDArray[np.generic],
    camera: Camera,
    cam_from_model: Pose,
    mesh: Mesh,
    options: ResectOptions,
) -> SectionValues:
    """Values along a plane cut of the surface; NaN where the camera does not see it."""
    cut = resection.section(mesh, entry.point, entry.normal, spacing=entry.spacing)
    if not len(cut):
        raise ValueError(f"section {entry.name}: the plane does not meet the grid; check its point and normal")
    seen = resection.see_points(cut.xyz, camera, cam_from_model, mesh=mesh)
    values = resection.node_values(image, seen, interpolation=options.interpolation)
    return SectionValues(entry.name, cut.line, cut.arc, cut.xyz, values)


def align_images(images: Sequence[ImageResult], project: Project, mesh: Mesh) -> list[ImageResult]:
    """3D alignment (the paper's section III.D): every image as seen from the reference's pose."""
    assert project.align is not None
    reference = next(i for i in images if i.name == project.align.reference)
    if reference.cam_from_model is None:
        why = f"not aligned: the reference image {reference.name} has no pose"
        return [replace(i, problem=i.problem or why) for i in images]
    pixels = resection.map_pixels(mesh, reference.camera, reference.cam_from_model)
    return [_aligned(item, pixels, project.resect) for item in images]


def _aligned(item: ImageResult, pixels: PixelMap, options: ResectOptions) -> ImageResult:
    if item.cam_from_model is None or item.image is None:
        return item
    values, _ = resection.virtual_image(
        item.image, pixels, item.camera, item.cam_from_model, interpolation=options.interpolation
    )
    return replace(item, aligned=values)
