"""Photron: ``.mraw``, raw pictures one after the other, with a header beside it, ``.cih`` (text) or ``.cihx`` (XML).

The keys are those that Photron FASTCAM Viewer writes. Packed pixels have their most significant bits first; the layout
of 12 bits is checked against a real recording (tests/real), that of 10 bits is the same rule.
"""

from __future__ import annotations

import re
from fractions import Fraction
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from windmark.io.errors import FileError, reading
from windmark.io.recordings.base import ByteFile, Image, Recording, check_size, unpack10, unpack12
from windmark.io.text import Pathlike

_HEADERS = (".cih", ".cihx")
_LARGEST_HEADER = 16 * 2**20
_PADDING = 4096
_XML = {
    "date": ("fileInfo", "date"), "time": ("fileInfo", "time"), "record rate(fps)": ("recordInfo", "recordRate"),
    "total frame": ("frameInfo", "totalFrame"), "start frame": ("frameInfo", "startFrame"),
    "save step": ("frameInfo", "skipFrame"), "image width": ("imageDataInfo", "resolution", "width"),
    "image height": ("imageDataInfo", "resolution", "height"),
    "color type": ("imageDataInfo", "colorInfo", "type"), "color bit": ("imageDataInfo", "colorInfo", "bit"),
    "effectivebit depth": ("imageDataInfo", "effectiveBit", "depth"),
    "effectivebit side": ("imageDataInfo", "effectiveBit", "side"), "file format": ("imageFileInfo", "fileFormat"),
}  # fmt: skip


class PhotronRecording(Recording):
    """Pictures of 8, 10 (packed), 12 (packed) or 16 bits, grey or colours; the header says which."""

    kind = "Photron mraw"

    def __init__(self, path: Pathlike) -> None:
        super().__init__(path)
        header, pixels = _both(Path(path))
        values = _Header(header)
        width, height = values.whole("image width"), values.whole("image height")
        self.count = values.whole("total frame")
        check_size(header, width, height, self.count)
        stored = values.whole("color bit")
        colours = values.text("color type", "mono").lower() not in ("mono", "bayer", "raw") and stored % 3 == 0
        self._bits = stored // 3 if colours else stored
        if self._bits not in (8, 10, 12, 16):
            raise FileError(header, f"pixels of {stored} bits; expected 8, 10, 12 or 16 (three times that in colours)",
                            "Color Bit")  # fmt: skip
        self.shape = (height, width, 3) if colours else (height, width)
        self.dtype = np.dtype(np.uint8 if self._bits == 8 else np.uint16)
        self.bits = min(values.whole("effectivebit depth", self._bits) or self._bits, self._bits)
        # Valid bits at the upper end of their place: brought down, so that a level is what the sensor gave.
        self._shift = self._bits - self.bits if values.text("effectivebit side", "lower").lower() == "higher" else 0
        self._frame_bytes = (int(np.prod(self.shape)) * self._bits + 7) // 8
        self._file = ByteFile(pixels)
        try:
            _check_length(self._file, self.count * self._frame_bytes, self.count, self._bits, header)
            self._clock(values)
        except BaseException:
            self._file.close()
            raise
        if colours:
            self.noted("colours are taken as red, green, blue, pixel by pixel")
        elif values.text("color type", "mono").lower() != "mono":
            self.noted("a colour sensor's raw mosaic; the header does not say its pattern: give bayer")
        if self._shift:
            self.noted(f"levels were stored times {2**self._shift}; they are divided by it")

    def _clock(self, values: _Header) -> None:
        rate = values.number("record rate(fps)", 0.0)
        first, step = values.whole("start frame", 0), max(values.whole("save step", 1), 1)
        if rate > 0 and np.isfinite(rate):
            self.time_s = (first + step * np.arange(self.count)) / rate
        if first:
            self.noted(f"the camera's number of frame 0 is {first}")
        day, clock = values.text("date", ""), values.text("time", "")
        found = re.fullmatch(r"(\d{4})[/-](\d{1,2})[/-](\d{1,2})", day)
        if found:
            date = f"{found[1]}-{int(found[2]):02d}-{int(found[3]):02d}"
            self.start = f"{date}T{clock}" if re.fullmatch(r"\d{2}:\d{2}(:\d{2}(\.\d+)?)?", clock) else date

    def read(self, number: int) -> Image:
        """One frame."""
        data = self._file.read(number * self._frame_bytes, self._frame_bytes, f"frame {number}")
        count = int(np.prod(self.shape))
        if self._bits == 12:
            values: Image = unpack12(data, count)
        elif self._bits == 10:
            values = unpack10(data, count)
        else:
            values = np.frombuffer(data, "<u2" if self._bits == 16 else np.uint8).astype(self.dtype)
        return (values >> self._shift if self._shift else values).reshape(self.shape)

    def close(self) -> None:
        """Give the file back."""
        self._file.close()


