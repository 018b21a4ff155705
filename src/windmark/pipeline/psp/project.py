"""The project file of a paint test: points and their pictures, cameras, laws, paint, taps, temperature, loads."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, field_validator, model_validator

from windmark.pipeline.deform.entries import LookEntry, MarkersEntry, MotionEntry, VolumeEntry
from windmark.pipeline.faults import Faults
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.project_entries import Finite, GridEntry, Unit, ViewEntry
from windmark.pipeline.psp.entries import (
    CAMERA,
    CameraEntry,
    LampEntry,
    LoadsEntry,
    OutputEntry,
    PaintEntry,
    PatchesEntry,
    RadiometryEntry,
    ReferenceEntry,
    SamplingEntry,
    SectionEntry,
    SelfIlluminationEntry,
    TableEntry,
    TapsEntry,
    TemperatureEntry,
)
from windmark.pipeline.psp.stream import constants_of
from windmark.pipeline.result_place import result_place
from windmark.pipeline.settings import Strict, existing, explained, read_toml
from windmark.pipeline.wanted import PointsEntry


class PspProject(Strict):
    """A whole paint test. `path` is the project file; other paths are already absolute, patterns are not.

    ``conditions``: of all points, for what neither the table of points nor a ``.wtd`` file says; keys as its columns.
    ``place``: lists of places on the model at rest at which results are wanted.

    ``title``: of the report. ``length_unit``: of every length in this file, and of files that do not say theirs.
    """

    path: Path
    title: str
    length_unit: Unit
    points: TableEntry
    conditions: Mapping[str, Finite] = Field(default_factory=dict)
    reference: ReferenceEntry | None = None
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
    self_illumination: SelfIlluminationEntry | None = None
    loads: LoadsEntry | None = None
    section: tuple[SectionEntry, ...] = ()
    place: tuple[PointsEntry, ...] = ()
    view: tuple[ViewEntry, ...] = ()
    output: OutputEntry = Field(default_factory=OutputEntry)

    @field_validator("conditions")
    @classmethod
    def _known(cls, said: Mapping[str, float]) -> Mapping[str, float]:
        constants_of(said)
        return said

    @model_validator(mode="after")
    def _consistent(self) -> PspProject:
        faults = Faults()
        faults.names("camera", [c.name for c in self.camera])
        faults.files(self.camera)
        faults.names("section", [s.name for s in self.section])
        faults.names("place", [p.label for p in self.place])
        faults.names("volume", [v.name for v in self.volume])
        faults.names("view", [v.name for v in self.view])
        for key in ("dark", "flat", "linearity"):
            pattern = getattr(self.radiometry, key)
            if pattern is not None and len(self.camera) > 1 and CAMERA not in pattern:
                words = f"expected {CAMERA} in the pattern, for there are several cameras"
                faults.add(words, "radiometry", key)
        faults.refuse("PspProject")
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

    folder = result_place(project.path, project.output.folder)
    return project.model_copy(update={
        "points": moved("points", project.points, "table"),
        "reference": moved("reference", project.reference, "table"),
        "camera": tuple(moved(f"camera[{i}]", c, "file", "mask") for i, c in enumerate(project.camera)),
        "view": tuple(moved(f"view[{i}]", v, "camera") for i, v in enumerate(project.view)),
        "place": tuple(moved(f"place[{i}]", p, "file") for i, p in enumerate(project.place)),
        "markers": moved("markers", project.markers, "file"),
        "grid": moved("grid", project.grid, "file"),
        "paint": moved("paint", project.paint, "cell", "calibration"),
        "taps": moved("taps", project.taps, "file", "pressures"),
        "temperature": moved("temperature", project.temperature, "thermocouples", "readings", "paint"),
        "patches": moved("patches", project.patches, "polygons"),
        "output": project.output.model_copy(update={"folder": folder}),
    })  # fmt: skip
