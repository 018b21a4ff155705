"""What lies in a folder of a test: pictures, cameras, marker tables, grids, recognised by their own readers."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from windmark import io
from windmark.errors import WindmarkError
from windmark.io.recordings.folder import PICTURES
from windmark.scene import MarkerSet

RECORDINGS = (".cine", ".mraw", ".cih", ".cihx", ".h5", ".hdf5", ".avi", ".mp4", ".ptw", ".ats")
TABLES = (".csv", ".tgts")
CAMERAS = (".json", ".yml", ".yaml", ".xml", ".txt", ".cameramodel", ".cahvor", ".cal")
LARGEST_TEXT = 4_000_000
"""Bytes of a file that may be a camera's."""
TAP_ROLES = {"tap", "virtual", "fiducial"}
NOT_LOOKED_AT = {"results", "truth", "out"}


@dataclass(frozen=True)
class FoundPicture:
    """A picture, or a recording: its place, and its (width, height)."""

    path: Path
    size_px: tuple[int, int]
    is_recording: bool = False


@dataclass
class FolderContent:
    """What was recognised.

    Parameters
    ----------
    folder : that was looked into
    pictures, cameras, markers, grids : by their readers
    points : tables of taps and the like, of which nothing is painted
    units : file -> the length unit that it says
    left_out : file -> why it takes no part
    """

    folder: Path
    pictures: list[FoundPicture] = field(default_factory=list)
    cameras: dict[Path, io.CameraFile] = field(default_factory=dict)
    markers: dict[Path, MarkerSet] = field(default_factory=dict)
    points: list[Path] = field(default_factory=list)
    grids: dict[Path, str] = field(default_factory=dict)
    units: dict[Path, str] = field(default_factory=dict)
    left_out: dict[Path, str] = field(default_factory=dict)


def look_into(folder: Path, show: Callable[[str], None] = lambda _: None) -> FolderContent:
    """Recognise the files of a folder and of the folders in it (one level; earlier results are left out).

    Raises
    ------
    OSError
        When it cannot be listed.
    """
    out = FolderContent(folder)
    for path in _files(folder):
        show(f"look at {path.name}")
        try:
            _recognise(path, out)
        except WindmarkError as error:
            out.left_out[path] = getattr(error, "what", str(error))
    return out


def _files(folder: Path) -> Iterable[Path]:
    inside = sorted(folder.iterdir(), key=lambda p: _natural(p.name))
    yield from (p for p in inside if p.is_file() and not p.name.startswith("."))
    for sub in (p for p in inside if p.is_dir() and not p.name.startswith(".") and p.name not in NOT_LOOKED_AT):
        if not (sub / "manifest.json").exists():
            yield from sorted((p for p in sub.iterdir() if p.is_file()), key=lambda p: _natural(p.name))


def _natural(name: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]


def _recognise(path: Path, out: FolderContent) -> None:
    suffix = path.suffix.lower()
    if suffix in PICTURES:
        image = io.read_grey(path)
        out.pictures.append(FoundPicture(path, (image.shape[1], image.shape[0])))
    elif suffix in RECORDINGS and io.is_recording(path):
        if suffix not in (".cih", ".cihx"):
            out.pictures.append(FoundPicture(path, io.frames(path).size_px, True))
    elif suffix in TABLES:
        _table(path, out)
    elif suffix in io.GRID_SUFFIXES or suffix in (".grid", ".grd", ".p3d", ".x", ".xyz"):
        kind, unit = io.grid_format(path), io.read_mesh(path).length_unit
        out.grids[path] = kind
        if unit:
            out.units[path] = unit
    elif suffix in CAMERAS and path.stat().st_size <= LARGEST_TEXT and _may_be_camera(path):
        out.cameras[path] = content = io.read_camera_file(path)
        if content.cam_from_model is not None and content.length_unit:
            out.units[path] = content.length_unit


def _may_be_camera(path: Path) -> bool:
    text = path.read_text(encoding="utf-8", errors="replace")
    if path.suffix.lower() == ".json" and not _is_json(text):  # cut off, or a typing error: its reader says where
        return True
    return "focal" in text or "document" in text[:500] or io.is_camera_text(text)


def _is_json(text: str) -> bool:
    try:
        json.loads(text.removeprefix("\ufeff"))
    except (ValueError, RecursionError):
        return False
    return True


def _table(path: Path, out: FolderContent) -> None:
    """A marker table, a table of taps, or one of something else."""
    if path.suffix.lower() == ".csv":
        with path.open(encoding="utf-8-sig", errors="replace") as stream:
            head = next((line for line in stream if line.strip() and not line.startswith("#")), "")
        columns = [c.strip() for c in head.split(",")]
        if not {"name", "x", "y", "z"} <= set(columns):
            return
    markers = io.read_markers(path, roles=None)
    if len(markers) and set(markers.role.tolist()) <= TAP_ROLES:
        if all(p.stem != path.stem for p in out.points):
            out.points.append(path)
        return
    out.markers[path] = markers
    if markers.length_unit:
        out.units[path] = markers.length_unit


def camera_of(picture: FoundPicture, content: FolderContent) -> list[Path]:
    """Camera files that may have taken a picture: of its size, and best by the numbers and words of its name."""
    fitting = [p for p, c in content.cameras.items() if c.camera.size_px == picture.size_px]
    name = picture.path.relative_to(content.folder).with_suffix("").as_posix()
    score = {p: _alike(name, p.stem) for p in fitting}
    best = max(score.values(), default=0)
    alike = [p for p in fitting if score[p] == best]
    return alike if best > 0 or len(fitting) == 1 else fitting


def _alike(picture: str, camera: str) -> int:
    """How much a camera's name is in a picture's: its first number counts most, then its words."""
    first = re.search(r"\d+", camera)
    numbers = [int(n) for n in re.findall(r"\d+", picture)]
    words = set(re.findall(r"[a-z]{3,}", camera.lower())) - {"camera"}
    whole = 4 if camera.lower() in picture.lower() else 0
    same = 2 if first is not None and numbers and int(first[0]) == numbers[0] else 0
    return whole + same + sum(w in picture.lower() for w in words)
