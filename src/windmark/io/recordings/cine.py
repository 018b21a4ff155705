"""Phantom ``.cine``: after Vision Research's "Cine file format" (structures CINEFILEHEADER, BITMAPINFOHEADER, SETUP).

All numbers are little-endian. Rows of uncompressed pictures run from the bottom to the top, those of packed ones (10
and 12 bits, most significant bits first) from the top to the bottom. Packed 10-bit pixels are codes of a table with
12-bit levels (`_cine_table`); it is applied, so that levels are proportional to light. No black or white level is
applied.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from windmark.io.errors import FileError
from windmark.io.recordings.base import ByteFile, Image, Recording, check_size, unpack10, unpack12
from windmark.io.text import Pathlike

_PLAIN, _PACKED10, _PACKED12 = 0, 256, 1024
_JPEG, _CFA = 1, 2
_TIMES = 1002  # type of the tagged block with a TIME64 for each image
_TIME64_UNIT = 2.0**-32
_MOSAICS = {3: "GBRG", 4: "RGGB"}
# Offsets within SETUP, which is packed without gaps.
_LENGTH, _FRAME_RATE, _MOSAIC, _REAL_BITS = 142, 768, 808, 896
_NEWEST = 900  # bytes of SETUP that are needed for all of these


class CineRecording(Recording):
    """8- and 16-bit pictures, packed 10 and 12 bits, colour mosaics, and colours that were interpolated when saved."""

    kind = "Phantom cine"

    def __init__(self, path: Pathlike) -> None:
        super().__init__(path)
        self._file = ByteFile(path)
        try:
            self._open()
        except BaseException:
            self._file.close()
            raise

    def _open(self) -> None:
        (mark, head_bytes, compression, _, _, _, first, count, bitmap_at, setup_at, offsets_at, fraction, seconds) = (
            self._file.unpack("<2sHHHiIiIIIIII", 0)
        )
        if mark != b"CI" or head_bytes < 44:
            raise FileError(self.path, "is no Phantom cine: it does not begin as one")
        if compression == _JPEG:
            raise FileError(self.path, "holds JPEG pictures, which lose grey levels; save it again uncompressed or as "
                                       "TIFF with Phantom Camera Control (PCC)")  # fmt: skip
        _, width, height, _, self._stored, self._packing, self._bytes = self._file.unpack(
            "<IiiHHII", bitmap_at, "the bitmap header"
        )
        self._from_top = height < 0
        self.count, height = count, abs(height)
        check_size(self.path, width, height, count)
        self._layout(width, height)
        # 64-bit places: a picture may be anywhere in the file, but all of it must be there.
        self._at = self._file.numbers("<i8", count, offsets_at, "the places of the images")
        if (self._at < 44).any() or (self._at >= self._file.size).any():
            raise FileError(self.path, "damaged or cut off: images lie outside the file")
        self._setup(setup_at, offsets_at, compression, first, (seconds, fraction & ~3))
        self._pixels(count - 1)  # the last one is there

    def _layout(self, width: int, height: int) -> None:
        """Shape and type of a picture, and the bytes that it must have."""
        shape: tuple[int, ...] = (height, width)
        if self._packing in (_PACKED10, _PACKED12):
            self.bits, self.dtype = 12, np.dtype(np.uint16)
            needed = (width * height * (10 if self._packing == _PACKED10 else 12) + 7) // 8
        elif self._packing == _PLAIN and self._stored in (8, 16, 24, 48):
            shape = (height, width, 3) if self._stored > 16 else shape
            self.dtype = np.dtype(np.uint8 if self._stored in (8, 24) else np.uint16)
            self.bits = 8 * self.dtype.itemsize
            needed = height * width * self._stored // 8
        else:
            kind = f"{self._stored} bits, packing {self._packing}"
            raise FileError(self.path, f"pixels of {kind}; expected 8 or 16 bits, packed 10 or 12")
        self.shape, self._needed = shape, needed

    def _setup(self, at: int, end: int, compression: int, first: int, trigger: tuple[int, int]) -> None:
        """Rate, colour filter and significant bits from SETUP, times from the tagged blocks behind it."""
        known = self._file.read(at, min(_NEWEST, max(self._file.size - at, 0)), "the camera's settings")
        length = int.from_bytes(known[_LENGTH : _LENGTH + 2], "little") if len(known) >= _LENGTH + 2 else 0

        def number(offset: int) -> int:
            here = offset + 4 <= min(length, len(known))
            return int.from_bytes(known[offset : offset + 4], "little") if here else 0

        bits = number(_REAL_BITS)
        if self._packing == _PLAIN and 8 <= bits <= self.bits:
            self.bits = bits
        self.time_s = self._tagged_times(at + length, end, trigger)
        if self.time_s is not None:
            self.noted("time 0 is the trigger")
        elif (rate := number(_FRAME_RATE)) > 0:
            self.time_s = (first + np.arange(self.count)) / rate
            self.noted(f"no time stamps; times are counted with {rate} frames/s, 0 is the trigger")
        if trigger[0]:
            whole = datetime.fromtimestamp(trigger[0], UTC)
            self.start = (whole + timedelta(seconds=trigger[1] * _TIME64_UNIT)).isoformat()
        if first:
            self.noted(f"the camera's number of frame 0 is {first}")
        if compression == _CFA and len(self.shape) == 2:
            self._colour_filter(number(_MOSAIC))

    def _colour_filter(self, code: int) -> None:
        self.bayer = _MOSAICS.get(code & 0xFFFF)
        which = self.bayer or "a pattern that is not known: give bayer"
        self.noted(f"a colour sensor's raw mosaic, {which}")

    def _tagged_times(self, at: int, end: int, trigger: tuple[int, int]) -> NDArray[np.float64] | None:
        """Seconds from the trigger of every image; None where they are not there.

        Blocks lie between the settings and the table of places: size, type, a reserved number, data.
        """
        while at + 8 <= min(end, self._file.size):
            size, kind = self._file.unpack("<IH", at, "a tagged block")
            if size < 8:
                return None
            if kind == _TIMES:
                if size - 8 < 8 * self.count:
                    return None
                times = self._file.numbers("<u4", 2 * self.count, at + 8, "the time stamps").reshape(-1, 2)
                # The two last bits say whether the clock was synchronised, not the time.
                ticks = (times[:, 0] & ~np.uint32(3)).astype(np.int64) - trigger[1]
                return (times[:, 1].astype(np.int64) - trigger[0]) + ticks * _TIME64_UNIT
            at += size
        return None

    def _pixels(self, number: int) -> tuple[int, int]:
        """Place and size of the pixels, behind the image's annotation."""
        at = int(self._at[number])
        (annotation,) = self._file.unpack("<I", at, f"image {number}")
        if annotation < 8:
            raise FileError(self.path, f"damaged: image {number} has an annotation of {annotation} bytes")
        (size,) = self._file.unpack("<I", at + annotation - 4, f"image {number}")
        if size < self._needed:
            raise FileError(self.path, f"damaged: image {number} has {size} bytes; expected {self._needed}")
        if at + annotation + size > self._file.size:
            raise FileError(self.path, f"damaged or cut off: image {number} is not complete")
        return at + annotation, size

    def read(self, number: int) -> Image:
        """One frame."""
        place, size = self._pixels(number)
        if self._packing != _PLAIN:
            data, count = self._file.read(place, self._needed), self.shape[0] * self.shape[1]
            if self._packing == _PACKED12:
                return unpack12(data, count).reshape(self.shape)
            return _levels()[unpack10(data, count)].reshape(self.shape)
        height = self.shape[0]
        # Rows of bitmaps may be filled up to whole words.
        row = size // height if size % height == 0 and size // height < self._needed // height + 4 else (
            self._needed // height
        )  # fmt: skip
        rows = np.frombuffer(self._file.read(place, row * height), np.uint8).reshape(height, row)
        rows = np.ascontiguousarray(rows[:, : self._needed // height])
        values = rows.view("<u2" if self.dtype == np.uint16 else np.uint8).reshape(self.shape).astype(self.dtype)
        values = values if self._from_top else values[::-1]
        return values[..., ::-1] if values.ndim == 3 else values  # blue, green, red in the file

    def close(self) -> None:
        """Give the file back."""
        self._file.close()


def _levels() -> NDArray[np.uint16]:
    from windmark.io.recordings._cine_table import LEVELS

    return LEVELS
