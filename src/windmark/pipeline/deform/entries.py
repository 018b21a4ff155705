"""The tables of a deformation test's project file: cameras and their images, markers, volumes with laws, output."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from windmark.deformation.laws.catalog import CATALOG
from windmark.errors import UsageError
from windmark.options.detection import MERIT_MAX, PHOTOMETRY, POLARITY, RADIUS_PX, Photometry, Polarity
from windmark.options.registration import MAX_DEFORMATION, MAX_TABLE_ERROR, MAX_TIME_S, OCCLUSION, SEED
from windmark.pipeline.project_entries import Direction, Positive, Radius, Role, Vector
from windmark.pipeline.settings import Strict, ranged
from windmark.pipeline.typed import nearest

Image = Annotated[str, Field(min_length=1)]


RECORDING = Path("recording")
"""In place of a table of times: those that the recording itself holds."""


class CameraEntry(Strict):
    """One camera: a file with its interior parameters and its pose (cam_from_tunnel), and its images.

    ``images``: file names or patterns (``cam1/*.tif``), relative to the project file. The frame of an image is the
    last number in its name; cameras without numbers are paired by order.
    ``moves``: its pose is found in every frame; markers on walls hold it. ``pose_sigma_deg``, ``pose_sigma``: what is
    known of that pose beforehand (1 sigma per axis, degrees and length units). ``free_focal``: so is its focal length.
    ``rate_hz`` or ``times`` (a table ``image,time_s`` or ``frame,time_s``, or "recording": the time stamps that its
    recording holds): a clock of its own, whose zero is at ``offset_s``; see `timeline`.

    ``name``: by which results call it. ``file``: its lens and its pose, of any format that `windmark convert` reads.
    ``mask``: pixels that are used: a picture (not 0), or a table of a polygon's corners. ``rate_hz``: pictures a second
    of its own clock. ``offset_s``: time of that clock's zero. ``times``: table of its time stamps, or "recording".
    """

    name: str
    file: Path
    images: tuple[Image, ...] | Image
    moves: bool = False
    pose_sigma_deg: Positive | None = None
    pose_sigma: Positive | None = None
    free_focal: bool = False
    mask: Path | None = None
    rate_hz: Positive | None = None
    offset_s: Annotated[float, Field(allow_inf_nan=False)] = 0.0
    times: Path | None = None

    @model_validator(mode="after")
    def _both(self) -> CameraEntry:
        if self.rate_hz is not None and self.times is not None:
            raise UsageError("rate_hz and times both say when its pictures are; give one of them")
        if not self.images:
            raise UsageError("images: expected at least one name or pattern, got none")
        if (self.pose_sigma_deg is None) != (self.pose_sigma is None):
            raise UsageError("pose_sigma_deg and pose_sigma belong together")
        return self

    @property
    def has_clock(self) -> bool:
        """Whether its pictures have times of their own."""
        return self.rate_hz is not None or self.times is not None or self.offset_s != 0

    @property
    def patterns(self) -> tuple[str, ...]:
        """The images, always as a list."""
        return (self.images,) if isinstance(self.images, str) else self.images


class MarkersEntry(Strict):
    """The markers' table; markers of role "wall" stand still and hold cameras that move.

    ``file``: CSV or ``.tgts``. ``roles``: which markers take part.
    """

    file: Path
    roles: Annotated[tuple[Role, ...], Field(min_length=1)] = ("model", "wall", "primary", "secondary")


class AlternativeEntry(Strict):
    """Another law that a volume might have, for ``windmark laws --compare``; "none" is no law at all.

    Options that are not given are the volume's own where the law has the same ones.

    ``law``: built-in, ``file.py:name`` or "none". ``options``: of the law. ``parameters``: start, sigma, lower, upper
    of its parameters.
    """

    law: str
    options: dict[str, Any] = Field(default_factory=dict)
    parameters: dict[str, dict[str, float]] = Field(default_factory=dict)


class VolumeEntry(Strict):
    """A part of the model. ``law``: a built-in one (``windmark laws``), or ``file.py:name`` of your own.

    ``options``: of the law. ``parameters``: start, sigma, lower, upper of its parameters. ``parent``: what it is fixed
    to; ``attach``: at which point, as a rigid body. ``alternative``: other laws, to be compared.

    ``name``: as the table of markers has it.
    """

    name: str
    law: str | None = None
    options: dict[str, Any] = Field(default_factory=dict)
    parameters: dict[str, dict[str, float]] = Field(default_factory=dict)
    parent: str | None = None
    attach: Vector | None = None
    alternative: tuple[AlternativeEntry, ...] = ()


def no_law(law: str) -> str:
    """Why a name is neither that of a built-in law nor a file, "" where it is."""
    if law in CATALOG or ".py" in law:
        return ""
    near = nearest(law, CATALOG)
    return f"{law!r} is neither a built-in law ({', '.join(CATALOG)}) nor a file, file.py:name{near}"


class LookEntry(Strict):
    """How markers are found: options of `detect` and, for frames without a frame before, of `register`."""

    radius_px: Radius | Annotated[tuple[Radius, ...], Field(min_length=1)] | None = RADIUS_PX.default
    polarity: Polarity = POLARITY.default
    merit_max: Annotated[float, ranged(MERIT_MAX)] = MERIT_MAX.default
    photometry: Photometry | None = PHOTOMETRY.default
    max_time_s: Annotated[float, ranged(MAX_TIME_S)] | None = MAX_TIME_S.default
    max_table_error: Annotated[float, ranged(MAX_TABLE_ERROR)] = MAX_TABLE_ERROR.default
    max_deformation: Annotated[float, ranged(MAX_DEFORMATION)] = MAX_DEFORMATION.default
    seed: Annotated[int, ranged(SEED)] = SEED.default
    occlusion: bool = OCCLUSION.default


class MotionEntry(Strict):
    """``free``: the model moves as a rigid body, too."""

    free: bool = True


class StationsEntry(Strict):
    """Where twist and bending are reported: chords along a line on a volume.

    ``volume``: that they are on. ``start``: of the line, at rest. ``end``: of the line. ``count``: evenly spaced
    stations, or their parts of the line (0 to 1). ``chord``: direction aft, from nose to tail, against which twist is
    measured: the other way round nose up is nose down. ``up``: direction in which bending is measured.
    """

    volume: str
    start: Vector
    end: Vector
    count: Annotated[int, Field(ge=1, le=1000)] | Annotated[tuple[float, ...], Field(min_length=1)] = 11
    chord: Direction = (1.0, 0.0, 0.0)
    up: Direction = (0.0, 0.0, 1.0)


class SequenceEntry(Strict):
    """Time. ``frames``: a table ``frame[,time_s][,...]``; other columns (angle of attack, Mach) go into the results.

    ``zero``: frames of the undeformed model (wind off): the markers' places are corrected by them, and everything is
    reported relative to their mean. ``against``: the column that the report's curves are drawn over, by default time.
    ``clock``: where cameras have clocks, the one whose pictures are the instants; by default the fastest.
    ``max_lag_s``: how far the nearest picture of another camera may be from an instant, by default 3/4 of its spacing.

    ``rate_hz``: frames a second, where no table has their times.
    """

    rate_hz: Positive | None = None
    frames: Path | None = None
    zero: tuple[str, ...] = ()
    against: str | None = None
    clock: str | None = None
    max_lag_s: Positive | None = None


class ValuesEntry(Strict):
    """Pictures mapped onto the deformed grid, as fields of its VTK files: grey levels, and with a zero their ratio.

    ``cameras``: which ones; none given means all. ``black``: the grey level without light. ``max_obliquity_deg``:
    surface seen more obliquely gets no value. ``edge_px``: nor does what is nearer to the outline of its surface in the
    image, where pixels mix. ``clear``: nor nodes within so many radii of a marker's centre.

    ``interpolation``: between pixels.
    """

    cameras: tuple[str, ...] = ()
    black: float = 0.0
    max_obliquity_deg: Annotated[float, Field(gt=0, le=90)] = 75.0
    edge_px: Annotated[float, Field(ge=0, le=100)] = 2.0
    clear: Annotated[float, Field(ge=0, le=10)] = 1.5
    interpolation: Literal["nearest", "linear", "cubic"] = "cubic"


class WatchEntry(Strict):
    """Live. ``settle_s``: a picture is whole that can be read and has not changed for so long.

    ``patience_s``: one that cannot be read is tried again until it has not changed for so long; so long an instant that
    lacks a camera's picture waits for it.
    """

    settle_s: Positive = 0.02
    patience_s: Positive = 2.0

    @model_validator(mode="after")
    def _ordered(self) -> WatchEntry:
        if self.patience_s < self.settle_s:
            raise UsageError(f"patience_s is {self.patience_s:g}; expected at least settle_s, {self.settle_s:g}")
        return self


class OutputEntry(Strict):
    """What is written. ``grid``: the deformed grid of every ``every``-th frame. ``magnify``: in the film.

    ``folder``: of the results. ``every``: how many frames from one grid to the next. ``film``: deformation.gif.
    """

    folder: Path = Path("deformation")
    grid: tuple[Literal["vtk", "plot3d"], ...] = ()
    every: Annotated[int, Field(ge=1)] = 1
    film: bool = True
    magnify: Positive | None = None
