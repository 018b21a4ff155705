"""Every file that a project names, read by the reader of its kind; and how these fit each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from windmark import io
from windmark.errors import WindmarkError
from windmark.io.cameras.plausible import focal_doubt
from windmark.io.errors import FileError, decoding
from windmark.io.recordings.folder import picture_files
from windmark.pipeline.check.paint import paint_tables
from windmark.pipeline.check.paths import MODELS, other_paths, similar
from windmark.pipeline.check.places import SINGLE, place_lists
from windmark.pipeline.check.problems import Checked, Problem, keys_of, noting
from windmark.pipeline.deform.load import WHERE_IT_STANDS
from windmark.pipeline.same_picture import copy_words, shown_by
from windmark.pipeline.settings import existing, existing_picture
from windmark.pipeline.toml_lines import Key, line_of
from windmark.pipeline.verdict import BAD
from windmark.pipeline.verdict.grid import grid_findings, grid_look, grid_notes
from windmark.pipeline.verdict.inward import inward_findings
from windmark.pipeline.verdict.picture import picture_findings, picture_state
from windmark.scene import MarkerSet, Mesh

MOST_PICTURES = 2000
"""Pictures of a project whose files are opened; of more, evenly spaced ones."""


@dataclass
class Files:
    """Every file that a project names: read by the reader of its kind."""

    out: Checked
    lines: dict[Key, int]
    data: dict[str, Any]
    show: Callable[[str], None]
    numbers: list[int]
    cameras: dict[str, io.CameraFile] = field(default_factory=dict)
    pictures: dict[bytes, str] = field(default_factory=dict)

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
            with noting(self.out, self.lines, key):
                found = io.read_points(file, roles=roles, strict=key.partition(".")[0] in dict(SINGLE))
                self.out.read.append(f"{len(found.name)} places of {file.name}")
                self._unit(key, found.length_unit)
        for key, read in paint_tables(self.out.path, self.data) if self.out.kind == "psp" else ():
            self.show(f"read {key}")
            with noting(self.out, self.lines, key):
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
        with noting(self.out, self.lines, key):
            return read(self._there(existing, key, value))
        return None

    def _there(self, look: Callable[[Path, str, Path], Path], key: str, value: str) -> Path:
        """A file that is there; a `FileError` names one that is nearly called so."""
        try:
            return look(self.out.path, key, Path(value))
        except FileError as error:
            raise FileError(error.path, error.what + similar(self.out.path.parent / value), error.where) from None

    def _exists(self, key: str, value: str) -> None:
        with noting(self.out, self.lines, key):
            self._there(existing, key, value)

    def _camera(self, n: int, entry: dict[str, Any]) -> None:
        content = self._file(f"camera[{n}].file", entry.get("file"), io.read_camera_file)
        if content is None:
            return
        self.cameras[str(entry.get("name", "camera"))] = content
        width, height = content.camera.size_px
        focal = f"focal length {content.camera.focal_px:.0f} px"
        doubt = focal_doubt(content.camera)
        if doubt:
            self.out.problems.append(Problem(line_of(self.lines, ("camera", n, "file")), f"camera[{n}].file", doubt))
        note = "; ".join(said for said in content.note.split("; ") if said != doubt)
        noted = f"; {note}" if note else ""
        self.out.read.append(f"camera {entry.get('name', 'camera')}: {width} x {height} px, {focal}{noted}")
        self._unit(f"camera[{n}].file", content.length_unit if content.cam_from_model is not None else "")
        if content.cam_from_model is None and (self.out.kind != "run" or entry.get("pose") == "known"):
            words = f"{entry.get('file')} has no pose; expected {WHERE_IT_STANDS}"
            self.out.problems.append(Problem(line_of(self.lines, ("camera", n, "file")), f"camera[{n}].file", words))

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
        face, parts = self._at("grid", "volume_face"), self._at("grid", "volumes")
        options = {"volume_face": face} if face else {}
        named = {zone: name for name, zones in parts.items() for zone in zones} if _are_zones(parts) else {}
        try:
            mesh = io.read_mesh(path, volumes=named, only=True, **options) if named else io.read_mesh(path, **options)
        except FileError:
            raise
        except WindmarkError as error:  # a zone that the file has not
            self.out.problems.append(Problem(line_of(self.lines, ("grid", "volumes")), "grid.volumes", str(error)))
            mesh = io.read_mesh(path, **options)
        self.out.read.append(f"grid of {len(mesh.vertices)} nodes, {len(mesh.triangles)} triangles")
        self._unit("grid.file", mesh.length_unit)
        return mesh

    def _unit(self, key: str, said: str | None) -> None:
        unit = self.data.get("length_unit")
        if said and isinstance(unit, str) and said != unit:
            words = f"its lengths are in {said}, length_unit is {unit}; expected the same"
            self.out.problems.append(Problem(line_of(self.lines, keys_of(key)), key, words))

    def _fit(self, markers: MarkerSet, mesh: Mesh, unit: str) -> None:
        look = grid_look(markers, mesh)
        for found in grid_findings(markers, mesh, unit, look=look) + ([] if look is None else inward_findings(look)):
            if found.word == BAD or found.cause == "units":
                line = line_of(self.lines, ("markers", "file"))
                self.out.problems.append(Problem(line, "markers.file", found.reason))
            else:
                self.out.read.append(f"to look at: {found.reason}")
        self.out.read += [f"unchecked: {said}" for said in grid_notes(markers, mesh, unit, look)]

    def _image(self, n: int, entry: dict[str, Any]) -> None:
        file, key = entry.get("file"), f"image[{self.numbers[n] if self.numbers else n}].file"
        if not isinstance(file, str):
            return
        self.show(f"read {Path(file).name}")
        names = list(self.cameras)
        camera = self.cameras.get(str(entry.get("camera", names[0] if len(names) == 1 else "")))
        with noting(self.out, self.lines, key):
            full = self._there(existing_picture, key, file)
            page = {"page": entry["page"]} if isinstance(entry.get("page"), int) else {}
            image = io.read_grey(full, **page)
            size = (image.shape[1], image.shape[0])
            if camera is not None and camera.camera.size_px != size:
                w, h = camera.camera.size_px
                words = f"is {size[0]} x {size[1]} px, its camera {w} x {h}; expected the camera that took this image"
                raise FileError(full, words)
            self.out.read.append(f"image {Path(file).name}: {size[0]} x {size[1]} px, {image.dtype}")
            self._shown(full, image)

    def _shown(self, full: Path, image: NDArray[Any]) -> None:
        """What a picture itself says: it shows nothing, or what one before it shows."""
        for found in picture_findings(picture_state(image, None, "")):
            if found.word == BAD:
                raise FileError(full, found.reason)
            self.out.read.append(f"to look at: {full.name}: {found.reason}")
        first = self.pictures.setdefault(shown_by(image), full.name)
        if first != full.name:
            raise FileError(full, copy_words(first))

    def _list(self, key: str, images: Any, camera: str) -> None:
        patterns = [images] if isinstance(images, str) else images if isinstance(images, list) else []
        for pattern in patterns:
            if not isinstance(pattern, str):
                continue
            full = self.out.path.parent / pattern
            with noting(self.out, self.lines, key), decoding(full):
                found = [full] if full.is_file() else picture_files(full)
                self.show(f"read {len(found)} pictures of {camera}")
                some = found[:: max(1, -(-len(found) // MOST_PICTURES))]
                for one in some:
                    with noting(self.out, self.lines, key):
                        self._size(one, camera)
                self.out.read.append(f"{camera or 'camera'}: {len(found)} picture{'s' * (len(found) != 1)} ({pattern})")

    def _size(self, path: Path, camera: str) -> None:
        if io.is_recording(path):
            return
        image = io.read_grey(path)
        known = self.cameras.get(camera)
        if known is not None and known.camera.size_px != image.shape[1::-1]:
            w, h = known.camera.size_px
            raise FileError(path, f"is {image.shape[1]} x {image.shape[0]} px, its camera {w} x {h}")


def _are_zones(parts: Any) -> bool:
    """Whether the settings' ``grid.volumes`` is what it should be; where not, that is said elsewhere."""
    lists = parts.values() if isinstance(parts, dict) else [None]
    return all(isinstance(zones, list) and all(isinstance(zone, str) for zone in zones) for zones in lists)
