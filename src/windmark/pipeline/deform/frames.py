"""Which images belong to one instant: from files on a disk, or as they arrive in a folder."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatch
from glob import glob
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.pipeline.deform.project import RECORDING, CameraEntry, DeformProject
from windmark.pipeline.deform.task import FrameImages
from windmark.pipeline.deform.timeline import Timeline, key_of, timeline

Array = NDArray[np.float64]

POLL_S = 0.005
"""How often a watched folder is looked at."""
SETTLED_S = 0.02
"""A file that has not grown for so long is taken as whole."""


@dataclass(frozen=True)
class FrameTable:
    """What is known of the frames besides their images.

    Parameters
    ----------
    key : F keys; empty without a table
    time_s : (F,) NaN where unknown
    columns : name -> (F,) further quantities, such as the angle of attack
    """

    key: tuple[str, ...] = ()
    time_s: Array = field(default_factory=lambda: np.zeros(0))
    columns: Mapping[str, Array] = field(default_factory=dict)

    def row(self, key: str) -> int | None:
        """Where a frame stands; None if it is not there."""
        return self.key.index(key) if key in self.key else None


def read_frame_table(project: DeformProject) -> FrameTable:
    """The table of frames that a project names; an empty one without.

    Raises
    ------
    FileError
        For a table without the column ``frame``, with a frame twice, or cells that are no numbers.
    """
    path = project.sequence.frames
    if path is None:
        return FrameTable()
    table = io.read_table(path, required=("frame",), known=None)
    keys = tuple(key_of(str(v)) for v in table.text("frame"))
    twice = sorted({k for k in keys if keys.count(k) > 1})
    if twice:
        raise io.FileError(path, f"frame {twice[0]} is there more than once", "frame")
    columns = {n: table.numbers(n) for n in table.columns if n != "frame"}
    return FrameTable(keys, columns.pop("time_s", np.full(len(keys), np.nan)), columns)


def frames_on_disk(project: DeformProject, recorded: Mapping[str, Array] | None = None) -> list[FrameImages]:
    """The images of every instant, in order.

    Parameters
    ----------
    project : names the cameras, their images and clocks
    recorded : camera -> times in seconds that its recording holds, picture by picture

    Raises
    ------
    FileError
        When a pattern matches no file, two images of a camera are the same frame, or the cameras' clocks do not fit.
    """
    return instants_of(project, recorded).frames


def instants_of(project: DeformProject, recorded: Mapping[str, Array] | None = None) -> Timeline:
    """`frames_on_disk` with the camera that gives the instants and with what is odd about the clocks."""
    found = {c.name: _images(project, i, c) for i, c in enumerate(project.camera)}
    if recorded or any(c.has_clock for c in project.camera):
        return timeline(project, found, {**_stamps(project, found), **(recorded or {})})
    keys = sorted({k for images in found.values() for k in images}, key=_order)
    instants = _instants(keys)
    frames = [
        FrameImages(key, instants[key], {n: images[key] for n, images in found.items() if key in images})
        for key in keys
    ]
    return Timeline(frames, "")


def _stamps(project: DeformProject, found: Mapping[str, Mapping[str, io.PictureFile]]) -> dict[str, Array]:
    """Camera -> the times that its recording holds, for cameras of which nothing else says when their pictures were."""
    out = {}
    for i, camera in enumerate(project.camera):
        if camera.rate_hz is not None or camera.times not in (None, RECORDING):
            continue
        files = [found[camera.name][key] for key in sorted(found[camera.name], key=_order)]
        stamps = np.array([f.time_s if isinstance(f, io.Frame) else np.nan for f in files])
        if np.isfinite(stamps).any():
            out[camera.name] = stamps
        elif camera.times == RECORDING:
            raise io.FileError(
                project.path, f"{files[0].name} and the other pictures of camera {camera.name} hold no time stamps; "
                "expected a recording that does, a table, or rate_hz", f"camera[{i}].times",
            )  # fmt: skip
    return out


def _images(project: DeformProject, i: int, camera: CameraEntry) -> dict[str, io.PictureFile]:
    base = project.path.parent
    out: dict[str, io.PictureFile] = {}
    for pattern in camera.patterns:
        files = _files(base / pattern)
        if not files:
            raise io.FileError(project.path, f"no file matches {pattern!r} beside the project", f"camera[{i}].images")
        for file in files:
            key = key_of(file.stem)
            if key in out:
                raise io.FileError(
                    project.path, f"{out[key].name} and {file.name} are both frame {key} of camera {camera.name}",
                    f"camera[{i}].images",
                )  # fmt: skip
            out[key] = file
    return out


def _files(pattern: Path) -> list[io.PictureFile]:
    """The pictures that a pattern names; recordings and folders frame by frame."""
    address = io.frame_address(pattern)
    if address.dataset is not None or address.number is not None or address.file.exists():
        return io.pictures([pattern]) if address.file.exists() else []
    return io.pictures(sorted(Path(p) for p in glob(str(pattern), recursive=True) if Path(p).is_file()))


def _order(key: str) -> tuple[int, int, str]:
    return (0, int(key), "") if key.isdigit() else (1, 0, key)


def _instants(keys: Sequence[str]) -> dict[str, float]:
    """Numbers are instants, so that dropped frames leave gaps; names count one by one."""
    if all(k.isdigit() for k in keys):
        return {k: float(k) for k in keys}
    return {k: float(n) for n, k in enumerate(keys)}


def watch(
    project: DeformProject, folder: Path, *, idle_s: float | None = None, stop_after: int | None = None
) -> Iterator[FrameImages]:
    """Images as they arrive in a folder: a frame is handed on when every camera has it, or a later one is complete.

    Parameters
    ----------
    project : names the cameras and their patterns; only the file names of these count
    folder : where images appear, sub-folders included when the patterns name them
    idle_s : end when nothing has come for so long; None waits for ever (Ctrl-C ends)
    stop_after : end after so many frames

    Raises
    ------
    FileError
        When there is no such folder.
    """
    if not folder.is_dir():
        raise io.FileError(folder, "is no folder; expected one that images are written to")
    waiting: dict[str, dict[str, Path]] = {}
    inbox = _Inbox(project, folder)
    done, last_key, last_new = 0, -1, time.monotonic()
    while True:
        for camera, path in inbox.arrived():
            last_new = time.monotonic()
            key = key_of(path.stem)
            if not key.isdigit() or int(key) > last_key:
                waiting.setdefault(key, {})[camera] = path
        for key in _ready(waiting, len(project.camera)):
            images = waiting.pop(key)
            last_key = int(key) if key.isdigit() else last_key
            yield FrameImages(key, float(last_key) if key.isdigit() else float(done), images)
            done += 1
            last_new = time.monotonic()
            if stop_after is not None and done >= stop_after:
                return
        if idle_s is not None and time.monotonic() - last_new > idle_s:
            for key in sorted(waiting, key=_order):  # what never became complete
                yield FrameImages(key, float(key) if key.isdigit() else float(done), waiting[key])
                done += 1
            return
        time.sleep(POLL_S)


def _ready(waiting: Mapping[str, Mapping[str, Path]], cameras: int) -> list[str]:
    """Complete frames, and those that a later complete one has overtaken."""
    complete = [k for k in sorted(waiting, key=_order) if len(waiting[k]) == cameras]
    if not complete:
        return []
    return [k for k in sorted(waiting, key=_order) if _order(k) <= _order(complete[-1])]


class _Inbox:
    """New files of a folder. A folder that has not changed is not listed again, however many files it holds."""

    def __init__(self, project: DeformProject, folder: Path) -> None:
        names = {Path(p).parent.name for c in project.camera for p in c.patterns}
        self._folders = [folder, *(folder / n for n in sorted(names) if n)]
        self._patterns = [(c.name, Path(p).name, Path(p).parent.name) for c in project.camera for p in c.patterns]
        self._changed: dict[Path, int] = {}
        self._seen: set[str] = set()
        self._growing: dict[Path, str] = {}

    def arrived(self) -> list[tuple[str, Path]]:
        """Cameras and files that are new and whole."""
        for folder in self._folders:
            if folder.is_dir():
                self._list(folder)
        out, now = [], time.time()
        for path, camera in list(self._growing.items()):
            try:
                stat = path.stat()
            except OSError:  # renamed since: it comes again under its new name
                del self._growing[path]
                continue
            if stat.st_size and now - stat.st_mtime >= SETTLED_S:
                del self._growing[path]
                out.append((camera, path))
        return out

    def _list(self, folder: Path) -> None:
        changed = folder.stat().st_mtime_ns
        if self._changed.get(folder) == changed:
            return
        self._changed[folder] = changed
        for entry in os.scandir(folder):
            if entry.path in self._seen or not entry.is_file():
                continue
            self._seen.add(entry.path)
            camera = self._camera(folder, entry.name)
            if camera is not None:
                self._growing[Path(entry.path)] = camera

    def _camera(self, folder: Path, name: str) -> str | None:
        for camera, pattern, parent in self._patterns:
            if fnmatch(name, pattern) and (folder == self._folders[0] or folder.name == parent):
                return camera
        return None
