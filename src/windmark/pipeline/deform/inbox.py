"""Pictures that appear in a folder: which are whole, which cannot be read, and which are gone again.

A file is whole when it has stayed as it is (size, date, content: two readings) for a settling time, decodes to the
size that it declares, and no part of it is still to be filled. One that is not is tried again until it has stayed as
it is for as long as patience lasts, or has been changing for many times as long. Dates of files are only compared with
each other, and time is the monotonic clock's: neither a camera's clock nor a jump of the computer's matters.
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
from windmark.io.errors import was_read_before
from windmark.pipeline.deform.names import key_of, order
from windmark.pipeline.deform.project import DeformProject

LIST_AGAIN_S = 0.5
"""A folder is listed when its date changes and, as that may miss what comes within its resolution, so often besides."""
USUAL_OF = 9
"""Pictures of a camera that say how many rows of its pictures are empty: as many as in half of them."""
SECTOR = 512
"""Bytes; what a system has not filled of a file yet is not smaller."""
READ_AT_ONCE = 16
"""Files that are read before whole ones are handed on and an interrupt is heard, however many are there."""
ENDLESS = 10
"""A file that goes on changing is given up after so many times the patience: the frames behind it wait for it."""
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
    tried_s : when it was looked at first
    crc : of its content then
    trouble, tries, next_s : why it cannot be read, how often that was tried, when it is tried next
    """

    path: Path
    camera: str
    key: str
    seen_s: float
    state: tuple[int, int] | None = None
    since_s: float = 0.0
    tried_s: float = 0.0
    crc: int = 0
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
        self._folder, self._below = folder, list[Path]()
        self._patterns = [(c.name, Path(p).name, Path(p).parent.name) for c in project.camera for p in c.patterns]
        self._settle_s, self._patience_s = project.watch.settle_s, project.watch.patience_s
        self._listed: dict[Path, tuple[int, float]] = {}
        self._there: dict[Path, dict[str, int]] = {}
        self._empty: dict[str, deque[int]] = {}
        self._taken: dict[Path, tuple[int, int]] = {}
        self.waiting: dict[Path, Arriving] = {}
        self.known: dict[tuple[str, str], tuple[int, int] | None] = {}
        """Camera and name of files that a run that was stopped has dealt with and that have not been seen since; the
        size and date of those that it has measured."""
        self._foreign: list[Path] = []

    @property
    def foreign(self) -> list[str]:
        """Names of files that match no camera's pattern and are still there: many cameras rename what is whole."""
        return [path.name for path in self._foreign if os.path.lexists(path)]

    def look(self, now: float) -> list[Arriving]:
        """List the folders; the files that are new, which wait from now on."""
        new = []
        found = self._list(self._folder, now)
        for folder in self._below:
            found += self._list(folder, now)
        for path in found:
            camera = self._camera(path.parent, path.name)
            if camera is None:
                self._foreign.append(path)
            elif (camera, path.name) in self.known:
                if (state := self.known.pop((camera, path.name))) is not None:
                    self._taken[path] = state
                    was_read_before(path, state)
            elif not self.is_as_taken(path):  # else its folder was away for a moment
                new.append(Arriving(path, camera, key_of(path.stem), now))
        if new:
            waiting = [*self.waiting.values(), *new]
            self.waiting = {f.path: f for f in sorted(waiting, key=lambda f: order(f.key))}
        return new

    def again(self, path: Path, camera: str, now: float) -> None:
        """A file that was whole is looked at again, before all others: its frame is the next."""
        del self._taken[path]
        self.waiting = {path: Arriving(path, camera, key_of(path.stem), now), **self.waiting}

    def print_of(self, path: Path) -> str:
        """Name, size and date of a file that was whole."""
        return ":".join(map(str, (path.name, *self._taken[path])))

    def is_as_taken(self, path: Path) -> bool:
        """Whether a file that was whole is as it was then."""
        try:
            return self._taken.get(path) == _state(path)
        except OSError:
            return False

    def settled(self, now: float) -> Iterator[tuple[Arriving, str, str]]:
        """Files of which it is known what they are: whole ("measured"), "unreadable" or "gone", with the reason.

        The earliest frames come first, and after some files that had to be read the others are left for the next time.
        """
        read = 0
        for file in list(self.waiting.values()):
            if read >= READ_AT_ONCE:
                return
            try:
                state = _state(file.path)
            except OSError:
                del self.waiting[file.path]
                self._there.get(file.path.parent, {}).pop(file.path.name, None)  # it may come back
                yield file, "gone", "it was renamed or removed before it could be read"
                continue
            if state != file.state:
                file.tried_s = now if file.state is None else file.tried_s
                if now - file.tried_s >= ENDLESS * self._patience_s:
                    del self.waiting[file.path]
                    yield file, "unreadable", f"it went on changing (tried for {now - file.tried_s:.1f} s)"
                    continue
                read += 1
                file.state, file.since_s, file.next_s, file.tries = state, now, 0.0, 0
                file.crc = zlib.crc32(_content(file.path))
            elif now >= max(file.since_s + self._settle_s, file.next_s):
                read += 1
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
        content = _content(file.path)
        before, file.crc = file.crc, zlib.crc32(content)
        if file.state is not None and not file.state[0]:
            file.trouble = "it is empty"
        elif not content or file.crc != before:
            file.trouble = "its content changes while its size and date stay"
        else:
            try:
                image = io.read_grey(file.path)
                if _state(file.path) != file.state:  # it goes on growing: looked at again
                    file.trouble = "it changes while it is read"
                    return False
            except io.FileError as error:
                file.trouble = error.what
            except OSError as error:
                file.trouble = str(error)
            else:
                return self._is_filled(file, content, image, now)
        return False

    def _is_filled(self, file: Arriving, content: bytes, image: NDArray[np.generic], now: float) -> bool:
        """A file that was made in its full size has no part that is still to be filled, in whatever order that is done.

        Clearly more empty rows in one piece than half of the camera's pictures had before, or all of them, have to stay
        so for as long as patience lasts. Such a picture is then taken, and that is said: what is in view may be that
        dark. One that stays half empty must not be the measure of those that are just being filled.
        """
        dark = not image.any()
        empty = len(image) if dark else _empty_rows(content, len(image))
        had = self._empty.setdefault(file.camera, deque(maxlen=USUAL_OF))
        usual = sorted(had)[(len(had) - 1) // 2] if had else 0
        if empty > usual + usual // 4 or dark:
            if now - file.since_s < self._patience_s:
                file.trouble = f"{empty} of its rows are empty"
                return False
            file.note = f"{empty} of its rows are empty, which stayed so for {self._patience_s:g} s"
        if not dark:
            had.append(empty)
        return True

    def _list(self, folder: Path, now: float) -> list[Path]:
        """New files of a folder. One that has not changed is not listed each time, however many files it holds."""
        try:
            changed = folder.stat().st_mtime_ns
            listed, when = self._listed.get(folder, (-1, 0.0))
            if changed == listed and now - when < LIST_AGAIN_S:
                return []
            there = list(os.scandir(folder))
            entries = {e.name: e.inode() for e in there if e.is_file()}
            if folder == self._folder:
                names = [e.name for e in there if e.is_dir()]
                self._below = [folder / n for n in sorted(names) if any(_is_called(n, p) for *_, p in self._patterns)]
        except OSError:  # a sub-folder that is not there yet, or a share that is away for a moment
            return []
        self._listed[folder] = changed, now
        before, self._there[folder] = self._there.get(folder, {}), entries
        new = (name for name, inode in entries.items() if before.get(name) != inode)
        return [folder / name for name in sorted(new) if folder / name not in self.waiting]

    def _camera(self, folder: Path, name: str) -> str | None:
        for camera, pattern, parent in self._patterns:
            if fnmatch(name, pattern) and (folder == self._folder or _is_called(folder.name, parent)):
                return camera
        return None


def _is_called(name: str, pattern: str) -> bool:
    return name == pattern or fnmatch(name, pattern)


def _state(path: Path) -> tuple[int, int]:
    stat = path.stat()
    return stat.st_size, stat.st_mtime_ns


def _content(path: Path) -> bytes:
    """A file's content; nothing where it cannot be read just now."""
    try:
        return path.read_bytes()
    except OSError:
        return b""


def _empty_rows(content: bytes, rows: int) -> int:
    """To how many of a picture's rows the longest part of its file amounts that is nothing but zeros.

    By the bytes, whatever order the file has them in: some formats begin with the last row, and of some that are packed
    the decoder makes no zeros of what is not there.
    """
    size = max(len(content) // rows, SECTOR)
    parts = np.frombuffer(content, np.uint8, len(content) // size * size).reshape(-1, size)
    lit = np.flatnonzero(parts.any(axis=1))
    longest = int(np.diff(lit, prepend=-1, append=len(parts)).max()) - 1
    return round(longest * size * rows / len(content))
