"""The main job: from a project file to values on the grid, for every image of it."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from windmark import io
from windmark.geometry import Camera, Pose
from windmark.pipeline.clock import Clock, Progress, counting, silent
from windmark.pipeline.framing import frame_views
from windmark.pipeline.grid import curved_by, oriented, read_surface, sides_words, with_curvature
from windmark.pipeline.instants import locate_together, read_rig
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.locate import Inputs, locate
from windmark.pipeline.mapping import align_images, map_image, map_views
from windmark.pipeline.merge import MergeResult, merge_images
from windmark.pipeline.points import PointSet, load_points, read_lists
from windmark.pipeline.project import Project
from windmark.pipeline.results import FramedView, ImageResult, RunResult
from windmark.pipeline.verdict.grid import grid_look, grid_notes
from windmark.pipeline.walls import wall_volumes, walls_note, without
from windmark.resection import PixelMap

T = TypeVar("T")
_POSES = 8
"""Of one camera, as many tell the air side of the grid."""


@dataclass(frozen=True)
class Begun:
    """What all images of a job need, read and put together.

    Parameters
    ----------
    inputs : markers, grid, cameras, rig
    walls : volumes that alignment leaves out
    framed : the virtual cameras
    lists : the wanted points, not yet on the grid
    notes : files, and what had to be done to read them
    """

    inputs: Inputs
    walls: tuple[str, ...]
    framed: tuple[FramedView, ...]
    lists: list[io.PointList]
    notes: tuple[tuple[Path, str], ...]


def begin(project: Project) -> Begun:
    """Read what a project names besides its images.

    Raises
    ------
    FileError
        When markers, a camera, the grid or a list of points cannot be read, or do not fit each other.
    """
    lengths = project.lengths
    cameras = {c.name: lengths.camera(c.file) for c in project.camera}
    inputs = Inputs(
        project,
        lengths.markers(project.markers.file, project.markers.roles) if project.markers else None,
        read_surface(project.grid, lengths) if project.grid else None,
        cameras,
        _read_prior(project),
        *read_rig(project, cameras),
    )
    _check_labels(inputs)
    inputs, walls, notes = _walls_apart(inputs, lengths)
    inputs, said = _curved(inputs, lengths)
    if inputs.mesh is not None and not inputs.mesh.blocks and "plot3d" in (project.output.nodes or ()):
        raise io.FileError(project.path, "plot3d needs a grid of structured blocks, this one has none", "output.nodes")
    framed = () if inputs.mesh is None else frame_views(project, inputs.mesh)
    lists = read_lists(project.points, lengths)
    return Begun(inputs, walls, framed, lists, notes + said + lengths.notes())


def run_project(project: Project, *, progress: Progress = silent, workers: int | None = None) -> RunResult:
    """Detect, register and map every image of a project. Nothing is written.

    Two parts: first every image is read, detected and registered, by itself or, with a rig, together with the others of
    its instant; then, with all poses known, the views are framed once and every image is mapped into the same ones.

    An image that fails (unreadable, not registered) is kept with its reason in ``problem``; it never
    stops the others. What all images need (markers, cameras, grid) fails at once.

    Raises
    ------
    FileError
        When markers, a camera or the grid cannot be read.
    """
    clock = Clock(progress)
    with clock("read markers, cameras and grid"):
        start = begin(project)
    inputs, framed, notes = start.inputs, start.framed, start.notes
    threads = min(len(project.image), workers or os.cpu_count() or 1)
    images = _located(inputs, progress, threads)
    points: tuple[PointSet, ...] = ()
    sides: tuple[str, ...] = ()
    if inputs.mesh is not None and project.grid is not None:
        with clock("turn the grid to the air"):
            turned = oriented(inputs.mesh, project.grid, _some_poses(project, images))
            sides = tuple(sides_words(inputs.mesh, turned, project.grid))
            inputs = replace(inputs, mesh=turned)
        assert inputs.mesh is not None
        points = load_points(project, start.lists, inputs.mesh)
    lost: tuple[str, ...] = ()
    pixels: tuple[PixelMap, ...] = ()
    if inputs.mesh is not None and any(i.cam_from_model is not None for i in images):
        with clock("map the views"):
            framed, pixels, lost = map_views(framed, inputs.mesh)
    shown = framed if pixels else ()
    images, merged = _mapped(images, inputs, shown, pixels, points, threads, clock, progress, start.walls)
    look = None if inputs.markers is None or inputs.mesh is None else grid_look(inputs.markers, inputs.mesh)
    if look is not None and project.grid is not None:
        said = grid_notes(look.markers, look.mesh, project.length_unit, look)
        notes += tuple((project.grid.file, text) for text in said)
    notes += tuple((c.file, text) for c in project.camera if (text := inputs.cameras[c.name].note))
    return RunResult(project, inputs.markers, inputs.mesh, tuple(images), clock.seconds, notes, framed, merged,
                     lost, sides, look)  # fmt: skip


def _curved(inputs: Inputs, lengths: Lengths) -> tuple[Inputs, tuple[tuple[Path, str], ...]]:
    """The inputs with the curvature of the surface at the markers, by the grid or what stands in its place; notes."""
    if inputs.markers is None or inputs.project.markers is None:
        return inputs, ()
    surface = inputs.project.markers.surface
    if surface is None:
        return replace(inputs, markers=with_curvature(inputs.markers, inputs.mesh)), ()
    markers, said = curved_by(inputs.markers, surface, lengths)
    return replace(inputs, markers=markers), ((surface, said),) if said else ()


def _walls_apart(inputs: Inputs, lengths: Lengths) -> tuple[Inputs, tuple[str, ...], tuple[tuple[Path, str], ...]]:
    """The inputs without walls where the project leaves them out; the walls that alignment must leave out; notes."""
    project, mesh = inputs.project, inputs.mesh
    if mesh is None or project.grid is None or not (project.align or project.grid.walls == "leave_out"):
        return inputs, (), ()
    walls = wall_volumes(project.markers.file if project.markers else None, project.grid, mesh, lengths)
    if not walls:
        return inputs, (), ()
    if project.grid.walls == "keep":
        return inputs, walls, ((project.grid.file, walls_note(walls, "the alignment")),)
    rest = without(mesh, walls)
    return replace(inputs, mesh=rest), (), ((project.grid.file, walls_note(walls, "the job")),)


def _located(inputs: Inputs, progress: Progress, threads: int) -> list[ImageResult]:
    """Every image read, detected and registered: those that a rig took at one instant together, the others alone."""
    project = inputs.project
    done: dict[str, ImageResult] = {}
    if project.instants:
        done = locate_together(
            inputs, progress, lambda work, items: _in_parallel(work, items, threads, progress, "look at")
        )
    alone = [entry for entry in project.image if entry.label not in done]
    look = partial(locate, inputs=inputs, progress=progress)
    done |= {r.name: r for r in _in_parallel(look, alone, threads, progress, "look at")}
    return [done[entry.label] for entry in project.image]


def _some_poses(project: Project, images: Sequence[ImageResult]) -> list[tuple[Camera, Pose]]:
    """Of each camera some poses, evenly spread over its images: a sequence sees the same side again and again."""
    of_camera: dict[str, list[tuple[Camera, Pose]]] = {}
    for entry, item in zip(project.image, images, strict=True):
        if item.cam_from_model is not None:
            of_camera.setdefault(project.camera_of(entry).name, []).append((item.camera, item.cam_from_model))
    return [poses[k] for poses in of_camera.values() for k in range(0, len(poses), -(-len(poses) // _POSES))]


def _mapped(
    images: list[ImageResult],
    inputs: Inputs,
    framed: tuple[FramedView, ...],
    pixels: tuple[PixelMap, ...],
    points: tuple[PointSet, ...],
    threads: int,
    clock: Clock,
    progress: Progress,
    walls: tuple[str, ...],
) -> tuple[list[ImageResult], tuple[MergeResult, ...]]:
    """The second part of the job: all that needs poses and a grid; ``walls`` are left out of the alignment."""
    project, mesh = inputs.project, inputs.mesh
    if mesh is None:
        return images, ()
    images = _in_parallel(
        lambda i: map_image(i, project, mesh, framed, pixels, progress, points), images, threads, progress, "map"
    )
    merged: tuple[MergeResult, ...] = ()
    if project.merge:
        with clock("merge"):
            merged = merge_images(project, images, mesh, framed, pixels, points)
    if project.align:
        with clock("align"):
            images = align_images(images, project, without(mesh, walls))
    return images, merged


def _in_parallel(
    work: Callable[[T], ImageResult], items: Sequence[T], threads: int, progress: Progress, stage: str
) -> list[ImageResult]:
    ended = counting(progress, stage, len(items))

    def one(item: T) -> ImageResult:
        result = work(item)
        ended(result.name)
        return result

    with ThreadPoolExecutor(max_workers=threads) as pool:
        jobs = [pool.submit(one, item) for item in items]
        try:
            return [job.result() for job in jobs]
        except BaseException:  # Ctrl-C too: images that have not started are dropped, not waited for
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _read_prior(project: Project) -> Pose | None:
    path = project.register_.prior
    if path is None:
        return None
    content = project.lengths.camera(path)
    if content.cam_from_model is None:
        raise io.FileError(path, "has no pose; expected one, as register.prior")
    return content.cam_from_model


def _check_labels(inputs: Inputs) -> None:
    """Every label must be the name of a marker that takes part."""
    for n, entry in enumerate(inputs.project.image):
        names = set() if inputs.markers is None else set(inputs.markers.name.tolist())
        for name in entry.labels:
            if name not in names:
                key = f"image[{n}].labels.{name}"
                raise io.FileError(inputs.project.path, "is no marker of the table with the roles that take part", key)
