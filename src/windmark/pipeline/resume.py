"""A series that can go on where it was stopped, however suddenly: a journal of its frames, and its state beside it.

The journal (`JOURNAL`) has one record before the first frame: what the run was made with. Then it has one for every
frame (see `KeptFrame`). What one frame hands on to the next (`STATE`) is replaced whole after every frame. Stopped
between the two, a run goes on one frame earlier.

Values are pickled (`journal_values`). What all frames share (cameras, markers, laws, which may be a user's functions)
is not written but read from its files again, and referred to by name.
"""

from __future__ import annotations

import shutil
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from windmark import io
from windmark.errors import DataError
from windmark.io.atomic import replace_file, writing
from windmark.io.interrupts import interrupts_wait
from windmark.io.journal import AppendedFile, Journal, read_journal
from windmark.pipeline.journal_values import dumped, loaded

HIDDEN = ".windmark-series"
"""Folder within that of the results; it is no part of these."""
JOURNAL, STATE = f"{HIDDEN}/journal", f"{HIDDEN}/state"
TITLE = "windmark: frames of a series that is not finished; --resume of the verb that began it goes on"
CHUNK = 64
"""Frames after which all is made to outlast a power failure."""
_STATE_HEAD = struct.Struct("<QI")


class KeptFrame(Protocol):
    """What the journal has of one frame: its name, and what it was measured from; the rest is the verb's own."""

    @property
    def key(self) -> str:
        """Its name in messages."""

    @property
    def pictures(self) -> Mapping[str, str]:
        """Camera -> its pictures' names, sizes and checksums, see `same_run.picture_print`."""


Kept = TypeVar("Kept", bound=KeptFrame)


@dataclass
class Stopped(Generic[Kept]):
    """What a run that was stopped has left.

    Parameters
    ----------
    made_with : see `same_run.made_with`
    sizes : table -> its length before the first frame
    frames : what is known of every frame
    end : of the journal, behind the last of them
    first : end of the journal before the first frame
    state : what the last frame hands on, pickled; None where that is not known: nothing more can be measured
    """

    made_with: dict[str, Any]
    sizes: Mapping[str, int]
    frames: list[Kept] = field(default_factory=list)
    end: int = 0
    first: int = 0
    state: bytes | None = None

    def handed_on(self, named: Mapping[str, Any]) -> dict[str, Any]:
        """What the last frame hands on; ``named`` as in `read_stopped`.

        Raises
        ------
        DataError
            When another version of windmark, whose nouns are elsewhere, has written it.
        """
        try:
            return {} if self.state is None else dict(loaded(self.state, named))
        except Exception as error:  # as in `_understood`
            raise DataError(
                "the run that was stopped cannot go on: what its last frame hands on was written by another version of "
                f"windmark, or is damaged ({error}); --finish keeps what it has measured"
            ) from error


class SeriesJournal:
    """The journal of a running series.

    Parameters
    ----------
    folder : where it is written
    named : name -> what is referred to, not written
    stopped : what it goes on with; None for a new one
    """

    def __init__(self, folder: Path, named: Mapping[str, Any], stopped: Stopped[Any] | None) -> None:
        self._folder, self._names = folder, {id(value): name for name, value in named.items()}
        self._count = 0 if stopped is None else len(stopped.frames)
        (folder / HIDDEN).mkdir(exist_ok=True)
        self._journal = Journal(folder / JOURNAL, TITLE, None if stopped is None else stopped.end)

    def begin(self, made: Mapping[str, Any], sizes: Mapping[str, int]) -> None:
        """The record before the first frame, to which nothing is handed on."""
        with interrupts_wait():
            self._journal.add(dumped((dict(made), dict(sizes)), self._names))
            self._hand_on({}, 0)

    def add(self, kept: KeptFrame, state: Mapping[str, Any]) -> None:
        """A frame that is in the tables, and what it hands on: both or, where the disk takes no more, neither.

        An interrupt between the two would leave a state that belongs to no frame of the journal.
        """
        content = dumped(kept, self._names)
        with interrupts_wait():
            before = self._journal.size
            try:
                self._journal.add(content)
                self._hand_on(state, self._count + 1)
            except BaseException:
                self._journal.take_back(before)
                raise
            self._count += 1

    def _hand_on(self, state: Mapping[str, Any], count: int) -> None:
        content = dumped(dict(state), self._names)
        replaced_file(self._folder, STATE, _STATE_HEAD.pack(count, zlib.crc32(content)) + content)

    def sync(self) -> None:
        """Make it outlast a power failure."""
        self._journal.sync()

    def close(self) -> None:
        """End writing."""
        self._journal.close()


