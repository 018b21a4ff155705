"""The project file: one TOML that names cameras, images, markers, grid and what is wanted.

Every key is checked before any work starts; an error names the file, the key and what was expected.
Paths are relative to the project file.
"""

from __future__ import annotations

from collections.abc import Mapping
from glob import has_magic
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator

from windmark.io import FileError, frame_address
from windmark.io.recordings.folder import picture_files
from windmark.pipeline.faults import Faults
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.project_entries import (
    AlignOptions,
    CameraEntry,
    DetectOptions,
    GridEntry,
    ImageEntry,
    MarkersEntry,
    OutputOptions,
    RegisterOptions,
    ResectOptions,
    SectionEntry,
    Unit,
    ViewEntry,
)
from windmark.pipeline.result_place import result_place
from windmark.pipeline.rig_settings import RigOptions, check_rig, instants, rig_cameras
from windmark.pipeline.settings import (
    Strict,
    existing,
    existing_picture,
    explained,
    read_toml,
    unusable_name,
)
from windmark.pipeline.wanted import LineEntry, MergeOptions, PointsEntry, check_merge


class Project(Strict):
    """A whole job. `path` is the project file; other paths are already absolute.

    ``title``: of the report. ``length_unit``: of every length in this file, and of files that do not say theirs.
    """

    path: Path
    title: str
    length_unit: Unit
    camera: Annotated[tuple[CameraEntry, ...], Field(min_length=1)]
    rig: RigOptions | None = None
    image: Annotated[tuple[ImageEntry, ...], Field(min_length=1)]
    markers: MarkersEntry | None = None
    grid: GridEntry | None = None
    detect: DetectOptions | None = None
    register_: RegisterOptions = Field(default_factory=RegisterOptions, alias="register")
    resect: ResectOptions = Field(default_factory=ResectOptions)
    view: tuple[ViewEntry, ...] = ()
    section: tuple[SectionEntry, ...] = ()
    points: tuple[PointsEntry, ...] = ()
    line: tuple[LineEntry, ...] = ()
    merge: MergeOptions | None = None
    align: AlignOptions | None = None
    output: OutputOptions = Field(default_factory=OutputOptions)

    @model_validator(mode="after")
    def _consistent(self) -> Project:
        faults = Faults()
        for table, names, key in (
            ("camera", [c.name for c in self.camera], "name"),
            ("image", [i.label for i in self.image], "name"),
            ("view", [v.name for v in self.view], "name"),
            ("section", [s.name for s in self.section], "name"),
            ("points", [p.label for p in self.points], "name"),
            ("line", [n.name for n in self.line], "name"),
        ):
            faults.names(table, names, key)
        points = list(dict.fromkeys(i.point for i in self.image if i.point is not None))
        if (why := unusable_name(points)) is not None:
            faults.add(f"point names become file names, and {why}", "image")
        self._check_images(faults)
        self._check_wanted(faults)
        faults.refuse("Project")
        return self

    def _check_images(self, faults: Faults) -> None:
        """Which camera took each, and whether there is what its pose is found from."""
        cameras = [c.name for c in self.camera]
        strange = False
        for k, image in enumerate(self.image):
            if image.camera is None and len(cameras) > 1:
                faults.add(f"image {image.label}: say which camera took it, one of {', '.join(cameras)}", "image", k)
                strange = True
            elif image.camera is not None and image.camera not in cameras:
                faults.known(image.camera, cameras, "a camera", "image", k, "camera")
                strange = True
        missing = [name for name in ("markers", "detect") if getattr(self, name) is None]
        if missing and any(c.pose == "find" for c in self.camera):
            faults.add(f"[{missing[0]}] is missing: the cameras' poses are found from markers in the images")
        if self.rig is not None and not strange:
            found = [c.name for c in self.camera if c.pose == "find"]
            known = [c.name for c in self.camera if c.pose == "known"]
            with faults.at("rig"):
                check_rig(self.rig, found, known, self._taken())
        if self.register_.binding and not any(i.labels for i in self.image):
            faults.add("binding says that labels are facts, but no image has labels", "register", "binding")
        if self.merge is not None and not strange:
            with faults.at("merge"):
                check_merge(self.merge, self._taken(), bool(self.grid))
            taken = sorted({"merged", *(f"merged-{i.point}" for i in self.image)} & {i.label for i in self.image})
            if taken:
                faults.add(f"its folder {taken[0]} has the name of an image; name the image otherwise", "merge")

    def _check_wanted(self, faults: Faults) -> None:
        """Alignment, and what needs a grid."""
        if self.align:
            faults.known(self.align.reference, [i.label for i in self.image], "an image", "align", "reference")
            if self.align.background == "keep" and len({i.camera for i in self.image if i.camera}) > 1:
                words = 'background = "keep" needs images of one camera; these are of several'
                faults.add(words, "align", "background")
            if len({(i.quantity, i.unit) for i in self.image}) > 1:
                faults.add("all images must have the same quantity and unit, for they are subtracted", "align")
        if self.grid is not None and self.markers is not None and self.markers.surface is not None:
            faults.add("surface does nothing beside [grid], which says it, too: one of them", "markers", "surface")
        wanted = [name for name in ("view", "section", "align", "points", "line") if getattr(self, name)]
        if self.grid is None and wanted:
            words = "views, sections, points, lines and alignment need a grid: add [grid] file = ..."
            faults.add(words, wanted[0])

    @property
    def lengths(self) -> Lengths:
        """What reads its files: their lengths are in its unit."""
        return Lengths.of_project(self.path, self.length_unit)

    def camera_of(self, image: ImageEntry) -> CameraEntry:
        """The camera that took an image."""
        return next(c for c in self.camera if image.camera in (None, c.name))

    def _taken(self) -> list[tuple[str, str | None, str]]:
        """Name, point and camera of every image."""
        return [(i.label, i.point, self.camera_of(i).name) for i in self.image]

    @property
    def rig_cameras(self) -> tuple[str, ...]:
        """The cameras of the rig; none without one."""
        return rig_cameras(self.rig, [c.name for c in self.camera if c.pose == "find"])

    @property
    def instants(self) -> tuple[tuple[ImageEntry, ...], ...]:
        """Images that cameras of the rig took at the same instant, two and more of each."""
        of_label = {i.label: i for i in self.image}
        groups = instants(self.rig, [c.name for c in self.camera if c.pose == "find"], self._taken()).values()
        return tuple(tuple(of_label[name] for name, _ in group) for group in groups if len(group) > 1)


