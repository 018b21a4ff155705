"""Pictures that verbs take: files of one picture, and the frames of recordings, side by side."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from windmark.io.errors import FileError
from windmark.io.recordings.address import frame_address
from windmark.io.recordings.base import Frames, Image
from windmark.io.recordings.folder import FolderRecording, is_pattern
from windmark.io.recordings.open import frames, recording_kind
from windmark.io.text import Pathlike


@dataclass(frozen=True)
class Picture:
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

    def __str__(self) -> str:
        return f"{self.path}[{self.frames.number(self.number)}]"


def pictures(paths: Sequence[Pathlike]) -> list[Path | Picture]:
    """Every picture that these files hold, in order: one-picture files as they are, recordings frame by frame.

    A folder, a pattern, an address (``run.cine[120]``) may stand for a file. Files that may be one picture only and
    cannot be read stay in the list: what reads them says why.

    Raises
    ------
    FileError
        For a recording that cannot be opened.
    """
    out: list[Path | Picture] = []
    for path in paths:
        address = frame_address(path)
        plain = address.number is None and address.dataset is None
        if plain and (os.path.isdir(address.file) or is_pattern(address.file)):
            out.extend(FolderRecording(address.file).files)
        elif plain and _is_one_picture(address.file):
            out.append(address.file)
        else:
            recording = frames(path)
            out.extend(Picture(recording, k) for k in range(len(recording)))
    return out


def times_of(items: Sequence[Path | Picture]) -> list[float] | None:
    """Time stamps of pictures of one recording, seconds; None unless each has one and they increase.

    Pictures of several recordings have clocks of their own, which nothing relates.
    """
    first = items[0] if items else None
    if not isinstance(first, Picture):
        return None
    if not all(isinstance(p, Picture) and p.frames.path == first.frames.path for p in items):
        return None
    times = [p.time_s for p in items if isinstance(p, Picture)]
    return times if np.isfinite(times).all() and (np.diff(times) > 0).all() else None


def _is_one_picture(file: Path) -> bool:
    """A file of one picture, or one that cannot be told from it."""
    from windmark.io.images import page_count

    try:
        kind = recording_kind(file)
        return kind == "picture" or (kind == "TIFF" and page_count(file) == 1)
    except FileError:
        return True
