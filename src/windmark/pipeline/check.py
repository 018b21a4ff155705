"""Everything that is wrong with a project, all at once, without running it: settings, files, and how they fit."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from windmark import io
from windmark.errors import WindmarkError
from windmark.io.errors import FileError, decoding
from windmark.io.recordings.folder import picture_files
from windmark.pipeline.check_paint import paint_tables
from windmark.pipeline.check_paths import other_paths, similar
from windmark.pipeline.check_places import place_lists
from windmark.pipeline.deform.project import DeformProject
from windmark.pipeline.infrared import InfraredProject
from windmark.pipeline.kinds import KINDS, kind_of
from windmark.pipeline.likely_unit import likely_unit, model_box
from windmark.pipeline.project import Project, pictures_of
from windmark.pipeline.psp import PspProject
from windmark.pipeline.settings import existing, existing_picture, explanation, read_settings
from windmark.pipeline.toml_lines import Key, line_of, toml_lines
from windmark.scene import MarkerSet, Mesh

MODELS: dict[str, type[BaseModel]] = {
    "run": Project, "deform": DeformProject, "psp": PspProject, "infrared": InfraredProject,
}  # fmt: skip
_IMAGE = re.compile(r"^image\[(\d+)\]")
MOST_PICTURES = 2000
"""Pictures of a project whose files are opened; of more, evenly spaced ones."""


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong.

    Parameters
    ----------
    line : of the project file; None where it is of no line
    key : the setting
    words : what is wrong, and what was expected
    """

    line: int | None
    key: str
    words: str

    def __str__(self) -> str:
        place = ([] if self.line is None else [f"line {self.line}"]) + ([self.key] if self.key else [])
        return f"{', '.join(place)}: {self.words}" if place else self.words


@dataclass
class Checked:
    """What was found.

    Parameters
    ----------
    path : the project file
    kind : the verb that carries it out; "" unknown
    problems : all, in the order of the file
    read : what was read and is sound, in words
    """

    path: Path
    kind: str = ""
    problems: list[Problem] = field(default_factory=list)
    read: list[str] = field(default_factory=list)


def check_project(path: Path, show: Callable[[str], None] = lambda _: None) -> Checked:
    """Check a project file of any kind.

    Parameters
    ----------
    show : is told what is being looked at

    Raises
    ------
    FileError
        When it cannot be read, or is no TOML: then there is nothing else to be said.
    """
    data = read_settings(path)
    lines = toml_lines(path.read_text(encoding="utf-8-sig"))
    kind = kind_of(data) or "run"
    out = Checked(path, kind)
    if kind_of(data) is None and data:
        out.problems.append(Problem(None, "", f"has keys of several kinds of projects, or of none; taken as that of "
                                    f"{KINDS[kind]} (windmark {kind})"))  # fmt: skip
    whole, numbers = _expanded(out, lines, data) if kind == "run" else (data, [])
    model = MODELS[kind]
    try:
        model(path=path.resolve(), **{k: v for k, v in whole.items() if k != "path"})
    except ValidationError as error:
        for one in error.errors():
            key, words = explanation(one, model)
            key = _IMAGE.sub(lambda found: f"image[{numbers[int(found[1])]}]", key or "") if numbers else key or ""
            if all(p.key != key and not key.startswith(f"{p.key}[") and not p.key.startswith(f"{key}[")
                   for p in out.problems):  # fmt: skip
                out.problems.append(Problem(line_of(lines, _keys(key)), key, words))
    _Files(out, lines, whole, show, numbers).look()
    out.problems.sort(key=lambda p: (p.line is None, p.line or 0))
    return out


def _expanded(out: Checked, lines: dict[Key, int], data: dict[str, Any]) -> tuple[dict[str, Any], list[int]]:
    """Settings with a table for each picture of a pattern, and of which ``[[image]]`` each is."""
    images = data.get("image")
    if not isinstance(images, list):
        return data, []
    every: list[Any] = []
    numbers: list[int] = []
    for n, entry in enumerate(images):
        with _noting(out, lines, f"image[{n}].file"):
            some = pictures_of(out.path, n, entry)
            every += some
            numbers += [n] * len(some)
    return {**data, "image": every} if every else data, numbers


