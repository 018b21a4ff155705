"""Pictures that appear in a folder: which are whole, which cannot be read, and which are gone again.

A file is whole when it has stayed as it is (size, date, content: two readings) for a settling time, decodes to the
size that it declares, and its last rows are there. One that is not is tried again until it has stayed as it is for as
long as patience lasts. Dates of files are only compared with each other, and time is the monotonic clock's: neither a
camera's clock nor a jump of the computer's matters.
"""

from __future__ import annotations

import os
import zlib
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.pipeline.deform.names import key_of
from windmark.pipeline.deform.project import DeformProject

LIST_AGAIN_S = 0.5
"""A folder is listed when its date changes and, as that may miss what comes within its resolution, so often besides."""
USUAL_OF = 9
"""Pictures of a camera that say how many rows at the end of its pictures are empty: as many as in half of them."""
BACK_OFF = 1.5
"""Every trial of a file that cannot be read yet waits so many times longer than the one before."""


@dataclass(frozen=True)
class Arrival:
    """One file that was seen, and what became of it.

    Parameters
    ----------
    file, camera, key : its name, whose it is, its frame
    fate : "measured", "late", "duplicate", "unreadable", "gone" or "left" (the run ended first)
    reason : why it was not measured, or what is odd about it
    """

    file: str
    camera: str
    key: str
    fate: str
    reason: str = ""


@dataclass
class Arriving:
    """A file that is not known to be whole yet.

    Parameters
    ----------
    path, camera, key : which
    seen_s : when it was seen first, by the monotonic clock
    state : size and date; None before the first look
    since_s : when it was seen in this state first
    crc : of its content then
    trouble, tries, next_s : why it cannot be read, how often that was tried, when it is tried next
    """

    path: Path
    camera: str
    key: str
    seen_s: float
    state: tuple[int, int] | None = None
    since_s: float = 0.0
    crc: int | None = None
    trouble: str = ""
    tries: int = 0
    next_s: float = 0.0
    note: str = ""


