"""The project file of a deformation test: cameras and their images, markers, volumes with laws, what is wanted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from windmark.deformation.laws.catalog import CATALOG
from windmark.errors import UsageError
from windmark.options.detection import MERIT_MAX, PHOTOMETRY, POLARITY, RADIUS_PX, Photometry, Polarity
from windmark.options.registration import MAX_DEFORMATION, MAX_TABLE_ERROR, MAX_TIME_S, OCCLUSION, SEED
from windmark.pipeline.faults import Faults
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.project_entries import Direction, GridEntry, Positive, Radius, Role, Unit, Vector
from windmark.pipeline.result_place import result_place
from windmark.pipeline.settings import Strict, existing, explained, ranged, read_toml
from windmark.pipeline.typed import nearest
from windmark.pipeline.wanted import PointsEntry

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


class DeformProject(Strict):
    """A whole deformation test. `path` is the project file; other paths are already absolute.

    ``title``: of the report. ``length_unit``: of every length in this file, and of files that do not say theirs.
    """

    path: Path
    title: str
    length_unit: Unit
    camera: Annotated[tuple[CameraEntry, ...], Field(min_length=1)]
    markers: MarkersEntry
    volume: tuple[VolumeEntry, ...] = ()
    motion: MotionEntry = Field(default_factory=MotionEntry)
    look: LookEntry = Field(default_factory=LookEntry)
    grid: GridEntry | None = None
    stations: StationsEntry | None = None
    sequence: SequenceEntry = Field(default_factory=SequenceEntry)
    values: ValuesEntry | None = None
    points: tuple[PointsEntry, ...] = ()
    watch: WatchEntry = Field(default_factory=WatchEntry)
    output: OutputEntry = Field(default_factory=OutputEntry)

    @model_validator(mode="after")
    def _consistent(self) -> DeformProject:
        faults = Faults()
        cameras = [c.name for c in self.camera]
        faults.names("camera", cameras)
        faults.files(self.camera)
        volumes = [v.name for v in self.volume]
        faults.names("volume", volumes)
        for k, v in enumerate(self.volume):
            if v.parent is not None:
                faults.known(v.parent, volumes, "a volume", "volume", k, "parent")
            if v.law is not None and (why := no_law(v.law)):
                faults.add(why, "volume", k, "law", certain=True)
        faults.names("points", [p.label for p in self.points])
        if not any(v.law for v in self.volume) and not self.motion.free:
            faults.add("nothing is free: give a volume a law, or set motion.free", "motion", "free")
        if self.output.grid and self.grid is None:
            faults.add("a deformed grid needs [grid] file = ...", "output", "grid")
        if self.points and self.grid is None:
            faults.add("they are moved with the deformed grid: add [grid] file = ...", "points")
        if self.values is not None:
            for k, name in enumerate(self.values.cameras):
                faults.known(name, cameras, "a camera", "values", "cameras", k)
            if "vtk" not in self.output.grid:
                faults.add('they are fields of the grid in VTK files: give output.grid = ["vtk"]', "values")
        if self.sequence.clock is not None:
            faults.known(self.sequence.clock, cameras, "a camera", "sequence", "clock")
        if not self.has_clocks and (self.sequence.clock is not None or self.sequence.max_lag_s is not None):
            faults.add("clock and max_lag_s need a camera with rate_hz, offset_s or times", "sequence")
        if self.stations is not None:
            faults.known(self.stations.volume, volumes, "a volume", "stations", "volume")
        faults.refuse("DeformProject")
        return self

    @property
    def lengths(self) -> Lengths:
        """What reads its files: their lengths are in its unit."""
        return Lengths.of_project(self.path, self.length_unit)

    @property
    def has_clocks(self) -> bool:
        """Whether cameras have clocks of their own; otherwise pictures of one number are of one instant."""
        return any(c.has_clock for c in self.camera)


@dataclass(frozen=True)
class Changes:
    """What is wanted otherwise than the project file says.

    ``output``: another folder. ``cameras``: only these take part; none given means all. ``moves``: these move, too.
    """

    output: Path | None = None
    cameras: tuple[str, ...] = ()
    moves: tuple[str, ...] = ()


def read_deform_project(path: str | Path, changed: Changes | Path | None = None) -> DeformProject:
    """Read and check a project file of a deformation test.

    Parameters
    ----------
    path : the TOML file
    changed : what is wanted otherwise; a folder is another folder for the results

    Raises
    ------
    FileError
        When the file is missing, no TOML, has an unknown or wrong key, or names a file that is absent.
    ValueError
        When ``changed`` names a camera that the project has not.
    """
    path = Path(path)
    wish = changed if isinstance(changed, Changes) else Changes(changed)
    data = read_toml(path, DeformProject)
    if wish.output is not None and isinstance(data.setdefault("output", {}), dict):
        data["output"]["folder"] = wish.output.resolve()
    try:
        project = _changed(DeformProject(path=path.resolve(), **data), wish)
    except ValidationError as error:
        raise explained(path, error, DeformProject) from None
    cameras = []
    for i, camera in enumerate(project.camera):
        files = {"file": existing(project.path, f"camera[{i}].file", camera.file)}
        if camera.mask is not None:
            files["mask"] = existing(project.path, f"camera[{i}].mask", camera.mask)
        if camera.times not in (None, RECORDING):
            files["times"] = existing(project.path, f"camera[{i}].times", camera.times)
        cameras.append(camera.model_copy(update=files))
    markers, grid, sequence = project.markers, project.grid, project.sequence
    markers = markers.model_copy(update={"file": existing(project.path, "markers.file", markers.file)})
    if grid is not None:
        grid = grid.model_copy(update={"file": existing(project.path, "grid.file", grid.file)})
    if sequence.frames is not None:
        sequence = sequence.model_copy(update={"frames": existing(project.path, "sequence.frames", sequence.frames)})
    values = project.values
    if values is not None and not values.cameras:
        values = values.model_copy(update={"cameras": tuple(c.name for c in cameras)})
    points = tuple(
        p.model_copy(update={"file": existing(project.path, f"points[{i}].file", p.file)})
        for i, p in enumerate(project.points)
    )
    folder = project.output.model_copy(update={"folder": result_place(project.path, project.output.folder)})
    return project.model_copy(
        update={
            "camera": tuple(cameras),
            "markers": markers,
            "grid": grid,
            "sequence": sequence,
            "values": values,
            "points": points,
            "output": folder,
        }
    )


def _changed(project: DeformProject, wish: Changes) -> DeformProject:
    names = [c.name for c in project.camera]
    unknown = [n for n in (*wish.cameras, *wish.moves) if n not in names]
    if unknown:
        raise UsageError(f"the project has no camera {unknown[0]!r}; expected one of {', '.join(names)}")
    kept = [c for c in project.camera if not wish.cameras or c.name in wish.cameras]
    cameras = tuple(c.model_copy(update={"moves": c.moves or c.name in wish.moves}) for c in kept)
    values, sequence = project.values, project.sequence
    left = {c.name for c in cameras}
    if values is not None:
        mapped = tuple(n for n in values.cameras if n in left)
        values = values.model_copy(update={"cameras": mapped}) if mapped or not values.cameras else None
    if sequence.clock is not None and sequence.clock not in left:
        sequence = sequence.model_copy(update={"clock": None})
    return project.model_copy(update={"camera": cameras, "values": values, "sequence": sequence})
