"""What a job hands on: per image and as a whole. Columns and arrays, no files."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from windmark.detection import RadiusEstimate
from windmark.geometry import Camera, Pose
from windmark.pipeline.at_pose import AtPose
from windmark.pipeline.light import light_of
from windmark.pipeline.points import PointTable
from windmark.pipeline.project import Project
from windmark.pipeline.quantity import Quantity
from windmark.registration import NotRegistered, Registration, RigRegistration
from windmark.resection import NodeView, PixelMap
from windmark.scene import Detections, MarkerSet, Mesh
from windmark.scene.levels import missing_at
from windmark.tasks.together import Together

if TYPE_CHECKING:
    from windmark.pipeline.merge import MergeResult
    from windmark.pipeline.verdict.grid import GridLook

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FramedView:
    """The virtual camera of a ``[[view]]``, the same for all images of the job.

    ``units_per_px``: length units per pixel at the mean depth of the surface that it is framed on (or, of a given
    point of view, of the grid). ``how``: in words, where its point of view is from.
    """

    name: str
    camera: Camera
    cam_from_model: Pose
    units_per_px: float
    how: str


@dataclass(frozen=True)
class ViewImage:
    """A virtual image: grey values float32 (H, W), NaN where the real image has nothing, and its camera."""

    name: str
    image: NDArray[np.float32]
    valid: NDArray[np.bool_]
    camera: Camera
    cam_from_model: Pose
    units_per_px: float


@dataclass(frozen=True)
class SectionValues:
    """Values along a cut of the surface: arc length, place and value per point, and which line of the cut."""

    name: str
    line: NDArray[np.int32]
    arc: Array
    xyz: Array
    value: NDArray[np.float32]


@dataclass(frozen=True)
class Instant:
    """What the cameras of a rig gave together at one instant.

    Parameters
    ----------
    point : of the test; None where there is only one
    together : what came of them
    """

    point: str | None
    together: Together

    @property
    def registered(self) -> RigRegistration | None:
        """The registration when there is one."""
        answer = self.together.answer
        return answer if isinstance(answer, RigRegistration) else None


@dataclass(frozen=True)
class ImageResult:
    """Everything known about one image.

    ``camera`` and ``cam_from_model`` are the final ones; ``published`` is the pose that the camera's
    file carried, for comparison; ``expected`` are the markers that must be in view from the pose found.
    ``pose_cov`` is what the camera's file says of a pose that was known; a registration has its own.
    ``radius`` is the estimate that detection used where the project gives none; ``polarity`` that of the spots, and
    ``said`` what was decided about it. ``instant`` has the cameras of a rig with which it was registered.
    ``image`` is as in the file, but for fill values, which are NaN and which ``filled`` names; values, their 1
    ``sigma``, views, sections and ``aligned`` are in ``quantity``.
    ``mixed`` are the pixels that were made of saturated ones, of a colour or a mosaic, ``apart`` see `io.Levels`.
    ``saturated`` says how many nodes have no value because their pixels are at the highest level, ``saturated_part``
    which part of those that it shows; ``dead`` how many because of hot or dead pixels; ``dark`` and ``dark_part`` are
    the same of ``black``, the pixels that are clipped at black.
    ``smoothed`` says that the noise of neighbours is alike.
    ``at_pose`` is what it shows of the markers at a pose that was known.
    ``problem`` says in words why it went no further; None when all is well. ``left_out``: views and sections that are
    missing, with the reason.
    """

    name: str
    image: NDArray[np.generic] | None
    camera: Camera
    cam_from_model: Pose | None = None
    published: Pose | None = None
    radius: RadiusEstimate | None = None
    polarity: str = ""
    said: str = ""
    quantity: Quantity = field(default_factory=Quantity)
    detections: Detections | None = None
    instant: Instant | None = None
    registration: Registration | NotRegistered | None = None
    expected: NDArray[np.int64] | None = None
    nodes: NodeView | None = None
    values: NDArray[np.float32] | None = None
    sigma: NDArray[np.float32] | None = None
    pixels: PixelMap | None = None
    views: tuple[ViewImage, ...] = ()
    sections: tuple[SectionValues, ...] = ()
    points: tuple[PointTable, ...] = ()
    pose_cov: Array | None = None
    at_pose: AtPose | None = None
    aligned: NDArray[np.float32] | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    problem: str | None = None
    left_out: tuple[str, ...] = ()
    mixed: NDArray[np.bool_] | None = None
    apart: int = 1
    filled: str = ""
    saturated: str = ""
    saturated_part: float = 0.0
    dead: str = ""
    black: NDArray[np.bool_] | None = None
    dark: str = ""
    dark_part: float = 0.0
    smoothed: str = ""

    @property
    def registered(self) -> Registration | None:
        """The registration when there is one."""
        return self.registration if isinstance(self.registration, Registration) else None

    @property
    def light(self) -> NDArray[np.generic]:
        """(H, W) the image in its quantity, as values are taken of it, see `light_of`."""
        assert self.image is not None
        return missing_at(light_of(self.image, self.mixed, self.quantity), self.black)


@dataclass(frozen=True)
class RunResult:
    """A finished job."""

    project: Project
    markers: MarkerSet | None
    mesh: Mesh | None
    images: tuple[ImageResult, ...]
    seconds: dict[str, float]
    notes: tuple[tuple[Path, str], ...] = ()
    """Files, and what had to be done to read them."""
    framed: tuple[FramedView, ...] = ()
    """The virtual cameras, one per ``[[view]]`` of the project."""
    merged: tuple[MergeResult, ...] = ()
    """Images merged with each other, one per point of the test."""
    lost_views: tuple[str, ...] = ()
    """Views that show nothing, with the reason."""
    unknown_sides: tuple[str, ...] = ()
    """Zones that are the sides of a part without thickness, of which nothing tells which is which, in words."""
    look: GridLook | None = None
    """How the grid stands to the markers; None where it was not looked at."""

    @property
    def left_out(self) -> tuple[str, ...]:
        """Views and sections that are missing, with the image and the reason."""
        return (*self.lost_views, *(f"{item.name}: {said}" for item in self.images for said in item.left_out))

    @property
    def instants(self) -> tuple[Instant, ...]:
        """What the cameras of the rig gave together, one per instant."""
        every = {id(i.instant): i.instant for i in self.images if i.instant is not None}
        return tuple(every.values())

    @property
    def failed(self) -> tuple[ImageResult, ...]:
        """Images that went wrong, with their reason in ``problem``."""
        return tuple(i for i in self.images if i.problem)
