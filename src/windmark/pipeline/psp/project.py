"""The project file of a paint test: points and their pictures, cameras, laws, paint, taps, temperature, loads."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from windmark.errors import UsageError
from windmark.paint.cell_fit import MOST_P, MOST_T
from windmark.pipeline.deform.project import LookEntry, MarkersEntry, MotionEntry, VolumeEntry
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.project import Finite, GridEntry, NodeFormat, Positive, Role, Unit, Vector
from windmark.pipeline.settings import Strict, existing, explained, read_toml, unusable_name

Pattern = Annotated[str, Field(min_length=1)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

CAMERA = "{camera}"
"""Stands for a camera's name in the patterns of pictures."""


class CameraEntry(Strict):
    """One camera: a file with its lens and its pose (cam_from_tunnel). ``mask``: pixels that are used."""

    name: str
    file: Path
    mask: Path | None = None


class TableEntry(Strict):
    """The run/point table, CSV: a row per point, see `points.read_points_table`.

    ``alpha_at_rest_deg``: the incidence of the model as markers and grid have it, in the frame of the cameras' poses.
    ``max_alpha_error_deg``: how far the incidence that the pictures show may be from the table's; it tells rows that
    were exchanged.
    """

    table: Path
    alpha_at_rest_deg: Finite = 0.0
    max_alpha_error_deg: Positive = 0.5


class RadiometryEntry(Strict):
    """From grey levels to light. ``dark``, ``flat``: patterns of pictures; ``{camera}`` stands for the camera.

    ``black``: the grey level without light, where there are no dark pictures. ``saturation``: levels from which on a
    pixel is not used; ``max_saturated``: part of the model's pixels that may be, before the picture is refused.
    ``gain``: photo-electrons per grey level, and ``read_noise``: of reading a pixel, in grey levels (1 sigma); without
    them the pictures themselves say both.
    """

    dark: Pattern | None = None
    flat: Pattern | None = None
    black: Finite | None = None
    saturation: Positive | None = None
    max_saturated: Annotated[float, Field(ge=0, le=1)] = 0.02
    gain: Positive | None = None
    read_noise: NotNegative = 1.0

    @property
    def gain_levels(self) -> float | None:
        """Grey levels per photo-electron."""
        return None if self.gain is None else 1 / self.gain

    @property
    def read_variance(self) -> float:
        """Of reading a pixel, in grey levels squared, rounding included."""
        return self.read_noise**2 + 1 / 12

    @model_validator(mode="after")
    def _one_black(self) -> RadiometryEntry:
        if self.dark is not None and self.black is not None:
            raise UsageError("dark and black both say the level without light; give one of them")
        return self


class PaintEntry(Strict):
    """``cell``: measurements in a calibration cell, see `cell.read_cell`; or ``calibration``: what
    `windmark paint-calibrate` made of them.

    ``p_ref_Pa``, ``t_ref_K``: at which the cell's ratio is 1. ``orders``: highest powers of pressure and temperature;
    without them cross-validation chooses.
    """

    cell: Path | None = None
    calibration: Path | None = None
    p_ref_Pa: Positive = 1e5
    t_ref_K: Positive = 293.15
    orders: tuple[Annotated[int, Field(ge=1, le=MOST_P)], Annotated[int, Field(ge=0, le=MOST_T)]] | None = None

    @model_validator(mode="after")
    def _one(self) -> PaintEntry:
        if (self.cell is None) == (self.calibration is None):
            raise UsageError("expected either cell, a table of measurements, or calibration, what was made of it")
        own = sorted(self.model_fields_set & {"p_ref_Pa", "t_ref_K", "orders"})
        if self.calibration is not None and own:
            raise UsageError(f"{' and '.join(own)} belong to cell: the file of calibration has its own")
        return self


class LampEntry(Strict):
    """A lamp, taken as a point that shines on all sides; the light of several is added in proportion to ``power``."""

    position: Vector
    power: Positive = 1.0


class TapsEntry(Strict):
    """Pressure taps. ``pressures``: CSV ``point,name,pressure_UNIT[,sigma_UNIT]``. ``radius``: of the holes.

    ``in_situ``: the paint's pressure is fitted to the taps; "compare" only compares them.
    """

    file: Path
    pressures: Path
    roles: tuple[Role, ...] | None = None
    radius: Positive | None = None
    in_situ: Literal["offset-slope", "offset", "compare"] = "offset-slope"
    sigma: Positive | None = None


class TemperatureEntry(Strict):
    """Of the wall. ``recovery``: factor r of T = T_inf + r (T0 - T_inf).

    ``thermocouples`` (a table of places) and ``readings`` (CSV ``point,name,temperature_K[,sigma_K]``) say it better;
    recovery counts for points without readings. ``sigma_K``: by how much it varies over the wall, or differs from
    recovery (1 sigma); ``length``: over what distance it keeps about its value, a tenth of the grid's size by default.
    """

    recovery: Annotated[float, Field(gt=0, le=1.2)] | None = None
    sigma_K: Positive = 1.0
    length: Positive | None = None
    thermocouples: Path | None = None
    readings: Path | None = None

    @model_validator(mode="after")
    def _something(self) -> TemperatureEntry:
        if (self.thermocouples is None) != (self.readings is None):
            raise UsageError("thermocouples and readings belong together")
        if self.recovery is None and self.readings is None:
            raise UsageError("nothing says the temperature; give recovery, or thermocouples with readings")
        return self


