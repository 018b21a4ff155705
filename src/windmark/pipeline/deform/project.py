"""The project file of a deformation test, read and checked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError, model_validator

from windmark.errors import UsageError
from windmark.pipeline.deform.entries import (
    RECORDING,
    CameraEntry,
    LookEntry,
    MarkersEntry,
    MotionEntry,
    OutputEntry,
    SequenceEntry,
    StationsEntry,
    ValuesEntry,
    VolumeEntry,
    WatchEntry,
    no_law,
)  # fmt: skip
from windmark.pipeline.faults import Faults
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.project_entries import GridEntry, Unit
from windmark.pipeline.result_place import result_place
from windmark.pipeline.settings import Strict, existing, explained, read_toml
from windmark.pipeline.wanted import PointsEntry


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
