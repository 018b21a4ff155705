"""The main job: from a project file to values on the grid, for every image of it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import detection, io, registration, resection
from windmark.geometry import Camera, Pose
from windmark.pipeline.clock import Clock, Progress, silent
from windmark.pipeline.grid import UNDER_GRID, read_grid, sight
from windmark.pipeline.labels import excluded_spots, fixed_spots
from windmark.pipeline.project import ImageEntry, Project, ResectOptions, SectionEntry, ViewEntry
from windmark.pipeline.results import ImageResult, RunResult, SectionValues, ViewImage
from windmark.pipeline.views import frame_view, units_per_px
from windmark.registration import Registration
from windmark.resection import PixelMap
from windmark.scene import MarkerSet, Mesh

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Inputs:
    """What all images of a project share."""

    project: Project
    markers: MarkerSet | None
    mesh: Mesh | None
    cameras: Mapping[str, io.CameraFile]
    prior: Pose | None


def run_project(project: Project, *, progress: Progress = silent, workers: int | None = None) -> RunResult:
    """Detect, register and map every image of a project. Nothing is written.

    An image that fails (unreadable, not registered) is kept with its reason in ``problem``; it never
    stops the others. What all images need (markers, cameras, grid) fails at once.

    Raises
    ------
    FileError
        When markers, a camera or the grid cannot be read.
    """
    clock = Clock(progress)
    with clock("read markers, cameras and grid"):
        inputs = _Inputs(
            project,
            io.read_markers(project.markers.file, roles=project.markers.roles) if project.markers else None,
            read_grid(project.grid) if project.grid else None,
            {c.name: io.read_camera_file(c.file) for c in project.camera},
            _read_prior(project.register_.prior),
        )
    _check_labels(inputs)
    if inputs.mesh is not None and not inputs.mesh.blocks and "plot3d" in (project.output.nodes or ()):
        raise io.FileError(project.path, "plot3d needs a grid of structured blocks, this one has none", "output.nodes")
    threads = min(len(project.image), workers or os.cpu_count() or 1)
    with ThreadPoolExecutor(max_workers=threads) as pool:
        jobs = [pool.submit(_process, entry, inputs, progress) for entry in project.image]
        try:
            images = [job.result() for job in jobs]
        except BaseException:  # Ctrl-C too: images that have not started are dropped, not waited for
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    if project.align:
        with clock("align"):
            images = _align(images, inputs)
    notes = tuple((c.file, text) for c in project.camera if (text := inputs.cameras[c.name].note))
    return RunResult(project, inputs.markers, inputs.mesh, tuple(images), clock.seconds, notes)


def _read_prior(path: Path | None) -> Pose | None:
    if path is None:
        return None
    pose = io.read_camera(path)[1]
    if pose is None:
        raise io.FileError(path, "has no pose; expected one, as register.prior")
    return pose


def _check_labels(inputs: _Inputs) -> None:
    """Every label must be the name of a marker that takes part."""
    for n, entry in enumerate(inputs.project.image):
        names = set() if inputs.markers is None else set(inputs.markers.name.tolist())
        for name in entry.labels:
            if name not in names:
                key = f"image[{n}].labels.{name}"
                raise io.FileError(inputs.project.path, "is no marker of the table with the roles that take part", key)


def _process(entry: ImageEntry, inputs: _Inputs, progress: Progress) -> ImageResult:
    """One image, from file to values. A failure that the data cause becomes ``problem``."""
    project = inputs.project
    source = project.camera_of(entry)
    content = inputs.cameras[source.name]
    camera, pose = content.camera, content.cam_from_model
    clock = Clock(progress, entry.label)
    result = ImageResult(entry.label, None, camera)
    try:
        with clock("read image"):
            page = {} if entry.page is None else {"page": entry.page}
            image = io.read_grey(entry.file, channel=entry.channel, bayer=entry.bayer, **page)
        result = replace(result, image=image)
        _check_size(image, camera, entry)
        if source.pose == "known":
            if pose is None:
                raise io.FileError(source.file, 'has no pose; expected one, or pose = "find"')
            result = replace(result, cam_from_model=pose)
        else:
            result = _register(replace(result, published=pose), entry, image, inputs, clock)
        if result.cam_from_model is not None and inputs.mesh is not None:
            result = _map(result, image, inputs.mesh, project, clock)
    except ValueError as error:
        result = replace(result, problem=str(error))
    return replace(result, seconds=clock.seconds)


def _register(
    result: ImageResult, entry: ImageEntry, image: NDArray[np.generic], inputs: _Inputs, clock: Clock
) -> ImageResult:
    """Detect and register one image."""
    options, wanted = inputs.project.detect, inputs.project.register_
    assert options is not None
    assert inputs.markers is not None
    mask = None if options.mask is None else io.read_mask(options.mask, image.shape[:2])
    radius_px = options.radius_px
    if radius_px is None:
        with clock("estimate the radius"):
            result = replace(result, radius=detection.estimate_radius(image, options.polarity, mask=mask))
        assert result.radius is not None
        if not result.radius:
            return replace(result, problem=result.radius.reason)
        radius_px = result.radius.radii_px
    with clock("detect"):
        found = detection.detect(
            image,
            radius_px=radius_px,
            polarity=options.polarity,
            merit_max=options.merit_max,
            refine=options.refine,
            photometry=options.photometry,
            mask=mask,
        )
    result = replace(result, detections=found)
    fixed = fixed_spots(found, entry.labels, wanted.label_distance_px)
    excluded = excluded_spots(found, entry.exclude, wanted.label_distance_px)
    with clock("register"):
        answer = registration.register(
            found,
            inputs.markers,
            result.camera,
            prior=inputs.prior,
            prior_max_angle_deg=wanted.prior_max_angle_deg,
            prior_max_scale=wanted.prior_max_scale,
            fixed=fixed,
            excluded=excluded,
            visible=sight(inputs.markers, inputs.mesh) if wanted.occlusion and inputs.mesh is not None else None,
            tolerance_px=wanted.tolerance_px,
            free_focal=wanted.free_focal,
            max_time_s=wanted.max_time_s,
            max_table_error=wanted.max_table_error,
            max_deformation=wanted.max_deformation,
            seed=wanted.seed,
        )
    result = replace(result, registration=answer)
    if not isinstance(answer, Registration):
        return replace(result, problem=f"not registered: {answer.reason}")
    result = replace(result, camera=answer.camera, cam_from_model=answer.cam_from_model)
    return replace(result, expected=_expected(inputs.markers, answer, inputs.mesh))


def _expected(markers: MarkerSet, answer: Registration, mesh: Mesh | None) -> NDArray[np.int64]:
    """Markers that the camera must see: in the picture, facing it where the normal is known, not hidden by the grid."""
    tolerance = None if mesh is None else UNDER_GRID * mesh.diagonal
    seen = resection.see_points(markers.xyz, answer.camera, answer.cam_from_model, mesh=mesh, tolerance=tolerance)
    sight = answer.cam_from_model.center - markers.xyz
    away = np.sum(sight * markers.normal, axis=1) <= 0
    return np.flatnonzero(seen.visible & answer.camera.in_image(seen.xy) & ~away)


def _check_size(image: NDArray[np.generic], camera: Camera, entry: ImageEntry) -> None:
    height, width = image.shape[:2]
    if (width, height) != camera.size_px:
        expected = "{} x {}".format(*camera.size_px)
        raise io.FileError(
            entry.file,
            f"is {width} x {height} pixels but its camera is {expected}; expected the camera that took this image",
        )


def _map(result: ImageResult, image: NDArray[np.generic], mesh: Mesh, project: Project, clock: Clock) -> ImageResult:
    """Values of one image with known pose on nodes, in views and along sections."""
    options, pose = project.resect, result.cam_from_model
    assert pose is not None
    with clock("visibility"):
        nodes = resection.see_nodes(mesh, result.camera, pose, max_obliquity_deg=options.max_obliquity_deg)
    with clock("node values"):
        values = resection.node_values(image, nodes, interpolation=options.interpolation)
    views: list[ViewImage] = []
    sections: list[SectionValues] = []
    seen = mesh.vertices[nodes.visible]
    for entry in project.view:
        with clock("virtual images"):
            views.append(_view(entry, image, result.camera, pose, mesh, seen, options))
    for cut in project.section:
        with clock("sections"):
            sections.append(_section(cut, image, result.camera, pose, mesh, options))
    return replace(result, nodes=nodes, values=values, views=tuple(views), sections=tuple(sections))


def _view(
    entry: ViewEntry,
    image: NDArray[np.generic],
    camera: Camera,
    cam_from_model: Pose,
    mesh: Mesh,
    seen: Array,
    options: ResectOptions,
) -> ViewImage:
    if not len(seen):
        raise ValueError(f"view {entry.name}: no node of the grid is visible in the image, there is nothing to show")
    virtual, pose = frame_view(
        seen, direction=entry.direction, up=entry.up, size_px=entry.size_px, fov_deg=entry.fov_deg
    )
    pixels = resection.map_pixels(mesh, virtual, pose)
    values, valid = resection.virtual_image(image, pixels, camera, cam_from_model, interpolation=options.interpolation)
    return ViewImage(entry.name, values, valid, virtual, pose, units_per_px(virtual, pose, seen))


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


def _align(images: list[ImageResult], inputs: _Inputs) -> list[ImageResult]:
    """3D alignment (the paper's section III.D): every image as seen from the reference's pose."""
    project, mesh = inputs.project, inputs.mesh
    assert project.align is not None
    assert mesh is not None
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
