"""What every recording is: a counted, lazily read sequence of pictures of one shape and type."""

from __future__ import annotations

import os
import struct
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from windmark.io.errors import FileError, decoding, reading
from windmark.io.text import Pathlike

Image = NDArray[Any]
Times = NDArray[np.float64]


class Recording:
    """The reader of one format. Subclasses fill these in while they open the file, and define `read`.

    Parameters
    ----------
    path : as the user named it
    kind : the format in words
    count, shape, dtype : frames, (H, W) or (H, W, C), type of a pixel in native byte order
    bits : significant bits of a pixel
    time_s : (count,) seconds on the recording's own clock; None where the file does not say
    start : absolute time of the clock's zero as the file has it (ISO 8601 text); None where it does not say
    bayer : pattern of a colour sensor's raw mosaic; None where it is none
    note : what a user should know of this file; empty for nothing
    stem : what the frames' names begin with
    address : the recording in words, with the place within its file
    """

    kind = "recording"
    count: int = 0
    shape: tuple[int, ...] = ()
    dtype: np.dtype[Any] = np.dtype(np.uint8)
    bits: int = 8
    time_s: Times | None = None
    start: str | None = None
    bayer: str | None = None
    note: str = ""

    def __init__(self, path: Pathlike) -> None:
        self.path = Path(path)
        self.stem = self.path.stem
        self.address = str(path)

    def read(self, number: int) -> Image:
        """One frame, 0 <= number < count. Called by several threads at once."""
        raise NotImplementedError

    def name(self, number: int) -> str:
        """A name of a frame that can be a file's name on every system."""
        return frame_name(self.stem, number)

    def lost_before(self, number: int) -> int:
        """How many pictures the recording lacks before a frame, by its own time stamps; 0 where they say nothing."""
        return 0

    def close(self) -> None:
        """Give the file back."""

    def __del__(self) -> None:
        with suppress(Exception):  # at the interpreter's end, or where opening failed, parts may be missing
            self.close()

    def noted(self, text: str) -> None:
        """Add a sentence to the note."""
        self.note = "; ".join(part for part in (self.note, text) if part)


class Frames(Sequence[Image]):
    """A recording, or a part of it, as a sequence of pictures that are read when they are asked for.

    ``frames[k]`` is (H, W) or (H, W, C) in the file's own type; ``frames[a:b:c]`` is a sequence again. The memory holds
    the frame at hand; the way to any frame is equally long (in compressed films: from the key frame before it). Several
    threads may read at once. Frames are counted from 0, whatever number the camera gave the first.

    Use it in a ``with`` block, or `close` it; what is forgotten is closed with the object.
    """

    def __init__(self, recording: Recording, which: range | None = None) -> None:
        self._recording = recording
        self._which = range(recording.count) if which is None else which

    @property
    def path(self) -> Path:
        """The file or folder."""
        return self._recording.path

    @property
    def address(self) -> str:
        """The recording in words, with the place within its file; ``[k]`` behind it is the address of a frame."""
        return self._recording.address

    @property
    def kind(self) -> str:
        """The format in words."""
        return self._recording.kind

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W) or (H, W, C) of every frame."""
        return self._recording.shape

    @property
    def size_px(self) -> tuple[int, int]:
        """(width, height)."""
        return self.shape[1], self.shape[0]

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of a pixel."""
        return self._recording.dtype

    @property
    def bits(self) -> int:
        """Significant bits of a pixel: 12 for a 12-bit sensor, whatever type holds them."""
        return self._recording.bits

    @property
    def time_s(self) -> Times | None:
        """(N,) seconds on the recording's own clock, of the frames in this sequence; None where unknown."""
        times = self._recording.time_s
        return None if times is None else times[np.arange(self._which.start, self._which.stop, self._which.step)]

    @property
    def start(self) -> str | None:
        """Absolute time (ISO 8601) of the clock's zero; None where unknown."""
        return self._recording.start

    @property
    def bayer(self) -> str | None:
        """Pattern of a colour sensor's raw mosaic, see `from_mosaic`; None where the pixels are no mosaic."""
        return self._recording.bayer

    @property
    def note(self) -> str:
        """What should be known of this recording; empty for nothing."""
        return self._recording.note

    def name(self, number: int) -> str:
        """Name of a frame, fit for a file's name: ``run-000120``; a picture of a folder keeps its own."""
        return self._recording.name(self._which[number])

    def number(self, number: int) -> int:
        """Place of a frame in the whole recording."""
        return self._which[number]

    def lost_before(self, number: int) -> int:
        """How many pictures the recording lacks before a frame, as its note says; 0 where its stamps say nothing."""
        return self._recording.lost_before(self._which[number])

    def __len__(self) -> int:
        return len(self._which)

    @overload
    def __getitem__(self, key: int) -> Image: ...
    @overload
    def __getitem__(self, key: slice) -> Frames: ...
    def __getitem__(self, key: int | slice) -> Image | Frames:
        if isinstance(key, slice):
            return Frames(self._recording, self._which[key])
        try:
            number = self._which[key]
        except IndexError:
            raise IndexError(f"{self.path}: no frame {key}; it has {len(self)}") from None
        with decoding(self.path):
            picture = self._recording.read(number)
        if picture.shape != self.shape or picture.dtype != self.dtype:
            was = f"{picture.dtype} {picture.shape}"
            raise FileError(self.path, f"is {was}; expected {self.dtype} {self.shape}, as the first", self.name(key))
        return np.require(picture, dtype=self.dtype, requirements=["C", "W", "O"])

    def __iter__(self) -> Iterator[Image]:
        return (self[k] for k in range(len(self)))

    def __enter__(self) -> Frames:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Frames {self.path}: {self.kind}, {len(self)} x {self.dtype} {self.shape}>"

    def close(self) -> None:
        """Give the file back; frames cannot be read afterwards."""
        self._recording.close()


