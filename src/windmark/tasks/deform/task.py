"""What stands round the model: cameras, markers, laws, and how to look."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation, Volumes
from windmark.deformation.discs import OtherDiscs
from windmark.errors import DataError, UsageError
from windmark.geometry import Camera, Pose
from windmark.options.detection import MERIT_MAX, POLARITY
from windmark.options.registration import MAX_DEFORMATION, MAX_TABLE_ERROR
from windmark.scene import Doubt, MarkerSet, Observations

Array = NDArray[np.float64]
Image = NDArray[np.generic]
Visible = Callable[[Pose, Camera], NDArray[np.bool_]]


@dataclass(frozen=True)
class Station:
    """One camera of the test.

    Parameters
    ----------
    name : its name
    camera : interior parameters
    cam_from_tunnel : where it stands
    moves : its pose is found anew in every frame; markers on walls hold it
    pose_cov : (6, 6) what is known of that pose, for a camera that moves; None for nothing
    free_focal : its focal length, too
    mask : (H, W) pixels that are used; None for all
    """

    name: str
    camera: Camera
    cam_from_tunnel: Pose
    moves: bool = False
    pose_cov: Array | None = None
    free_focal: bool = False
    mask: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class LookOptions:
    """How markers are looked for; every option has its meaning from `detect`.

    Parameters
    ----------
    radius_px : for the first frame; None estimates it
    polarity, merit_max, photometry : of `detect`
    max_time_s, max_table_error, max_deformation, seed : of `register`
    """

    radius_px: tuple[float, ...] | None = None
    polarity: str = POLARITY.default
    merit_max: float = MERIT_MAX.default
    photometry: str | None = None
    max_time_s: float | None = None
    max_table_error: float = MAX_TABLE_ERROR.default
    max_deformation: float = MAX_DEFORMATION.default
    seed: int = 0


@dataclass(frozen=True)
class DeformationTest:
    """A deformation test: everything that does not change from frame to frame.

    Parameters
    ----------
    stations : the cameras
    markers : of model and walls, undeformed; model frame and tunnel frame are one at rest
    volumes : the model's volumes and their laws
    free_motion : the model may move as a rigid body
    visible : camera -> which markers nothing hides from there, see `register`; None: all that face it
    marker_cov : (N, 3, 3) covariance of the markers' places where images showed them, the paint's texture included (the
        wind-off zero); None takes their sigma and adds the texture
    look : how markers are looked for
    wind_off : keys of the wind-off frames, which ``marker_cov`` is from and all else is relative to
    discs_wind_off : what discs of another size would change in these (`zero.discs_of`); None for nothing
    """

    stations: tuple[Station, ...]
    markers: MarkerSet
    volumes: Volumes
    free_motion: bool = True
    visible: Visible | None = None
    marker_cov: Array | None = None
    look: LookOptions = field(default_factory=LookOptions)
    wind_off: tuple[str, ...] = ()
    discs_wind_off: OtherDiscs | None = None

    def __post_init__(self) -> None:
        names = [s.name for s in self.stations]
        if not names or len(set(names)) != len(names):
            raise UsageError(f"stations: expected at least one camera, with distinct names, got {names}")

    def station(self, name: str) -> Station:
        """The camera of a name."""
        return next(s for s in self.stations if s.name == name)


Reader = Callable[[Any, Station], Image]
"""Makes the grey image of a station from what `FrameImages` has; a `WindmarkError` says why there is none."""


def as_given(item: Any, station: Station) -> Image:
    """The `Reader` of pictures that are grey images already.

    Raises
    ------
    DataError
        When it has another size than the camera.
    ValueError
        When it is no array: wrong use, not a bad picture.
    """
    if not isinstance(item, np.ndarray):
        raise UsageError(f"image of {station.name}: expected grey levels (H, W), got {type(item).__name__}")
    if (why := wrong_size(item, station)) is not None:
        raise DataError(f"image of {station.name}: {why}")
    return item


def wrong_size(image: Image, station: Station) -> str | None:
    """What is wrong with the size of a camera's image, in words; None where it is right."""
    height, width = image.shape[:2]
    if (width, height) == station.camera.size_px:
        return None
    return "is {} x {} pixels but camera {} is {} x {}".format(width, height, station.name, *station.camera.size_px)


