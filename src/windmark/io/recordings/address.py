"""Addresses of frames: ``run.cine[120]``, ``stack.tif[3]``, ``file.h5:/cam1/images[5]``."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

from windmark.errors import UsageError
from windmark.io.recordings.base import frame_name
from windmark.io.text import Pathlike

_INDEX = re.compile(r"^(.+)\[(-?\d{1,18})\]$", re.DOTALL)
_DATASET = re.compile(r"[^/\\]:[/\\]")
HDF = (".h5", ".hdf5", ".hdf", ".he5", ".nc", ".nc4", ".cdf")


@dataclass(frozen=True)
class FrameAddress:
    """Where a picture is.

    Parameters
    ----------
    file : the file, folder or pattern
    dataset : place of the pictures within an HDF5 or NetCDF file; None where not said
    number : which frame, from 0; None where not said
    """

    file: Path
    dataset: str | None = None
    number: int | None = None

    @property
    def recording(self) -> str:
        """The address without the number of the frame."""
        return str(self.file) if self.dataset is None else f"{self.file}:{self.dataset}"

    @property
    def text(self) -> str:
        """The whole address."""
        return self.recording if self.number is None else f"{self.recording}[{self.number}]"

    @property
    def stem(self) -> str:
        """What names of its frames begin with."""
        inside = "" if self.dataset is None else self.dataset.strip("/").replace("/", "-")
        return f"{self.file.stem}-{inside}" if inside else self.file.stem


def frame_address(path: Pathlike) -> FrameAddress:
    """The parts of an address; a file whose real name looks like one wins.

    Numbers count from 0. ``C:/run`` is a drive, not a file with a dataset.

    Raises
    ------
    ValueError
        For a negative number.
    """
    text = os.fspath(path)
    if os.path.exists(text):
        return FrameAddress(Path(text))
    number = None
    if (match := _INDEX.match(text)) is not None:
        text, number = match[1], int(match[2])
        if number < 0:
            raise UsageError(f"{os.fspath(path)}: frames are counted from 0, got {number}")
        if os.path.exists(text):
            return FrameAddress(Path(text), None, number)
    for place in _DATASET.finditer(text):
        file, inside = text[: place.start() + 1], text[place.start() + 2 :].replace("\\", "/")
        if len(file) > 1 and (Path(file).suffix.lower() in HDF or os.path.isfile(file)):
            return FrameAddress(Path(file), inside, number)
    return FrameAddress(Path(text), None, number)


def picture_name(path: Pathlike) -> str:
    """What results of a picture are called: the stem of its file, ``run-000120`` for a frame of a recording."""
    address = frame_address(path)
    return address.stem if address.number is None else frame_name(address.stem, address.number)
