"""The second part of the main job: what images with known poses show of the grid, all in the same views."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from windmark import resection
from windmark.errors import DataError, WindmarkError
from windmark.geometry import Camera, Pose
from windmark.pipeline.clock import Clock, Progress
from windmark.pipeline.light import full_pixels
from windmark.pipeline.merge import picture_of
from windmark.pipeline.points import PointSet, image_points
from windmark.pipeline.project import Project
from windmark.pipeline.project_entries import ResectOptions, SectionEntry
from windmark.pipeline.results import FramedView, ImageResult, SectionValues, ViewImage
from windmark.resection import NodeView, PixelMap
from windmark.resection.sources import prepare, value_variance
from windmark.scene import Mesh
from windmark.scene.levels import missing_at
from windmark.tasks.black import black_pixels

Array = NDArray[np.float64]
S = TypeVar("S")
T = TypeVar("T")


def map_views(
    framed: Sequence[FramedView], mesh: Mesh
) -> tuple[tuple[FramedView, ...], tuple[PixelMap, ...], tuple[str, ...]]:
    """Which point of the surface each pixel of each view shows; made once for all images.

    Gives the views that show any surface, their maps, and why the others are left out.
    """
    good: list[tuple[FramedView, PixelMap]] = []
    lost: list[str] = []
    for view in framed:
        pixels = resection.map_pixels(mesh, view.camera, view.cam_from_model)
        if pixels.valid.any():
            good.append((view, pixels))
        else:
            lost.append(f"view {view.name}: no pixel shows the surface; check its point of view")
    return tuple(view for view, _ in good), tuple(pixels for _, pixels in good), tuple(lost)


def map_image(
    result: ImageResult,
    project: Project,
    mesh: Mesh,
    framed: Sequence[FramedView],
    pixels: Sequence[PixelMap],
    progress: Progress,
    points: tuple[PointSet, ...] = (),
) -> ImageResult:
    """Values of one located image on nodes, in views, along sections and at points; as it is where it has no pose.

    ``framed`` are the views and ``pixels`` their maps. A failure that the data cause becomes ``problem``; that of a
    view or a section costs only itself and becomes a line of ``left_out``.
    """
    options, pose = project.resect, result.cam_from_model
    if pose is None or result.image is None:
        return result
    clock = Clock(progress, result.name)
    try:
        with clock("pixel map"):
            seen = resection.map_pixels(mesh, result.camera, pose)
            result = replace(result, black=black_pixels(result.image, seen.valid))
        image = result.light
        with clock("visibility"):
            nodes = resection.see_nodes(mesh, result.camera, pose, max_obliquity_deg=options.max_obliquity_deg)
        with clock("node values"):
            values = resection.node_values(image, nodes, interpolation=options.interpolation)
        lost: list[str] = []
        if not nodes.visible.any():
            counted = _counted(nodes)
            raise DataError(f"no node of the grid is visible ({counted}): is the pose of its frame and unit?")
        with clock("virtual images"):
            views = _each(
                zip(framed, pixels, strict=True), lambda of: _view(*of, image, result.camera, pose, options), lost
            )
        with clock("sections"):
            sections = _each(
                project.section, lambda cut: _section(cut, image, result.camera, pose, mesh, options), lost
            )
        with clock("sigma of values"):
            source = prepare(picture_of(result, image), mesh, options.interpolation, "map_image", seen)
            sigma = np.sqrt(value_variance(source, nodes, mesh.vertices, values.astype(float))).astype(np.float32)
        with clock("points and lines"):
            tables = image_points(points, source, mesh, max_obliquity_deg=options.max_obliquity_deg)
        result = replace(result, nodes=nodes, values=values, sigma=sigma, views=views, sections=sections, points=tables,
                         left_out=tuple(lost))  # fmt: skip
        result = replace(_without_lost(result, image, project), smoothed=_smoothed(source.noise, result.apart))
        if project.output.pixels:
            result = replace(result, pixels=seen)
    except WindmarkError as error:
        result = replace(result, problem=str(error))
    return replace(result, seconds={**result.seconds, **clock.seconds})


def _smoothed(noise: object, apart: int) -> str:
    """What is to be said of a picture whose noise is not of each pixel alone, though it comes from no mosaic."""
    if not isinstance(noise, resection.NoiseLaw) or noise.alike == 0.0 or apart > 1:
        return ""
    times = 1 / np.sqrt(max(1 - noise.alike, 1e-6))
    return (
        f"pixels a few apart scatter {times:.1f} times as much as neighbours do, as where a picture was smoothed or "
        "enlarged: that is in the sigmas of its values, which a fine texture of the surface would make too large"
    )


def _without_lost(result: ImageResult, light: NDArray[np.generic], project: Project) -> ImageResult:
    """An image with what is said of its nodes that have no value because their pixels are clipped, hot or dead."""
    assert result.image is not None
    assert result.nodes is not None
    assert result.values is not None
    if light.dtype.kind != "f" or np.isfinite(light).all():
        return result
    known = partial(resection.node_values, view=result.nodes, interpolation=project.resect.interpolation)
    stored = np.isfinite(known(result.image))
    full, level = full_pixels(result.image, result.mixed)
    not_full = missing_at(result.image, full)
    lit, bright = np.isfinite(known(not_full)), np.isfinite(known(missing_at(not_full, result.black)))
    shown, gone, dark, dead = (
        int(which.sum()) for which in (stored, stored & ~lit, lit & ~bright, bright & ~np.isfinite(result.values))
    )
    having = f"of {shown} nodes that it shows have no value: their pixels"
    if gone:
        said = f"{gone} {having} are saturated, {level}"
        result = replace(result, saturated=said, saturated_part=gone / shown)
    if dark:
        said = f"{dark} {having} are clipped at black, where their noise ends, or beside such"
        result = replace(result, dark=said, dark_part=dark / shown)
    if dead:
        result = replace(result, dead=f"{dead} {having} are hot or dead ones, or beside such")
    return result


def _each(items: Iterable[S], make: Callable[[S], T], lost: list[str]) -> tuple[T, ...]:
    """What can be made of the items; the reasons of the others are added to ``lost``."""
    made = []
    for item in items:
        try:
            made.append(make(item))
        except WindmarkError as error:
            lost.append(str(error))
    return tuple(made)


def _counted(nodes: NodeView) -> str:
    """Why the nodes are not seen."""
    return ", ".join(f"{count} {why}" for why, count in nodes.counts.items() if count)


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
        raise DataError(f"section {entry.name}: the plane does not meet the grid; check its point and normal")
    seen = resection.see_points(cut.xyz, camera, cam_from_model, mesh=mesh)
    values = resection.node_values(image, seen, interpolation=options.interpolation)
    return SectionValues(entry.name, cut.line, cut.arc, cut.xyz, values)


def align_images(images: Sequence[ImageResult], project: Project, mesh: Mesh) -> list[ImageResult]:
    """3D alignment (the paper's section III.D): every image as seen from the reference's pose.

    The grid moves with the model. Pixels that show none of it in the reference are NaN, or, on demand, what stands
    still: the image's own pixels, where the model does not hide it in that image. What cannot be aligned costs only the
    alignment: pose and values of that image are what they are, and it becomes a line of ``left_out``.
    """
    assert project.align is not None
    reference = next(i for i in images if i.name == project.align.reference)
    if reference.cam_from_model is None:
        why = f"not aligned: the reference image {reference.name} has no pose"
        return [_not_aligned(i, why) for i in images]
    pixels = resection.map_pixels(mesh, reference.camera, reference.cam_from_model)
    wanted = reference.quantity.column
    other = f"not aligned: its values are not {wanted}, as those of the reference, but "
    aligned = [
        _aligned(item, pixels, project.resect)
        if item.quantity.column == wanted
        else _not_aligned(item, other + item.quantity.column)
        for item in images
    ]
    if project.align.background == "keep":
        aligned = [_with_background(item, pixels, still=item.name == reference.name) for item in aligned]
    return aligned


def _not_aligned(item: ImageResult, why: str) -> ImageResult:
    """An image that keeps all but its alignment; of one that went wrong itself that is enough."""
    return item if item.problem else replace(item, left_out=(*item.left_out, why))


def _aligned(item: ImageResult, pixels: PixelMap, options: ResectOptions) -> ImageResult:
    if item.cam_from_model is None or item.image is None:
        return item
    values, _ = resection.virtual_image(
        item.light, pixels, item.camera, item.cam_from_model, interpolation=options.interpolation
    )
    return replace(item, aligned=values)


def _with_background(item: ImageResult, pixels: PixelMap, *, still: bool) -> ImageResult:
    """The aligned image with what stands still behind the model, as this image shows it.

    ``pixels`` are those of the reference; the model hides the background in either image, in this one with a border of
    a pixel, because pixels at the model's outline mix both. ``still``: it is the reference itself.
    """
    if item.aligned is None or item.image is None or item.cam_from_model is None:
        return item
    open_here = ~pixels.valid
    if not still:
        hidden = resection.map_pixels(pixels.mesh, item.camera, item.cam_from_model).valid
        open_here &= ~binary_dilation(hidden, np.ones((3, 3), dtype=bool))
    taken = item.quantity.of(item.image).astype(np.float32)
    return replace(item, aligned=np.where(open_here, taken, item.aligned))