@dataclass(frozen=True)
class Shot:
    """A picture of a camera with a clock of its own, as in `FrameImages`; when it was taken, in the unit of these."""

    instant: float
    image: Any


@dataclass(frozen=True)
class FrameImages:
    """The images of one instant.

    Parameters
    ----------
    key : what the instant is called
    instant : when it was, in frames; in seconds where cameras have clocks
    images : camera -> grey image, or what a `Reader` makes one of (a path, a frame of a recording); a camera that has
        none (a dropped frame) is left out
    shots : camera -> its pictures round the instant, by time, for cameras that took none just then; their spots are
        interpolated. ``images`` then has the nearest one
    missing : camera -> why it has no image; "no image" where nothing is said
    time_s : the time in seconds; NaN where unknown
    seen_s : when its newest picture was seen, by the monotonic clock; NaN unless live
    skipped : for an instant that is not measured, "late" or "left" (the run ended first), and why
    odd : camera -> what is odd about its image, which is used
    """

    key: str
    instant: float
    images: Mapping[str, Any]
    shots: Mapping[str, tuple[Shot, ...]] = field(default_factory=dict)
    missing: Mapping[str, str] = field(default_factory=dict)
    time_s: float = float("nan")
    seen_s: float = float("nan")
    skipped: tuple[str, str] | None = None
    odd: Mapping[str, str] = field(default_factory=dict)

    def lag(self, name: str) -> float:
        """How much later than the instant the nearest picture of a camera is; 0 where it took one just then."""
        if name not in self.shots:
            return 0.0 if name in self.images else float("nan")
        return min((s.instant - self.instant for s in self.shots[name]), key=abs)


@dataclass(frozen=True)
class Sight:
    """What one camera saw in one instant.

    Parameters
    ----------
    expected, found : markers that it should see, and spots of them
    reason : why there are none, or few; "" where all is well
    lag_s : how much later than the instant its nearest picture is; NaN without one
    blur_px, radius_px : how blurred its spots are, 1 sigma of a Gaussian, and their median radius; NaN where no spot
        tells it
    fields_px : how far rows of odd number are from those of even number, see `FieldShift.sure_px`
    odd : marker without a spot, near whose place there is a spot without a marker -> distance in pixels, and about
        that in length units
    picture : tells whether another instant's picture is the same bit by bit (`print_of`); 0 for an image between two
    walls : spots of markers on walls, and how many of these a camera that moves should see where it sees none, else 0
    """

    expected: int = 0
    found: int = 0
    reason: str = ""
    lag_s: float = float("nan")
    blur_px: float = float("nan")
    radius_px: float = float("nan")
    fields_px: float = 0.0
    odd: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    picture: int = 0
    walls: tuple[int, int] = (0, 0)


@dataclass(frozen=True, eq=False)
class DeformedFrame:
    """What became of one instant.

    Parameters
    ----------
    index, key, instant : its place in the sequence from 0, its name, when it was
    status : "cold" (found without help), "tracked" (from the frame before), "lost"; or "late" or "left", not looked at
    reason : why it is lost or was not looked at, or what was wrong with single cameras; "" if nothing
    state : the deformation, None where it is lost
    observations : spots with their markers, of all cameras that saw any
    views : names of the cameras, in the order of ``observations.view``
    seconds : wall time from the images to the deformation
    cameras : camera -> what it saw
    series : what all frames so far say together against the results
    """

    index: int
    key: str
    instant: float
    status: str
    reason: str
    state: Deformation | None
    observations: Observations | None = None
    views: tuple[str, ...] = ()
    seconds: float = 0.0
    cameras: Mapping[str, Sight] = field(default_factory=dict)
    series: tuple[Doubt, ...] = ()