class Inbox:
    """The files of a watched folder that belong to the project's cameras.

    Parameters
    ----------
    project : names the cameras and their patterns; only the file names of these count
    folder : where pictures appear, sub-folders included when the patterns name them
    """

    def __init__(self, project: DeformProject, folder: Path) -> None:
        names = {Path(p).parent.name for c in project.camera for p in c.patterns}
        self._folders = [folder, *(folder / n for n in sorted(names) if n)]
        self._patterns = [(c.name, Path(p).name, Path(p).parent.name) for c in project.camera for p in c.patterns]
        self._settle_s, self._patience_s = project.watch.settle_s, project.watch.patience_s
        self._listed: dict[Path, tuple[int, float]] = {}
        self._seen: set[tuple[str, int]] = set()
        self._empty: dict[str, deque[int]] = {}
        self._taken: dict[Path, tuple[int, int]] = {}
        self.waiting: dict[Path, Arriving] = {}
        self.known: frozenset[tuple[str, str]] = frozenset()
        """Camera and name of files that a run that was stopped has dealt with."""
        self._foreign: list[Path] = []

    @property
    def foreign(self) -> list[str]:
        """Names of files that match no camera's pattern and are still there: many cameras rename what is whole."""
        return [path.name for path in self._foreign if os.path.lexists(path)]

    def look(self, now: float) -> list[Arriving]:
        """List the folders; the files that are new, which wait from now on."""
        new = []
        for folder in self._folders:
            for path in self._list(folder, now):
                camera = self._camera(folder, path.name)
                if camera is None:
                    self._foreign.append(path)
                elif (camera, path.name) not in self.known:
                    self.waiting[path] = Arriving(path, camera, key_of(path.stem), now)
                    new.append(self.waiting[path])
        return new

    def settled(self, now: float) -> Iterator[tuple[Arriving, str, str]]:
        """Files of which it is known what they are: whole ("measured"), "unreadable" or "gone", with the reason."""
        for file in list(self.waiting.values()):
            try:
                state = _state(file.path)
            except OSError:
                del self.waiting[file.path]
                yield file, "gone", "it was renamed or removed before it could be read"
                continue
            if state != file.state:
                file.state, file.since_s, file.crc, file.next_s, file.tries = state, now, _crc(file.path), 0.0, 0
            elif now >= max(file.since_s + self._settle_s, file.next_s):
                if self._is_whole(file, now):
                    del self.waiting[file.path]
                    self._taken[file.path] = state
                    yield file, "measured", file.note
                elif now - file.since_s >= self._patience_s:
                    del self.waiting[file.path]
                    yield file, "unreadable", f"{file.trouble} (tried for {now - file.since_s:.1f} s)"
                else:
                    file.tries += 1
                    file.next_s = now + self._settle_s * BACK_OFF**file.tries

    def changed_since(self) -> list[str]:
        """Names of files that were whole once and are not as they were then."""
        out = []
        for path, state in self._taken.items():
            try:
                if _state(path) != state:
                    out.append(path.name)
            except OSError:  # taken away when it was done with
                continue
        return out

    # --- parts -----------------------------------------------------------------------------
    def _is_whole(self, file: Arriving, now: float) -> bool:
        """Read it; `Arriving.trouble` says why it is not whole."""
        before, file.crc = file.crc, _crc(file.path)
        if file.state is not None and not file.state[0]:
            file.trouble = "it is empty"
        elif file.crc is None or file.crc != before:
            file.trouble = "its content changes while its size and date stay"
        else:
            try:
                image = io.read_grey(file.path)
                empty = _empty_rows(image)
                if _state(file.path) != file.state:  # it goes on growing: looked at again
                    file.trouble = "it changes while it is read"
                    return False
            except io.FileError as error:
                file.trouble = error.what
            except OSError as error:
                file.trouble = str(error)
            else:
                return self._has_its_end(file, empty, empty == len(image), now)
        return False

    def _has_its_end(self, file: Arriving, empty: int, dark: bool, now: float) -> bool:
        """A file that was made in its full size is filled to its end.

        More empty rows than half of the camera's pictures had before, or all of them, have to stay so for as long as
        patience lasts. Such a picture is then taken, and that is said: what is in view may be that dark. One that stays
        half empty must not be the measure of those that are just being filled.
        """
        had = self._empty.setdefault(file.camera, deque(maxlen=USUAL_OF))
        usual = sorted(had)[(len(had) - 1) // 2] if had else 0
        if empty > usual or dark:
            if now - file.since_s < self._patience_s:
                file.trouble = f"its last {empty} rows are empty"
                return False
            file.note = f"its last {empty} rows are empty, which stayed so for {self._patience_s:g} s"
        if not dark:
            had.append(empty)
        return True

    def _list(self, folder: Path, now: float) -> list[Path]:
        """New files of a folder. One that has not changed is not listed each time, however many files it holds."""
        try:
            changed = folder.stat().st_mtime_ns
            before, when = self._listed.get(folder, (-1, 0.0))
            if changed == before and now - when < LIST_AGAIN_S:
                return []
            entries = [(e.name, e.inode()) for e in os.scandir(folder) if e.is_file()]
        except OSError:  # a sub-folder that is not there yet, or a share that is away for a moment
            return []
        self._listed[folder] = changed, now
        new = [(name, inode) for name, inode in entries if (os.path.join(folder, name), inode) not in self._seen]
        self._seen.update((os.path.join(folder, name), inode) for name, inode in new)
        return [folder / name for name, _ in sorted(new) if folder / name not in self.waiting]

    def _camera(self, folder: Path, name: str) -> str | None:
        for camera, pattern, parent in self._patterns:
            if fnmatch(name, pattern) and (folder == self._folders[0] or folder.name == parent):
                return camera
        return None


def _state(path: Path) -> tuple[int, int]:
    stat = path.stat()
    return stat.st_size, stat.st_mtime_ns


def _crc(path: Path) -> int | None:
    """Checksum of a file's content; None where it cannot be read just now."""
    try:
        return zlib.crc32(path.read_bytes())
    except OSError:
        return None


def _empty_rows(image: NDArray[np.generic]) -> int:
    """How many rows at the end of a picture are nothing but zeros."""
    lit = np.flatnonzero(image.reshape(len(image), -1).any(axis=1))
    return len(image) - 1 - int(lit[-1]) if len(lit) else len(image)