class PatchesEntry(Strict):
    """Nodes near a marker or a tap get the value of their surroundings.

    ``clear``: within so many radii of its centre, 0: none; and ``edge_px`` pixels farther: lenses blur its rim.
    """

    clear: Annotated[float, Field(ge=0, le=10)] = 1.2
    edge_px: Annotated[float, Field(ge=0, le=20)] = 2.5


class SamplingEntry(Strict):
    """``max_obliquity_deg``, ``edge_px``: surface seen more obliquely, or nearer to an outline, gets no value.

    ``values``: from all pixels nearest to a node, or interpolated at it.
    """

    max_obliquity_deg: Annotated[float, Field(gt=0, le=90)] = 70.0
    edge_px: Annotated[float, Field(ge=0, le=100)] = 3.0
    values: Literal["footprint", "nearest", "linear", "cubic"] = "footprint"


class LoadsEntry(Strict):
    """Reference area, chord, span and moment point of the loads, in the project's length unit.

    ``least_seen``: part of a volume's seen side that must have values.
    """

    area: Positive
    chord: Positive
    span: Positive | None = None
    moment_point: Vector = (0.0, 0.0, 0.0)
    least_seen: Annotated[float, Field(ge=0, le=1)] = 0.5


class SectionEntry(Strict):
    """A cut of the surface by a plane: Cp over x / c there. ``chord``: the direction that x / c runs along."""

    name: str
    point: Vector
    normal: Vector
    volume: str | None = None


class OutputEntry(Strict):
    """What is written, and where."""

    folder: Path = Path("psp")
    grid: tuple[NodeFormat, ...] = ("vtk",)


class PspProject(Strict):
    """A whole paint test. `path` is the project file; other paths are already absolute, patterns are not."""

    path: Path
    title: str
    length_unit: Unit
    points: TableEntry
    camera: Annotated[tuple[CameraEntry, ...], Field(min_length=1)]
    markers: MarkersEntry
    grid: GridEntry
    volume: tuple[VolumeEntry, ...] = ()
    motion: MotionEntry = Field(default_factory=MotionEntry)
    look: LookEntry = Field(default_factory=LookEntry)
    radiometry: RadiometryEntry = Field(default_factory=RadiometryEntry)
    paint: PaintEntry
    lamp: tuple[LampEntry, ...] = ()
    taps: TapsEntry | None = None
    temperature: TemperatureEntry
    patches: PatchesEntry = Field(default_factory=PatchesEntry)
    sampling: SamplingEntry = Field(default_factory=SamplingEntry)
    loads: LoadsEntry | None = None
    section: tuple[SectionEntry, ...] = ()
    output: OutputEntry = Field(default_factory=OutputEntry)

    @model_validator(mode="after")
    def _consistent(self) -> PspProject:
        for kind, names in (("camera", [c.name for c in self.camera]), ("section", [s.name for s in self.section]),
                            ("volume", [v.name for v in self.volume])):  # fmt: skip
            twice = sorted({n for n in names if names.count(n) > 1})
            if twice:
                raise UsageError(f"{kind} names must be unique, more than once: {', '.join(twice)}")
            if (why := unusable_name(names)) is not None:
                raise UsageError(f"{kind} names become file names, and {why}")
        for key in ("dark", "flat"):
            pattern = getattr(self.radiometry, key)
            if pattern is not None and len(self.camera) > 1 and CAMERA not in pattern:
                raise UsageError(f"radiometry.{key}: expected {CAMERA} in the pattern, for there are several cameras")
        return self

    @property
    def lengths(self) -> Lengths:
        """What reads its files: their lengths are in its unit."""
        return Lengths.of_project(self.path, self.length_unit)


def read_psp_project(path: str | Path, output: Path | None = None) -> PspProject:
    """Read and check the project file of a paint test; ``output`` is another folder for the results.

    Raises
    ------
    FileError
        When the file is missing, no TOML, has an unknown or wrong key, or names a file that is absent.
    """
    path = Path(path)
    data = read_toml(path, PspProject)
    if output is not None and isinstance(data.setdefault("output", {}), dict):
        data["output"]["folder"] = output.resolve()
    try:
        project = PspProject(path=path.resolve(), **data)
    except ValidationError as error:
        raise explained(path, error, PspProject) from None
    return _with_absolute_paths(project)


def _with_absolute_paths(project: PspProject) -> PspProject:
    def moved(key: str, entry: Any, *fields: str) -> Any:
        named = {f: getattr(entry, f) for f in fields if entry is not None and getattr(entry, f) is not None}
        found = {f: existing(project.path, f"{key}.{f}", file) for f, file in named.items()}
        return entry if entry is None else entry.model_copy(update=found)

    folder = (project.path.parent / project.output.folder).resolve()
    return project.model_copy(update={
        "points": moved("points", project.points, "table"),
        "camera": tuple(moved(f"camera[{i}]", c, "file", "mask") for i, c in enumerate(project.camera)),
        "markers": moved("markers", project.markers, "file"),
        "grid": moved("grid", project.grid, "file"),
        "paint": moved("paint", project.paint, "cell", "calibration"),
        "taps": moved("taps", project.taps, "file", "pressures"),
        "temperature": moved("temperature", project.temperature, "thermocouples", "readings"),
        "output": project.output.model_copy(update={"folder": folder}),
    })  # fmt: skip
