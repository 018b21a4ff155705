"""Pictures that verbs take: files of one picture, and the frames of recordings, side by side."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from windmark.errors import UsageError
from windmark.io.errors import FileError, decoding
from windmark.io.recordings.address import frame_address
from windmark.io.recordings.base import Frames, Image, Recording
from windmark.io.recordings.folder import PICTURES, FolderRecording, is_pattern, picture_files
from windmark.io.recordings.open import frames, recording_kind
from windmark.io.text import Pathlike


@dataclass(frozen=True)
class Frame:
    """One frame of a recording, read when it is asked for; it takes a path's place in `read_grey`.

    Parameters
    ----------
    frames : the recording, open as long as one of its pictures is kept
    number : which of its frames
    """

    frames: Frames
    number: int

    @property
    def path(self) -> Path:
        """The recording."""
        return self.frames.path

    @property
    def name(self) -> str:
        """``run-000120``: fit for a file's name."""
        return self.frames.name(self.number)

    @property
    def stem(self) -> str:
        """The same as `name`, which has no extension."""
        return self.name

    @property
    def suffix(self) -> str:
        """None: a frame is no file."""
        return ""

    @property
    def parent(self) -> Path:
        """Folder of the recording."""
        return self.path.parent

    @property
    def time_s(self) -> float:
        """Seconds on the recording's own clock, NaN where unknown."""
        times = self.frames.time_s
        return float("nan") if times is None else float(times[self.number])

    def read(self) -> Image:
        """The pixels."""
        return self.frames[self.number]

    def __fspath__(self) -> str:
        return str(self)

    def __str__(self) -> str:
        return f"{self.frames.address}[{self.frames.number(self.number)}]"


PictureFile = Path | Frame
"""A picture as verbs take it: in a file of its own, or as the frame of a recording."""


def pictures(paths: Sequence[Pathlike]) -> list[PictureFile]:
    """Every picture that these files hold, in order: files of one picture as they are, recordings frame by frame.

    A folder, a pattern, an address (``run.cine[120]``) may stand for a file. Files that may be one picture only and
    cannot be read stay in the list: what reads them says why.

    Raises
    ------
    FileError
        For a recording that cannot be opened.
    """
    out: list[PictureFile] = []
    for path in paths:
        address = frame_address(path)
        plain = address.number is None and address.dataset is None
        if plain and (os.path.isdir(address.file) or is_pattern(address.file)):
            out.extend(FolderRecording(address.file).files)
        elif plain and _is_one_picture(address.file):
            out.append(address.file)
        else:
            recording = frames(path)
            out.extend(Frame(recording, k) for k in range(len(recording)))
    return out


def one_picture(path: Path) -> Path:
    """The picture that a path, an address or a pattern stands for, where one is wanted.

    Raises
    ------
    UsageError
        For a pattern that several files match.
    FileError
        For one that none does.
    """
    address = frame_address(path)
    if address.number is not None or address.dataset is not None or not is_pattern(address.file):
        return path
    found = picture_files(address.file)
    if len(found) > 1:
        names = f"{found[0].name} to {found[-1].name}"
        raise UsageError(f"{path}: {len(found)} files match this pattern, {names}; expected one picture: name it")
    return found[0]


def addresses(paths: Sequence[Pathlike]) -> list[Path]:
    """`pictures` as paths and addresses, ``run.cine[120]``: for settings, which hold text."""
    return [item if isinstance(item, Path) else Path(str(item)) for item in pictures(paths)]


class _Gathered(Recording):
    """Pictures of several files as one recording."""

    kind = "pictures"

    def __init__(self, items: Sequence[PictureFile]) -> None:
        first = items[0]
        super().__init__(first if isinstance(first, Path) else first.path)
        self._items = items
        self.count = len(items)
        picture = self.read(0)
        self.shape, self.dtype = picture.shape, picture.dtype
        self.bits = first.frames.bits if isinstance(first, Frame) else 8 * self.dtype.itemsize
        times = times_of(items)
        self.time_s = None if times is None else np.array(times)

    def read(self, number: int) -> Image:
        from windmark.io.images import read_image

        item = self._items[number]
        return item.read() if isinstance(item, Frame) else read_image(item)

    def name(self, number: int) -> str:
        """That of the picture's file, or of the frame."""
        return self._items[number].stem


def gathered(paths: Sequence[Pathlike]) -> Frames:
    """Pictures and recordings, one after the other, as one sequence; all of one size and type.

    Raises
    ------
    FileError
        When one cannot be read; reading a frame of another size or type says which.
    """
    if len(paths) == 1:
        return frames(paths[0])
    with decoding(paths[0]):
        return Frames(_Gathered(pictures(paths)))


def times_of(items: Sequence[PictureFile]) -> list[float] | None:
    """Time stamps of pictures of one recording, seconds; None unless each has one and they increase.

    Pictures of several recordings have clocks of their own, which nothing relates.
    """
    first = items[0] if items else None
    if not isinstance(first, Frame):
        return None
    if not all(isinstance(p, Frame) and p.frames.path == first.frames.path for p in items):
        return None
    times = [p.time_s for p in items if isinstance(p, Frame)]
    return times if np.isfinite(times).all() and (np.diff(times) > 0).all() else None


def notes_of(items: Sequence[PictureFile]) -> list[tuple[str, str]]:
    """What should be known of the recordings that pictures are frames of (`Frames.note`): address and words of each."""
    notes = {item.frames.address: item.frames.note for item in items if isinstance(item, Frame)}
    return [(address, note) for address, note in notes.items() if note]


def _is_one_picture(file: Path) -> bool:
    """A file of one picture, or one that cannot be told from it."""
    from windmark.io.images import page_count

    try:
        kind = recording_kind(file)
        if kind is None:
            return file.suffix.lower() in PICTURES
        return kind == "picture" or (kind == "TIFF" and page_count(file) == 1)
    except FileError:
        return True
