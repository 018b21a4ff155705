"""The project file of an infrared run: cameras and their calibration, the surface, walls, frames and their times."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from windmark.errors import UsageError
from windmark.pipeline.deform.entries import RECORDING, LookEntry, MarkersEntry, MotionEntry, SequenceEntry, VolumeEntry
from windmark.pipeline.deform.entries import CameraEntry as DeformCamera
from windmark.pipeline.faults import Faults
from windmark.pipeline.infrared.walls import WallEntry
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.project_entries import Finite, GridEntry, NodeFormat, Positive, Unit
from windmark.pipeline.result_place import result_place
from windmark.pipeline.settings import Strict, existing, explained, read_toml
from windmark.pipeline.wanted import PointsEntry

Pattern = Annotated[str, Field(min_length=1)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
MOST_CAMERAS = 4
"""Each brings causes of its own, and a field has room for 30 of them."""
COLDEST_K, HOTTEST_K = 100.0, 3000.0
"""What temperatures in kelvin may be: others are in another unit."""


def kelvin(key: str, value: float | None) -> None:
    """See that a temperature is one in kelvin."""
    if value is not None and not COLDEST_K <= value <= HOTTEST_K:
        raise UsageError(f"{key} is {value:g}; expected a temperature in kelvin ({COLDEST_K:g} to {HOTTEST_K:g})")


class PlanckEntry(Strict):
    """A camera's calibration S = R / (exp(B / T) - 1) + O in its numbers; ``t_range_K``: where it holds.

    ``R``: of the formula. ``B``: of the formula. ``O``: of the formula.
    """

    R: Positive
    B: Positive
    O: Finite = 0.0  # noqa: E741 (its name in the formula)
    t_range_K: tuple[Positive, Positive] = (200.0, 800.0)

    @model_validator(mode="after")
    def _in_kelvin(self) -> PlanckEntry:
        kelvin("t_range_K", self.t_range_K[0])
        if self.t_range_K[0] >= self.t_range_K[1]:
            raise UsageError("t_range_K: expected the lower temperature first")
        return self


class CameraEntry(DeformCamera):
    """A camera as of `deform`, and what its numbers are.

    ``quantity``: "counts" with ``black_bodies`` (a table ``temperature_UNIT,counts[,sigma]``) or ``planck``;
    "temperature" (of a black body, in ``unit``: offset + scale * number) or "radiance" (W / (m2 sr), likewise), both
    in ``band_um``. ``even``: patterns of pictures of a black body that fills the view, of one or of a colder and a
    warmer one: pixels are made equal by them, and their scatter says the noise. ``netd_K`` says it instead, at
    ``netd_at_K``. ``saturation``: number from which on a pixel does not count.

    ``scale``: of the numbers. ``offset``: of the numbers. ``band_um``: wavelengths that the camera sees.
    ``black_bodies``: table of its calibration. ``planck``: constants of the maker's curve. ``netd_K``: 1
    sigma of a pixel, as a temperature. ``netd_at_K``: temperature at which ``netd_K`` is said.
    """

    quantity: Literal["counts", "temperature", "radiance"] = "counts"
    unit: Literal["K", "degC", "degF"] = "K"
    scale: Finite = 1.0
    offset: Finite = 0.0
    band_um: tuple[Positive, Positive] | None = None
    black_bodies: Path | None = None
    planck: PlanckEntry | None = None
    even: Annotated[tuple[Pattern, ...], Field(max_length=2)] = ()
    netd_K: Positive | None = None
    netd_at_K: Positive = 300.0
    saturation: Positive | None = None

    @model_validator(mode="after")
    def _calibrated(self) -> CameraEntry:
        tables = (self.black_bodies is not None) + (self.planck is not None)
        if self.quantity == "counts" and tables != 1:
            raise UsageError("counts need black_bodies (a table) or planck (R, B, O), one of them")
        if self.quantity != "counts" and (tables or self.band_um is None):
            raise UsageError(f"a {self.quantity} needs band_um = [low, high], and neither black_bodies nor planck")
        if self.band_um is not None and self.band_um[0] >= self.band_um[1]:
            raise UsageError("band_um: expected the shorter wavelength first, in micrometres")
        if not self.even and self.netd_K is None:
            raise UsageError("nothing says the noise; give netd_K, or even pictures")
        if self.scale == 0 or (self.quantity == "counts" and (self.scale, self.offset) != (1.0, 0.0)):
            raise UsageError("scale must not be 0; counts, which the calibration is of, have neither scale nor offset")
        kelvin("netd_at_K", self.netd_at_K)
        return self


class SurfaceEntry(Strict):
    """``emissivity``: seen straight on. ``angle``: how it falls with the viewing angle: "dielectric" (Fresnel, with
    ``index``) or "none"; a ``table`` (CSV ``angle_deg,emissivity``) says both. ``emissivity_sigma``: relative.

    ``surroundings_K``: what the surface reflects. ``transmission``, ``window_K``: of a window.

    ``index``: of refraction. ``table``: of the emissivity by the viewing angle. ``surroundings_sigma_K``: 1 sigma of
    ``surroundings_K``. ``transmission_sigma``: 1 sigma of ``transmission``.
    """

    emissivity: Annotated[float, Field(gt=0, le=1)] | None = None
    emissivity_sigma: Annotated[float, Field(ge=0, lt=1)]
    angle: Literal["dielectric", "none"] = "dielectric"
    index: Annotated[float, Field(gt=1, le=5)] = 1.5
    table: Path | None = None
    surroundings_K: Positive
    surroundings_sigma_K: NotNegative
    transmission: Annotated[float, Field(gt=0, le=1)] = 1.0
    transmission_sigma: Annotated[float, Field(ge=0, lt=1)] = 0.0
    window_K: Positive | None = None

    @model_validator(mode="after")
    def _whole(self) -> SurfaceEntry:
        if (self.emissivity is None) == (self.table is None):
            raise UsageError("give emissivity (seen straight on) or table (with the viewing angle), one of them")
        if (self.transmission < 1 or self.transmission_sigma) and self.window_K is None:
            raise UsageError("a window that takes light gives some back: window_K is needed")
        kelvin("surroundings_K", self.surroundings_K)
        kelvin("window_K", self.window_K)
        return self


class HeatEntry(Strict):
    """``start_s``: when the heating began; frames until then say the initial temperature.

    ``longest_gap``: frames in a row in which a node may be unseen. ``curvature``: corrected. ``most_lateral``: part of
    the flux that may flow along the surface before it is flagged.
    """

    start_s: Finite
    longest_gap: Annotated[int, Field(ge=0)] = 3
    curvature: bool = True
    most_lateral: Annotated[float, Field(gt=0, le=1)] = 0.1


class SamplingEntry(Strict):
    """``max_obliquity_deg``, ``edge_px``: surface seen more obliquely, or nearer to an outline, gets no value.

    ``clear``, ``marker_edge_px``: nor what is within so many radii of a marker's centre and so many pixels farther.
    ``max_saturated``: part of a picture's nodes that may be saturated. ``values``: from all pixels nearest to a node,
    or interpolated at it.
    """

    max_obliquity_deg: Annotated[float, Field(gt=0, lt=90)] = 70.0
    edge_px: Annotated[float, Field(ge=0, le=100)] = 3.0
    values: Literal["footprint", "nearest", "linear", "cubic"] = "footprint"
    clear: Annotated[float, Field(ge=0, le=10)] = 1.2
    marker_edge_px: Annotated[float, Field(ge=0, le=20)] = 2.5
    max_saturated: Annotated[float, Field(ge=0, le=1)] = 0.02


class OutputEntry(Strict):
    """What is written, and where: fields of every ``every``-th frame.

    ``folder``: of the results. ``grid``: formats of the fields on the grid. ``every``: how many frames from one field
    to the next.
    """

    folder: Path = Path("infrared")
    grid: tuple[NodeFormat, ...] = ("vtk",)
    every: Annotated[int, Field(ge=1)] = 1


class InfraredProject(Strict):
    """A whole infrared run. `path` is the project file; other paths are already absolute, patterns are not.

    ``title``: of the report. ``length_unit``: of every length in this file, and of files that do not say theirs.
    """

    path: Path
    title: str
    length_unit: Unit
    camera: Annotated[tuple[CameraEntry, ...], Field(min_length=1, max_length=MOST_CAMERAS)]
    markers: MarkersEntry
    grid: GridEntry
    volume: tuple[VolumeEntry, ...] = ()
    motion: MotionEntry = Field(default_factory=MotionEntry)
    look: LookEntry = Field(default_factory=LookEntry)
    sequence: SequenceEntry = Field(default_factory=SequenceEntry)
    surface: SurfaceEntry
    wall: tuple[WallEntry, ...] = ()
    heat: HeatEntry | None = None
    sampling: SamplingEntry = Field(default_factory=SamplingEntry)
    points: tuple[PointsEntry, ...] = ()
    output: OutputEntry = Field(default_factory=OutputEntry)

    @model_validator(mode="after")
    def _consistent(self) -> InfraredProject:
        faults = Faults()
        faults.names("camera", [c.name for c in self.camera])
        faults.files(self.camera)
        faults.names("volume", [v.name for v in self.volume])
        faults.names("points", [p.label for p in self.points])
        if (self.heat is None) != (not self.wall):
            words = ("heat and wall belong together: [heat] says when the heating began, [[wall]] what is below the "
                     "surface; without both there are temperatures alone")  # fmt: skip
            faults.add(words, "wall" if self.wall else "heat")
        walls = [v for w in self.wall for v in w.volumes]
        twice = sorted({v for v in walls if walls.count(v) > 1})
        if twice or (len(self.wall) > 1 and any(not w.volumes for w in self.wall)):
            why = f", {twice[0]} has several" if twice else "; several walls need their volumes"
            faults.add(f"every volume has one wall{why}", "wall")
        faults.refuse("InfraredProject")
        return self

    @property
    def lengths(self) -> Lengths:
        """What reads its files: their lengths are in its unit."""
        return Lengths.of_project(self.path, self.length_unit)


def read_infrared_project(path: str | Path, output: Path | None = None) -> InfraredProject:
    """Read and check the project file of an infrared run; ``output`` is another folder for the results.

    Raises
    ------
    FileError
        When the file is missing, no TOML, has an unknown or wrong key, or names a file that is absent.
    """
    path = Path(path)
    data = read_toml(path, InfraredProject)
    if output is not None and isinstance(data.setdefault("output", {}), dict):
        data["output"]["folder"] = output.resolve()
    try:
        project = InfraredProject(path=path.resolve(), **data)
    except ValidationError as error:
        raise explained(path, error, InfraredProject) from None
    return _with_absolute_paths(project)


def _with_absolute_paths(project: InfraredProject) -> InfraredProject:
    def moved(key: str, entry: Any, *fields: str) -> Any:
        named = {f: getattr(entry, f) for f in fields if getattr(entry, f) not in (None, RECORDING)}
        return entry.model_copy(update={f: existing(project.path, f"{key}.{f}", file) for f, file in named.items()})

    folder = result_place(project.path, project.output.folder)
    cameras = (moved(f"camera[{i}]", c, "file", "mask", "times", "black_bodies") for i, c in enumerate(project.camera))
    return project.model_copy(update={
        "camera": tuple(cameras),
        "markers": moved("markers", project.markers, "file"),
        "grid": moved("grid", project.grid, "file"),
        "sequence": moved("sequence", project.sequence, "frames"),
        "surface": moved("surface", project.surface, "table"),
        "points": tuple(moved(f"points[{i}]", p, "file") for i, p in enumerate(project.points)),
        "output": project.output.model_copy(update={"folder": folder}),
    })  # fmt: skip
