"""The first part of the main job with a rig: images of one instant read, their markers found, registered together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark import detection, io
from windmark.errors import WindmarkError
from windmark.geometry import Pose
from windmark.pipeline.clock import Clock, Progress
from windmark.pipeline.locate import Inputs, as_bright, looked, opened, posed, register_options, told
from windmark.pipeline.project import Project
from windmark.pipeline.project_entries import ImageEntry
from windmark.pipeline.results import ImageResult, Instant
from windmark.registration import NotRegistered
from windmark.scene import Detections
from windmark.tasks.together import CHECKED, RigView, Together, register_together

Images = dict[str, ImageResult]
InParallel = Callable[[Callable[[ImageEntry], ImageResult], Sequence[ImageEntry]], list[ImageResult]]


def read_rig(
    project: Project, cameras: Mapping[str, io.CameraFile]
) -> tuple[dict[str, Pose], dict[str, NDArray[np.float64]]]:
    """Where the cameras of a project's rig are, by name, and covariances of these places; empty without a rig.

    Raises
    ------
    FileError
        For a file of the rig, or of a camera, that does not say where a camera is, or in another length unit.
    """
    rig = project.rig
    if rig is None:
        return {}, {}
    cov: dict[str, NDArray[np.float64]] = {}
    if rig.file is None:
        entries = [c for c in project.camera if c.name in project.rig_cameras]
        for entry in entries:
            if cameras[entry.name].cam_from_model is None:
                raise io.FileError(entry.file, "has no pose; expected where the camera is in the rig, from one frame"
                                   " for all its cameras ([rig] file takes them from a file of the rig)")  # fmt: skip
        poses = {n: p for n, c in cameras.items() if (p := c.cam_from_model) is not None}
    else:
        content = project.lengths.rig(rig.file)
        poses, cov = dict(content.cam_from_rig), dict(content.cov)
        missing = [name for name in project.rig_cameras if name not in poses]
        if missing:
            raise io.FileError(rig.file, f"has no camera {missing[0]}; it has {', '.join(poses)}; expected the names of"
                               " the project's cameras (rig.cameras leaves some out)")  # fmt: skip
    return {name: poses[name] for name in project.rig_cameras}, cov


def locate_together(inputs: Inputs, progress: Progress, in_parallel: InParallel) -> Images:
    """Read, detect and register the images of every instant, those of an instant together; by their names.

    A failure that the data cause becomes ``problem``. Bright markers are tried where dark ones give no pose, unless the
    project says which.
    """
    groups = inputs.project.instants
    clocks = {e.label: Clock(progress, e.label) for group in groups for e in group}
    options = inputs.project.detect
    assert options is not None
    polarity = options.polarity

    def first(entry: ImageEntry) -> ImageResult:
        result = opened(entry, inputs, clocks[entry.label])
        published = inputs.cameras[inputs.project.camera_of(entry).name].cam_from_model
        return result if result.problem else _looked(replace(result, published=published), inputs, clocks, polarity)

    seen = {r.name: r for r in in_parallel(first, [e for group in groups for e in group])}
    done = {k: _together(group, seen, inputs, clocks) for k, group in enumerate(groups)}
    refused = {k: images for k, images in done.items() if polarity == detection.AUTO and _may_be_bright(images)}

    def again(entry: ImageEntry) -> ImageResult:
        dark = seen[entry.label]
        return dark if _unusable(dark) else _looked(replace(dark, problem=None), inputs, clocks, "bright")

    bright = {r.name: r for r in in_parallel(again, [e for k in refused for e in groups[k]])}
    for k in refused:
        second = _together(groups[k], bright, inputs, clocks)
        if any(r.registered is not None for r in second.values()):
            done[k] = {n: as_bright(r, seen[n]) if r.registered is not None else r for n, r in second.items()}
    return {n: replace(r, seconds=clocks[n].seconds) for images in done.values() for n, r in images.items()}


def _looked(result: ImageResult, inputs: Inputs, clocks: Mapping[str, Clock], polarity: str) -> ImageResult:
    try:
        return looked(result, inputs, clocks[result.name], polarity)
    except WindmarkError as error:
        return replace(result, problem=str(error))


def _trusted(project: Project) -> tuple[str, ...]:
    return () if project.rig is None else project.rig.trust


def _unusable(result: ImageResult) -> bool:
    """Whether an image could not be read, or searched at all; one in which no radius prevails could."""
    return result.problem is not None and result.detections is None and result.radius is None


def _may_be_bright(images: Images) -> bool:
    """Whether an instant has no pose and not all of its images were searched for bright spots already."""
    nothing = all(r.registered is None for r in images.values())
    return nothing and any(r.polarity != "bright" and not _unusable(r) for r in images.values())


def _together(
    entries: Sequence[ImageEntry], seen: Mapping[str, ImageResult], inputs: Inputs, clocks: Mapping[str, Clock]
) -> Images:
    """Register the images of one instant that can be used; one without a spot gets its place from the others."""
    assert inputs.markers is not None
    views: list[RigView] = []
    names, out = {e.label: inputs.project.camera_of(e).name for e in entries}, {}
    for entry in entries:
        result, name = seen[entry.label], names[entry.label]
        if _unusable(result):
            out[entry.label] = result
            continue
        spots = Detections.make(np.zeros((0, 2))) if result.detections is None else result.detections
        try:
            place, cov = inputs.cam_from_rig[name], inputs.rig_cov.get(name)
            views.append(RigView(name, spots, result.camera, place, *told(spots, entry, inputs), cov))
        except WindmarkError as error:  # a label where no spot is
            out[entry.label] = replace(result, problem=str(error))
    if not views:
        return out
    prior = None if inputs.prior is None else next(iter(inputs.cam_from_rig.values())).inverse() @ inputs.prior
    with clocks[entries[0].label]("register together"):
        done = register_together(views, inputs.markers, priors=(prior,), **register_options(inputs))
    instant = Instant(entries[0].point, done)
    for entry in entries:
        if entry.label not in out:
            result = replace(seen[entry.label], instant=instant)
            out[entry.label] = _of_image(result, names[entry.label], done, inputs)
    return out


def _of_image(result: ImageResult, camera: str, done: Together, inputs: Inputs) -> ImageResult:
    """What came of one image of an instant."""
    others = " and ".join(name for name in done.names if name != camera)
    if camera in done.left_out:
        return replace(result, problem=f"left out, it contradicts {others}: {done.left_out[camera]}")
    answer = done.of(camera)
    if answer is not None:
        if len(answer.matching) < CHECKED and camera not in _trusted(inputs.project):
            why = f"{len(answer.matching)} of its spots are markers: nothing checks that it is where the rig says"
            return replace(result, problem=f"{why} (rig.trust takes its place as given)")
        return posed(replace(result, problem=None), answer, inputs)
    assert isinstance(done.answer, NotRegistered)
    which = f"not registered together with {others}" if others else "not registered"
    return replace(result, registration=done.answer, problem=f"{which}: {done.answer.reason}")