class _Header:
    """``Key : value`` lines, or the XML of a ``.cihx``."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with reading(path), open(path, "rb") as stream:
            content = stream.read(_LARGEST_HEADER)
        if not content.strip():
            raise FileError(path, "the file is empty; expected a Photron header")
        # Program versions differ in the page of their text; the keys are ASCII in all of them.
        begin, end = content.find(b"<cih>"), content.find(b"</cih>")
        if begin >= 0:
            self._values = self._xml(content[begin : end + 6] if end > begin else content[begin:])
        else:
            pairs = (line.partition(":") for line in content.decode("latin-1").splitlines())
            self._values = {}
            for key, sign, value in pairs:
                if sign:
                    self._values.setdefault(" ".join(key.split()).lower(), value.strip())
        if "image width" not in self._values:
            raise FileError(path, "no Image Width; expected the header of a Photron recording")

    def _xml(self, content: bytes) -> dict[str, str]:
        try:
            root = ElementTree.fromstring(content.decode("utf-8", "replace"))
        except ElementTree.ParseError as error:
            raise FileError(self._path, f"damaged or cut off: {error}") from None
        found = {key: root.findtext("/".join(place)) for key, place in _XML.items()}
        return {key: value.strip() for key, value in found.items() if value is not None}

    def text(self, key: str, default: str) -> str:
        """A value as it is."""
        return self._values.get(key) or default

    def number(self, key: str, default: float) -> float:
        """A number; also 1/1000."""
        try:
            return float(Fraction(self._values[key].replace(" ", ""))) if self._values.get(key) else default
        except (ValueError, ZeroDivisionError, OverflowError):
            raise FileError(self._path, f"{self._values[key]!r} is no number", key.title()) from None

    def whole(self, key: str, default: int | None = None) -> int:
        """A whole number; needed where no default is given."""
        if key not in self._values and default is None:
            raise FileError(self._path, "is missing in the header", key.title())
        value = self.number(key, float("nan") if default is None else default)
        if not (value == value and abs(value) < 2**53 and value == int(value)):
            raise FileError(self._path, f"{self._values.get(key)!r} is no whole number", key.title())
        return int(value)


def _both(path: Path) -> tuple[Path, Path]:
    """The header and the pictures that belong together by their names."""
    if path.suffix.lower() in _HEADERS:
        return path, _beside(path, (".mraw",), "its pictures are")
    if not path.is_file():
        raise FileError(path, "no such file")
    return _beside(path, (".cihx", ".cih"), "its header is"), path


def _beside(path: Path, suffixes: tuple[str, ...], what: str) -> Path:
    for suffix in suffixes:
        for name in (suffix, suffix.upper()):
            if (other := path.with_suffix(name)).is_file():
                return other
    raise FileError(path, f"{what} missing; expected {' or '.join(path.with_suffix(s).name for s in suffixes)} "
                          "beside it")  # fmt: skip


def _check_length(file: ByteFile, needed: int, count: int, bits: int, header: Path) -> None:
    """The pictures must fill the file: a wrong number of bits would give pictures all the same."""
    if file.size < needed or file.size - needed >= min(_PADDING, needed // count):
        said: Any = f"{file.size} bytes, but {count} frames of {bits} bits a pixel, as {header.name} says, are {needed}"
        raise FileError(file.path, f"damaged or cut off: {said}")