@contextmanager
def _noting(out: Checked, lines: dict[Key, int], key: str = "") -> Iterator[None]:
    """What is refused within becomes a problem at a key."""
    try:
        yield
    except FileError as error:
        of_project = error.path.resolve() == out.path.resolve()
        where = str(error.where or key) if of_project else key
        words = error.what if of_project else str(error)
        out.problems.append(Problem(line_of(lines, _keys(where)), where, words))
    except WindmarkError as error:
        out.problems.append(Problem(line_of(lines, _keys(key)), key, str(error)))


def _keys(key: str | None) -> Key:
    """``image[0].file`` as pydantic names it."""
    parts = re.findall(r"[^.\[\]]+", key or "")
    return tuple(int(p) if p.isdigit() else p for p in parts)


@dataclass
class _Files:
    """Every file that a project names: read by the reader of its kind."""

    out: Checked
    lines: dict[Key, int]
    data: dict[str, Any]
    show: Callable[[str], None]
    numbers: list[int]
    cameras: dict[str, io.CameraFile] = field(default_factory=dict)

    def look(self) -> None:
        """Read what is named; from the settings themselves, for these may be wrong elsewhere."""
        unit = self.data.get("length_unit")
        markers: MarkerSet | None = None
        mesh: Mesh | None = None
        for n, entry in enumerate(self._tables("camera")):
            self._camera(n, entry)
            self._list(f"camera[{n}].images", entry.get("images"), str(entry.get("name", "")))
        markers = self._file("markers.file", self._at("markers", "file"), self._markers)
        mesh = self._file("grid.file", self._at("grid", "file"), self._mesh)
        for n, entry in enumerate(self._tables("image")):
            self._image(n, entry)
        for key, value in other_paths(MODELS[self.out.kind], self.data):
            self._exists(key, value)
        for key, file, roles in place_lists(self.out.path, self.data):
            with _noting(self.out, self.lines, key):
                found = io.read_points(file, roles=roles)
                self.out.read.append(f"{len(found.name)} places of {file.name}")
                self._unit(key, found.length_unit)
        for key, read in paint_tables(self.out.path, self.data) if self.out.kind == "psp" else ():
            self.show(f"read {key}")
            with _noting(self.out, self.lines, key):
                self.out.read.append(read())
        if markers is not None and mesh is not None and isinstance(unit, str) and unit in io.LENGTH_UNITS:
            self._fit(markers, mesh, unit)

    def _tables(self, name: str) -> list[dict[str, Any]]:
        found = self.data.get(name)
        return [e for e in found if isinstance(e, dict)] if isinstance(found, list) else []

    def _at(self, table: str, key: str) -> Any:
        found = self.data.get(table)
        return found.get(key) if isinstance(found, dict) else None

    def _file(self, key: str, value: Any, read: Callable[[Path], Any]) -> Any:
        if not isinstance(value, str):
            return None
        self.show(f"read {value}")
        with _noting(self.out, self.lines, key):
            return read(self._there(existing, key, value))
        return None

    def _there(self, look: Callable[[Path, str, Path], Path], key: str, value: str) -> Path:
        """A file that is there; a `FileError` names one that is nearly called so."""
        try:
            return look(self.out.path, key, Path(value))
        except FileError as error:
            raise FileError(error.path, error.what + similar(self.out.path.parent / value), error.where) from None

    def _exists(self, key: str, value: str) -> None:
        with _noting(self.out, self.lines, key):
            self._there(existing, key, value)

    def _camera(self, n: int, entry: dict[str, Any]) -> None:
        content = self._file(f"camera[{n}].file", entry.get("file"), io.read_camera_file)
        if content is None:
            return
        self.cameras[str(entry.get("name", "camera"))] = content
        width, height = content.camera.size_px
        focal = f"focal length {content.camera.focal_px:.0f} px"
        self.out.read.append(f"camera {entry.get('name', 'camera')}: {width} x {height} px, {focal}")
        self._unit(f"camera[{n}].file", content.length_unit if content.cam_from_model is not None else "")

    def _markers(self, path: Path) -> MarkerSet:
        wrong = any(p.key.startswith("markers.roles") for p in self.out.problems)
        roles = None if wrong else self._at("markers", "roles")
        markers = io.read_markers(path, **({"roles": tuple(roles)} if isinstance(roles, list) and roles else {}))
        self.out.read.append(f"{len(markers)} markers of the roles {', '.join(sorted(set(markers.role.tolist())))}")
        if len(markers) < 4:
            raise FileError(path, f"has {len(markers)} markers with these roles; four are needed for a pose")
        self._unit("markers.file", markers.length_unit)
        return markers

    def _mesh(self, path: Path) -> Mesh:
        face = self._at("grid", "volume_face")
        mesh = io.read_mesh(path, **({"volume_face": face} if face else {}))
        self.out.read.append(f"grid of {len(mesh.vertices)} nodes, {len(mesh.triangles)} triangles")
        self._unit("grid.file", mesh.length_unit)
        return mesh

    def _unit(self, key: str, said: str | None) -> None:
        unit = self.data.get("length_unit")
        if said and isinstance(unit, str) and said != unit:
            words = f"its lengths are in {said}, length_unit is {unit}; expected the same"
            self.out.problems.append(Problem(line_of(self.lines, _keys(key)), key, words))

    def _fit(self, markers: MarkerSet, mesh: Mesh, unit: str) -> None:
        units, _ = likely_unit(markers.xyz[markers.role != "wall"], model_box(mesh), unit)
        if units:
            words = f"by their size and place on the grid the markers are rather in {' or '.join(units)} than in {unit}"
            self.out.problems.append(Problem(line_of(self.lines, ("markers", "file")), "markers.file", words))

    def _image(self, n: int, entry: dict[str, Any]) -> None:
        file, key = entry.get("file"), f"image[{self.numbers[n] if self.numbers else n}].file"
        if not isinstance(file, str):
            return
        self.show(f"read {Path(file).name}")
        names = list(self.cameras)
        camera = self.cameras.get(str(entry.get("camera", names[0] if len(names) == 1 else "")))
        with _noting(self.out, self.lines, key):
            full = self._there(existing_picture, key, file)
            page = {"page": entry["page"]} if isinstance(entry.get("page"), int) else {}
            image = io.read_grey(full, **page)
            size = (image.shape[1], image.shape[0])
            if camera is not None and camera.camera.size_px != size:
                w, h = camera.camera.size_px
                words = f"is {size[0]} x {size[1]} px, its camera {w} x {h}; expected the camera that took this image"
                raise FileError(full, words)
            self.out.read.append(f"image {Path(file).name}: {size[0]} x {size[1]} px, {image.dtype}")

    def _list(self, key: str, images: Any, camera: str) -> None:
        patterns = [images] if isinstance(images, str) else images if isinstance(images, list) else []
        for pattern in patterns:
            if not isinstance(pattern, str):
                continue
            full = self.out.path.parent / pattern
            with _noting(self.out, self.lines, key), decoding(full):
                found = [full] if full.is_file() else picture_files(full)
                self.show(f"read {len(found)} pictures of {camera}")
                some = found[:: max(1, -(-len(found) // MOST_PICTURES))]
                for one in some:
                    with _noting(self.out, self.lines, key):
                        self._size(one, camera)
                self.out.read.append(f"{camera or 'camera'}: {len(found)} pictures ({pattern})")

    def _size(self, path: Path, camera: str) -> None:
        if io.is_recording(path):
            return
        image = io.read_grey(path)
        known = self.cameras.get(camera)
        if known is not None and known.camera.size_px != image.shape[1::-1]:
            w, h = known.camera.size_px
            raise FileError(path, f"is {image.shape[1]} x {image.shape[0]} px, its camera {w} x {h}")