def replaced_file(folder: Path, name: str, content: bytes) -> None:
    """Write a file anew and put it in its place whole; what a kill leaves of it is written over the next time."""
    path, new = folder / name, folder / HIDDEN / "new"
    file = AppendedFile(new)
    try:
        file.append(content)
    finally:
        file.close()
    with writing(path, path, new):
        replace_file(new, path)


def read_stopped(folder: Path, named: Mapping[str, Any], *, to_go_on: bool = True) -> Stopped[Any] | None:
    """What a run that was stopped has left in a folder; None where there is none.

    Parameters
    ----------
    folder : where it was written
    named : what was referred to, read again, by the same names
    to_go_on : with the state that the last frame hands on; without a frame that has its record, but not its state yet

    Raises
    ------
    FileError
        For a journal that cannot be understood.
    """
    if not (folder / JOURNAL).is_file():
        return None
    out: Stopped[Any] | None = None
    for content, end in read_journal(folder / JOURNAL, TITLE):
        value = _understood(folder, content, named)
        if out is None:
            out = Stopped(value[0], value[1], first=end, end=end)
        else:
            out.frames.append(value)
            out.end = end
    if out is not None and to_go_on:
        _with_state(out, folder)
    return out


def _understood(folder: Path, content: bytes, named: Mapping[str, Any]) -> Any:
    try:
        return loaded(content, named)
    except Exception as error:  # pickle fails in many ways, above all on what another version wrote
        raise io.FileError(folder / JOURNAL, f"written by another version of windmark, or damaged: {error}") from error


def _with_state(out: Stopped[Any], folder: Path) -> None:
    """Take the state if it is that of the last frame or the one before, which is then the last one."""
    try:
        content = (folder / STATE).read_bytes()
        count, crc = _STATE_HEAD.unpack_from(content)
    except (OSError, struct.error):
        return
    content = content[_STATE_HEAD.size :]
    if zlib.crc32(content) == crc and len(out.frames) - 1 <= count <= len(out.frames):
        out.state = content
        cut(out, folder, count)


def cut(stopped: Stopped[Any], folder: Path, count: int) -> None:
    """Leave so many frames of what a run that was stopped has in its journal."""
    ends = [end for _, end in read_journal(folder / JOURNAL, TITLE)]
    stopped.end = ends[count]
    del stopped.frames[count:]


def begun_with(folder: Path) -> dict[str, Any] | None:
    """What a run that was stopped was made with, see `same_run.made_with`; None where there is none."""
    if not (folder / JOURNAL).is_file():
        return None
    for content, _ in read_journal(folder / JOURNAL, TITLE):
        made: dict[str, Any] = _understood(folder, content, {})[0]
        return made
    return None


def measured(folder: Path) -> int:
    """How many frames a run that was stopped has left in a folder; 0 where there is none."""
    if not (folder / JOURNAL).is_file():
        return 0
    return max(sum(1 for _ in read_journal(folder / JOURNAL, TITLE)) - 1, 0)


def clear(folder: Path) -> None:
    """Take away what only a run that goes on needs."""
    shutil.rmtree(folder / HIDDEN, ignore_errors=True)


def check_state(folder: Path, stopped: Stopped[Any]) -> None:
    """See that something more can be measured.

    Raises
    ------
    FileError
        Where the last frame's state is lost.
    """
    if stopped.state is None and stopped.frames:
        raise io.FileError(
            folder, "the run that was stopped there cannot go on: what its last frame hands on to the next is not "
            "there; --finish keeps what it has measured",
        )  # fmt: skip
