"""Princeton Instruments ``.spe``, versions 2 (header of 4100 bytes) and 3 (an XML footer besides).

Offsets are those of the "WinView/WinSpec 2.x header structure" (WINHEAD.TXT) and of the "SPE 3.0 file format
specification" of Princeton Instruments. All numbers are little-endian; rows run from the top.
"""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import numpy as np

from windmark.io.errors import FileError
from windmark.io.recordings.base import ByteFile, Image, Recording, check_size
from windmark.io.text import Pathlike

_HEADER = 4100
_WIDTH, _TYPE, _HEIGHT, _FOOTER, _FRAMES, _VERSION, _DATE, _TIME = 42, 108, 656, 678, 1446, 1992, 20, 172
_TYPES = {0: "<f4", 1: "<i4", 2: "<i2", 3: "<u2", 5: "<f8", 6: "|u1", 8: "<u4"}
_FORMATS = {
    "MonochromeUnsigned16": "<u2", "MonochromeUnsigned32": "<u4", "MonochromeFloating32": "<f4",
    "MonochromeUnsigned8": "|u1",
}  # fmt: skip
_LARGEST_FOOTER = 64 * 2**20
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")


class SpeRecording(Recording):
    """Frames of one region of the sensor; times where version 3 stamped the exposures."""

    kind = "Princeton Instruments SPE"

    def __init__(self, path: Pathlike) -> None:
        super().__init__(path)
        self._file = ByteFile(path)
        try:
            if self._file.size < _HEADER:
                raise FileError(path, f"damaged or cut off: {self._file.size} bytes; expected a header of {_HEADER}")
            (version,) = self._file.unpack("<f", _VERSION)
            if version >= 3:
                self._version3()
            else:
                self._version2()
        except BaseException:
            self._file.close()
            raise
        self.dtype = np.dtype(self._stored).newbyteorder("=")
        self.bits = 8 * self.dtype.itemsize

    def _version2(self) -> None:
        (width,), (height,) = self._file.unpack("<H", _WIDTH), self._file.unpack("<H", _HEIGHT)
        (kind,), (count,) = self._file.unpack("<h", _TYPE), self._file.unpack("<i", _FRAMES)
        if kind not in _TYPES:
            raise FileError(self.path, f"pixels of type {kind}; expected one of {', '.join(map(str, _TYPES))}")
        check_size(self.path, width, height, count)
        self._layout(_TYPES[kind], width, height, count)
        self.start = self._date()

    def _layout(self, stored: str, width: int, height: int, count: int, stride: int = 0) -> None:
        self._stored, self.shape, self.count = stored, (height, width), count
        self._bytes = width * height * np.dtype(stored).itemsize
        self._stride = stride or self._bytes
        if self._stride < self._bytes:
            raise FileError(self.path, f"damaged: frames of {self._bytes} bytes every {self._stride} bytes")
        needed = _HEADER + self._stride * (count - 1) + self._bytes
        if self._file.size < needed:
            raise FileError(self.path, f"damaged or cut off: {self._file.size} bytes, but {count} frames need {needed}")

    def _date(self) -> str | None:
        """``02Feb2026`` and ``134501`` as ISO text."""
        day = self._file.read(_DATE, 10).split(b"\0")[0].decode("latin-1").strip()
        clock = self._file.read(_TIME, 7).split(b"\0")[0].decode("latin-1").strip()
        month = day[2:5].lower()
        if not (month in _MONTHS and day[:2].isdigit() and day[5:9].isdigit()):
            return None
        date = f"{day[5:9]}-{_MONTHS.index(month) + 1:02d}-{day[:2]}"
        return f"{date}T{clock[:2]}:{clock[2:4]}:{clock[4:6]}" if clock.isdigit() and len(clock) == 6 else date

    def _version3(self) -> None:
        (at,) = self._file.unpack("<Q", _FOOTER)
        size = self._file.size - at
        if not _HEADER <= at < self._file.size or size > _LARGEST_FOOTER:
            raise FileError(self.path, "damaged or cut off: the XML footer is not there")
        text = self._file.read(at, size, "the XML footer").rstrip(b"\0 \r\n").decode("utf-8-sig", "replace")
        try:
            root = ElementTree.fromstring(text)
        except ElementTree.ParseError as error:
            raise FileError(self.path, f"damaged or cut off: its XML footer: {error}") from None
        frame = next((b for b in _children(root, "DataFormat", "DataBlock") if b.get("type") == "Frame"), None)
        if frame is None:
            raise FileError(self.path, "damaged: the XML footer has no DataBlock of type Frame")
        regions = [b for b in frame if _tag(b) == "DataBlock" and b.get("type") == "Region"]
        if len(regions) != 1 or _whole(self.path, regions[0], "count", 1) != 1:
            raise FileError(self.path, f"has {len(regions)} regions of the sensor; expected one: save them apart")
        kind = str(frame.get("pixelFormat"))
        if kind not in _FORMATS:
            raise FileError(self.path, f"pixels of the format {kind}; expected one of {', '.join(_FORMATS)}")
        count = _whole(self.path, frame, "count")
        width, height = _whole(self.path, regions[0], "width"), _whole(self.path, regions[0], "height")
        check_size(self.path, width, height, count)
        self._layout(_FORMATS[kind], width, height, count, _whole(self.path, frame, "stride"))
        self._stamps(root, _whole(self.path, frame, "size", self._bytes))

    def _stamps(self, root: Any, behind: int) -> None:
        """Start of every exposure: among the numbers behind the frame's pixels, in the order of the footer."""
        offset = 0
        for block in _children(root, "MetaFormat", "MetaBlock"):
            for entry in block:
                if _tag(entry) == "TimeStamp" and entry.get("event") == "ExposureStarted":
                    rate = float(entry.get("resolution") or 0)
                    if rate > 0 and self._bytes <= behind and behind + offset + 8 <= self._stride:
                        self._read_stamps(behind + offset, rate)
                        self.start = entry.get("absoluteTime")
                    return
                offset += _whole(self.path, entry, "bitDepth", 64) // 8
        return

    def _read_stamps(self, offset: int, rate: float) -> None:
        if _HEADER + (self.count - 1) * self._stride + offset + 8 > self._file.size:
            return
        ticks = [
            self._file.unpack("<q", _HEADER + k * self._stride + offset, "a time stamp")[0] for k in range(self.count)
        ]
        self.time_s = np.array(ticks, dtype=np.float64) / rate

    def read(self, number: int) -> Image:
        """One frame."""
        data = self._file.read(_HEADER + number * self._stride, self._bytes, f"frame {number}")
        return np.frombuffer(data, self._stored).astype(self.dtype).reshape(self.shape)

    def close(self) -> None:
        """Give the file back."""
        self._file.close()


def _tag(element: Any) -> str:
    """The name of an element without its name space."""
    return str(element.tag).rpartition("}")[2]


def _children(root: Any, *names: str) -> list[Any]:
    found = [root]
    for name in names:
        found = [child for parent in found for child in parent if _tag(child) == name]
    return found


def _whole(path: Pathlike, element: Any, key: str, default: int | None = None) -> int:
    text = element.get(key)
    if text is None and default is not None:
        return default
    if text is None or not text.isdecimal() or len(text) > 15:
        raise FileError(path, f"damaged: {key} is {text!r} in the XML footer; expected a whole number", _tag(element))
    return int(text)