def frame_name(stem: str, number: int) -> str:
    """``run-000120``."""
    return f"{stem}-{number:06d}"


class ByteFile:
    """Bytes at places of a file, for several threads; nothing is read that is not there."""

    def __init__(self, path: Pathlike) -> None:
        self.path = path
        with reading(path):
            self._stream = open(path, "rb")  # noqa: SIM115 (open as long as the recording)
        self.size = os.fstat(self._stream.fileno()).st_size
        self._guard = threading.Lock()

    def read(self, offset: int, size: int, what: str = "a part") -> bytes:
        """``size`` bytes from ``offset``; asked of the system only where they are there.

        Raises
        ------
        FileError
            When the file ends before.
        """
        if offset < 0 or size < 0 or offset + size > self.size:
            raise FileError(self.path, f"damaged or cut off: {what} lies at {offset + size} of {self.size} bytes")
        with self._guard:
            self._stream.seek(offset)
            data = self._stream.read(size)
        if len(data) != size:
            raise FileError(self.path, f"cut off: {what} is not complete")
        return data

    def unpack(self, layout: str, offset: int, what: str = "the header") -> tuple[Any, ...]:
        """Numbers at a place, by a layout of `struct`."""
        return struct.unpack(layout, self.read(offset, struct.calcsize(layout), what))

    def numbers(self, kind: str, count: int, offset: int, what: str) -> NDArray[Any]:
        """``count`` numbers of a NumPy type at a place."""
        return np.frombuffer(self.read(offset, count * np.dtype(kind).itemsize, what), dtype=kind)

    def close(self) -> None:
        """Give the file back."""
        self._stream.close()


def check_size(path: Pathlike, width: int, height: int, count: int) -> None:
    """Refuse sizes that are none."""
    if not (0 < width <= 1_000_000 and 0 < height <= 1_000_000):
        raise FileError(path, f"damaged: pictures of {width} x {height} pixels")
    if count < 1:
        raise FileError(path, "holds no frame; expected at least one")


def check_compressed(path: Pathlike, needed: int, stored: int) -> None:
    """Refuse pictures larger than their bytes in the file can have been unpacked to (deflate reaches 1032 : 1)."""
    if needed > 10_000 * stored + 1_000_000:
        raise FileError(path, f"damaged: {needed} bytes of pixels cannot come from the {stored} in the file")


def unpack12(data: bytes, count: int) -> NDArray[np.uint16]:
    """12-bit integers, most significant bits first: three bytes hold two."""
    packed = np.frombuffer(data, np.uint8)[: (count + 1) // 2 * 3]
    if len(packed) % 3:
        packed = np.pad(packed, (0, 3 - len(packed) % 3))
    packed = packed.reshape(-1, 3).astype(np.uint16)
    values = np.empty((len(packed), 2), np.uint16)
    values[:, 0] = packed[:, 0] << 4 | packed[:, 1] >> 4
    values[:, 1] = (packed[:, 1] & 0x0F) << 8 | packed[:, 2]
    return values.reshape(-1)[:count]


def unpack10(data: bytes, count: int) -> NDArray[np.uint16]:
    """10-bit integers, most significant bits first: five bytes hold four."""
    packed = np.frombuffer(data, np.uint8)[: (count + 3) // 4 * 5]
    if len(packed) % 5:
        packed = np.pad(packed, (0, 5 - len(packed) % 5))
    packed = packed.reshape(-1, 5).astype(np.uint16)
    values = np.empty((len(packed), 4), np.uint16)
    for k in range(4):
        values[:, k] = (packed[:, k] << 8 | packed[:, k + 1]) >> (6 - 2 * k) & 0x3FF
    return values.reshape(-1)[:count]
