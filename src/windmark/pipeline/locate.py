"""The first part of the main job: one image read, its markers found, its camera's place known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark import detection, io, registration, resection
from windmark.detection.family import GRAZING
from windmark.errors import WindmarkError
from windmark.geometry import Camera, Pose
from windmark.pipeline.at_pose import markers_at_pose
from windmark.pipeline.clock import Clock, Progress
from windmark.pipeline.project import Project
from windmark.pipeline.project_entries import ImageEntry
from windmark.pipeline.quantity import Quantity, quantity_of
from windmark.pipeline.results import ImageResult
from windmark.registration import Registration
from windmark.scene import Detections, MarkerSet, Mesh
from windmark.scene.fill import without_fill
from windmark.tasks.labels import excluded_spots, fixed_spots
from windmark.tasks.sight import UNDER_GRID, sight
from windmark.tasks.unexplained import unexplained


@dataclass(frozen=True)
class Inputs:
    """What all images of a project share. The grid's orientation does not matter here.

    ``cam_from_rig``: where the cameras of the rig are, by name, the first one first; ``prior`` is then of this one.
    ``rig_cov``: (6, 6) of ``exp(delta) @ cam_from_rig``, of those whose place is not exact.
    """

    project: Project
    markers: MarkerSet | None
    mesh: Mesh | None
    cameras: Mapping[str, io.CameraFile]
    prior: Pose | None
    cam_from_rig: Mapping[str, Pose] = field(default_factory=dict)
    rig_cov: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    def prior_of(self, camera: str) -> Pose | None:
        """The expected pose of a camera."""
        if self.prior is None or camera not in self.cam_from_rig:
            return self.prior
        return self.cam_from_rig[camera] @ next(iter(self.cam_from_rig.values())).inverse() @ self.prior


def locate(entry: ImageEntry, inputs: Inputs, progress: Progress) -> ImageResult:
    """Read, detect and register one image. A failure that the data cause becomes ``problem``."""
    source = inputs.project.camera_of(entry)
    pose = inputs.cameras[source.name].cam_from_model
    clock = Clock(progress, entry.label)
    result = opened(entry, inputs, clock)
    try:
        if result.problem is None and source.pose == "known":
            if pose is None:
                raise io.FileError(source.file, "has no pose; expected one: windmark register finds it "
                                   '(in a project: pose = "find")')  # fmt: skip
            result = replace(result, cam_from_model=pose, pose_cov=inputs.cameras[source.name].pose_cov)
            result = _looked_at(result, pose, inputs, clock)
        elif result.problem is None:
            result = _register(replace(result, published=pose), entry, inputs, clock)
    except WindmarkError as error:
        result = replace(result, problem=str(error))
    return replace(result, seconds=clock.seconds)


def _looked_at(result: ImageResult, pose: Pose, inputs: Inputs, clock: Clock) -> ImageResult:
    """With what the picture shows of the markers at a pose that was given."""
    if inputs.markers is None or result.image is None:
        return result
    polarity = detection.AUTO if inputs.project.detect is None else inputs.project.detect.polarity
    with clock("markers at the given pose"):
        seen = markers_at_pose(result.image, result.camera, pose, inputs.markers, inputs.mesh, polarity)
    return replace(result, at_pose=seen)


def opened(entry: ImageEntry, inputs: Inputs, clock: Clock) -> ImageResult:
    """An image read; one that cannot be, or does not fit its camera, says so in ``problem``."""
    camera = inputs.cameras[inputs.project.camera_of(entry).name].camera
    result = ImageResult(entry.label, None, camera)
    try:
        with clock("read image"):
            page = {} if entry.page is None else {"page": entry.page}
            read = io.read_levels(entry.file, channel=entry.channel, bayer=entry.bayer, **page)
        image, filled = without_fill(read.grey)
        result = replace(result, image=image, mixed=read.mixed, apart=read.apart, quantity=_quantity(entry, image),
                         filled=filled)  # fmt: skip
        _check_size(image, camera, entry)
    except WindmarkError as error:
        result = replace(result, problem=str(error))
    return result


def _register(result: ImageResult, entry: ImageEntry, inputs: Inputs, clock: Clock) -> ImageResult:
    """Detect and register one image; bright markers where dark ones give no pose, unless the project says which."""
    options = inputs.project.detect
    assert options is not None
    refusal: WindmarkError | None = None
    try:
        result = _attempt(result, entry, inputs, clock, options.polarity)
    except WindmarkError as error:  # a label where no dark spot is
        if options.polarity != detection.AUTO:
            raise
        refusal = error
    if options.polarity != detection.AUTO or result.registered is not None or result.polarity == "bright":
        return result
    # The false-alarm number decides, so what is tried second cannot pass for markers by chance.
    try:
        other = _attempt(replace(result, problem=None), entry, inputs, clock, "bright")
    except WindmarkError:
        other = result
    if other.registered is not None:
        return as_bright(other, result)
    if refusal is not None:
        raise refusal
    return result


def as_bright(result: ImageResult, dark: ImageResult) -> ImageResult:
    """An image whose bright spots gave a pose that its dark ones did not give, with what is said of it."""
    bright = 0 if result.detections is None else len(result.detections)
    tried = 0 if dark.detections is None else len(dark.detections)
    return replace(result, said=f"bright markers: {bright} found (dark spots, {tried}, gave no pose)", problem=None)


def _attempt(result: ImageResult, entry: ImageEntry, inputs: Inputs, clock: Clock, polarity: str) -> ImageResult:
    """Detect and register spots of one polarity (or as "auto" decides)."""
    result = looked(result, inputs, clock, polarity)
    found = result.detections
    if result.problem is not None or found is None:
        return result
    assert inputs.markers is not None
    fixed, excluded = told(found, entry, inputs)
    options = register_options(inputs)
    with clock("register"):
        answer = registration.register(
            found, inputs.markers, result.camera, prior=inputs.prior_of(inputs.project.camera_of(entry).name),
            fixed=fixed, excluded=excluded, **options,
        )  # fmt: skip
    if isinstance(answer, Registration):
        return posed(result, answer, inputs)
    with clock("register"):
        answer = unexplained(found, inputs.markers, result.camera, answer, options)
    return replace(result, registration=answer, problem=f"not registered: {answer.reason}")


def looked(result: ImageResult, inputs: Inputs, clock: Clock, polarity: str) -> ImageResult:
    """An image with its spots; without any where no radius prevails, and ``problem`` says it."""
    options, image = inputs.project.detect, result.image
    assert options is not None
    assert image is not None
    mask = None if options.mask is None else io.read_mask(options.mask, image.shape[:2])
    with clock("detect"):
        look = detection.find_markers(
            image,
            polarity=polarity,
            radius_px=options.radius_px,
            merit_max=options.merit_max,
            refine=options.refine,
            photometry=options.photometry,
            mask=mask,
        )
    result = replace(result, radius=look.radius, polarity=look.polarity, said=look.words)
    if look.radius is not None and not look.radius:
        return replace(result, problem=look.radius.reason)
    return replace(result, detections=look.detections)


def told(found: Detections, entry: ImageEntry, inputs: Inputs) -> tuple[dict[int, str], NDArray[np.int64]]:
    """Labels and exclusions of an image by spot; errors as `fixed_spots`."""
    within = inputs.project.register_.label_distance_px
    fixed = fixed_spots(found, entry.labels, within)
    return fixed, excluded_spots(found, entry.exclude, within, fixed)


def register_options(inputs: Inputs) -> dict[str, Any]:
    """Options of `register` that all images share, but for the prior."""
    wanted = inputs.project.register_
    assert inputs.markers is not None
    return {
        "prior_max_angle_deg": wanted.prior_max_angle_deg, "prior_max_scale": wanted.prior_max_scale,
        "binding": wanted.binding, "tolerance_px": wanted.tolerance_px, "free_focal": wanted.free_focal,
        "method": wanted.method, "max_time_s": wanted.max_time_s, "max_table_error": wanted.max_table_error,
        "max_deformation": wanted.max_deformation, "seed": wanted.seed,
        "visible": sight(inputs.markers, inputs.mesh) if wanted.occlusion and inputs.mesh is not None else None,
    }  # fmt: skip


def posed(result: ImageResult, answer: Registration, inputs: Inputs) -> ImageResult:
    """An image with its registration, and the markers that it must show."""
    assert inputs.markers is not None
    expected = _expected(inputs.markers, answer, inputs.mesh)
    return replace(
        result, registration=answer, camera=answer.camera, cam_from_model=answer.cam_from_model, expected=expected
    )


def _quantity(entry: ImageEntry, image: NDArray[np.generic]) -> Quantity:
    """What the image's values are: what the project says, else the file; whole numbers are levels, whatever it says."""
    file = io.frame_address(entry.file).file
    told = io.told_quantity(file) if file.is_file() and image.dtype.kind == "f" else None
    try:
        return quantity_of(entry.quantity, entry.unit, entry.scale, entry.offset, told)
    except WindmarkError as error:
        raise io.FileError(entry.file, str(error)) from None


def _expected(markers: MarkerSet, answer: Registration, mesh: Mesh | None) -> NDArray[np.int64]:
    """Markers that the camera must see: in the picture, not hidden by the grid, and not seen at a grazing angle where
    the normal is known: the detector finds discs at up to 72 degrees.
    """
    tolerance = None if mesh is None else UNDER_GRID * mesh.sizes
    seen = resection.see_points(markers.xyz, answer.camera, answer.cam_from_model, mesh=mesh, tolerance=tolerance)
    sight = answer.cam_from_model.center - markers.xyz
    grazing = np.sum(sight * markers.normal, axis=1) < GRAZING * np.linalg.norm(sight, axis=1)
    return np.flatnonzero(seen.visible & answer.camera.in_image(seen.xy) & ~grazing)


def _check_size(image: NDArray[np.generic], camera: Camera, entry: ImageEntry) -> None:
    height, width = image.shape[:2]
    if (width, height) != camera.size_px:
        expected = "{} x {}".format(*camera.size_px)
        raise io.FileError(
            entry.file,
            f"is {width} x {height} pixels but its camera is {expected}; expected the camera that took this image",
        )
