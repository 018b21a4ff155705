"""Which pictures and tables of a folder are frames, and which are a camera's calibration or readings of sensors."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from windmark import io
from windmark.errors import WindmarkError
from windmark.pipeline.folder import FolderContent, FoundPicture
from windmark.pipeline.new_project import Choice, Rel, common_pattern, unique_names, used_cameras

CALIBRATION = re.compile(r"dark|flat|cold|warm|even|black|white|calib|background", re.IGNORECASE)
"""In names of pictures, or of their folders, that are of no frame of a test."""
CAMERA = "{camera}"


def series_of(pictures: Sequence[FoundPicture], rel: Rel) -> list[str]:
    """Patterns, one for each series of numbered pictures of a folder; or the files themselves."""
    out: list[str] = []
    groups: dict[tuple[Path, str], list[Path]] = {}
    for p in pictures:
        groups.setdefault(series(p.path), []).append(p.path)
    for (folder, _), some in groups.items():
        pattern = common_pattern(some) if len(some) > 1 else None
        place = rel(folder)
        names = [Path(pattern).name] if pattern else [p.name for p in some]
        out += [name if place == "." else f"{place}/{name}" for name in names]
    return out


def series(path: Path) -> tuple[Path, str]:
    """Pictures of one folder whose names differ in what begins with a number."""
    return path.parent, re.split(r"\d", path.name)[0]


def frames_and_others(
    pictures: Sequence[FoundPicture], folder: Path
) -> tuple[list[FoundPicture], list[FoundPicture]]:
    """Frames of a test, and pictures whose names say that they calibrate the camera; all are frames where none else is.

    ``folder`` is the test's own, whose name says nothing of its pictures.
    """
    others = [p for p in pictures if CALIBRATION.search(_below(p.path, folder))]
    frames = [p for p in pictures if p not in others]
    return (frames, others) if frames else (list(pictures), [])


def common_of_cameras(content: FolderContent, choice: Choice, word: str, rel: Rel) -> str | None:
    """The pattern, with ``{camera}``, of the pictures of every camera that have a word in their names; None without."""
    used = used_cameras(choice)
    found = set()
    for camera, name in zip(used, unique_names(used), strict=True):
        mine = [p for p in content.pictures if choice.cameras[p.path] == camera and word in p.path.name.lower()]
        patterns = series_of(mine, rel)
        if len(patterns) != 1:
            return None
        found.add(patterns[0].replace(name, CAMERA) if len(used) > 1 else patterns[0])
    return found.pop() if len(found) == 1 else None


def places_of(content: FolderContent, readings: Path) -> Path | None:
    """The one table of places that has a row for every sensor of a table of readings."""
    try:
        names = set(io.read_table(readings, required=("name",), known=None).text("name"))
    except WindmarkError:
        return None
    found = [p for p in content.points if names and names <= _names(p)]
    return found[0] if len(found) == 1 else None


def _names(path: Path) -> set[str]:
    try:
        return set(io.read_points(path).name.tolist())
    except WindmarkError:
        return set()


def _below(path: Path, folder: Path) -> str:
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else path.name