def read_project(path: str | Path, given: Mapping[str, Mapping[str, Any]] | None = None) -> Project:
    """Read and check a project file.

    Parameters
    ----------
    path : the TOML file
    given : tables whose keys replace those of the file

    Raises
    ------
    FileError
        When the file is missing, no TOML, has an unknown or wrong key, or names a file that is absent.
    """
    path = Path(path)
    data = with_pictures(path, read_toml(path, Project))
    for table, keys in (given or {}).items():
        if isinstance(data.setdefault(table, {}), dict):
            data[table] |= keys
    return make_project(path, data)


def with_pictures(path: Path, data: dict[str, Any]) -> dict[str, Any]:
    """Settings with a table for each picture of ``[[image]] file = "img*.tif"``, in natural order.

    Raises
    ------
    FileError
        For a pattern that no picture matches, and for a name or labels beside one that several match.
    """
    images = data.get("image")
    if not isinstance(images, list):
        return data
    return {**data, "image": [one for n, entry in enumerate(images) for one in pictures_of(path, n, entry)]}


def pictures_of(path: Path, number: int, entry: Any) -> list[Any]:
    """The tables of one ``[[image]]``, several where its file is a pattern; see `with_pictures`."""
    file = entry.get("file") if isinstance(entry, dict) else None
    if not isinstance(file, str) or not has_magic(file):
        return [entry]
    full = path.resolve().parent / file  # of a relative path the project would look for what it found once more
    if frame_address(full).number is not None or full.exists():
        return [entry]
    found = picture_files(full)
    alone = [key for key in ("name", "labels", "exclude", "page") if key in entry]
    if len(found) > 1 and alone:
        raise FileError(path, f"is of one picture, the pattern is of {len(found)}", f"image[{number}].{alone[0]}")
    stems = [p.stem for p in found]
    double = {stem for stem in stems if stems.count(stem) > 1}
    names = [{"name": f"{p.parent.name}-{p.stem}"} if p.stem in double else {} for p in found]
    return [{**entry, "file": str(p), **name} for p, name in zip(found, names, strict=True)]


def make_project(path: Path, settings: Mapping[str, Any]) -> Project:
    """A checked project from the settings that a project file would hold; ``path`` gives the base of its paths."""
    try:
        project = Project(path=path.resolve(), **settings)
    except ValidationError as error:
        raise explained(path, error, Project) from None
    return _with_absolute_paths(project)


def _with_absolute_paths(project: Project) -> Project:
    register = project.register_
    if register.prior is not None:
        register = register.model_copy(update={"prior": existing(project.path, "register.prior", register.prior)})

    rig = project.rig
    if rig is not None and rig.file is not None:
        rig = rig.model_copy(update={"file": existing(project.path, "rig.file", rig.file)})

    detect = project.detect
    if detect is not None and detect.mask is not None:
        detect = detect.model_copy(update={"mask": existing_picture(project.path, "detect.mask", detect.mask)})

    def moved(key: str, entry: Strict) -> Strict:
        return entry.model_copy(update={"file": existing(project.path, f"{key}.file", entry.file)})  # type: ignore[attr-defined]

    def found(i: int, entry: ImageEntry) -> ImageEntry:
        return entry.model_copy(update={"file": existing_picture(project.path, f"image[{i}].file", entry.file)})

    def located(key: str, view: ViewEntry) -> ViewEntry:
        if view.camera is None:
            return view
        return view.model_copy(update={"camera": existing(project.path, f"{key}.camera", view.camera)})

    return project.model_copy(
        update={
            "view": tuple(located(f"view[{i}]", v) for i, v in enumerate(project.view)),
            "camera": tuple(moved(f"camera[{i}]", c) for i, c in enumerate(project.camera)),
            "image": tuple(found(i, c) for i, c in enumerate(project.image)),
            "markers": moved("markers", project.markers) if project.markers else None,
            "points": tuple(moved(f"points[{i}]", p) for i, p in enumerate(project.points)),
            "grid": moved("grid", project.grid) if project.grid else None,
            "register_": register,
            "rig": rig,
            "detect": detect,
            "output": project.output.model_copy(
                update={"folder": result_place(project.path, project.output.folder)}
            ),
        }
    )
