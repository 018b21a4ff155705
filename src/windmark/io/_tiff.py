"""TIFF: pages and stacks, packed 9- to 15-bit integers, palettes, white-is-zero; through tifffile, then Pillow."""

from __future__ import annotations

import io
import math
import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.io import _pillow
from windmark.io.bounded import MOST_UNPACKED, check_unpacked
from windmark.io.errors import FileError
from windmark.io.text import Pathlike

_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB, _PALETTE, _YCBCR, _CFA, _LINEAR_RAW = 0, 1, 2, 3, 6, 32803, 34892
_PLAIN = (_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB, _PALETTE, _CFA, _LINEAR_RAW)
_UNCOMPRESSED, _DEFLATE = 1, (8, 32946)
_DEFLATE_TIMES, _PIECE = 1032, 2**20


@contextmanager
def open_tiff(path: Pathlike) -> Iterator[TiffStack]:
    """The pictures of a TIFF file; thumbnails and masks in it are not counted."""
    import tifffile

    pages = page_chain(path)
    with tifffile.TiffFile(path) as tif:
        yield TiffStack(path, tif, pages)


class TiffStack:
    """The pictures of an open TIFF file."""

    def __init__(self, path: Pathlike, tif: Any, pages: list[int]) -> None:
        self._path = path
        self._tif = tif
        self._pages = pages
        self._hidden = 0
        if len(pages) == 1:
            # Some programs describe only the first picture of a long stack; the others follow it in the file.
            series = tif.series[0]
            behind = series.size // max(tif.pages[pages[0]].size, 1)
            if behind > 1 and series.dataoffset is not None and len(series.pages) == 1:
                self._hidden = int(behind)

    @property
    def count(self) -> int:
        """Number of pictures."""
        return self._hidden or len(self._pages)

    @property
    def bits(self) -> int:
        """Bits of a sample of the first picture."""
        return int(self._tif.pages[self._pages[0]].bitspersample)

    @property
    def file(self) -> Any:
        """The open file, for what it says of all pictures."""
        return self._tif

    def read(self, number: int) -> NDArray[Any]:
        """One picture: (H, W) or (H, W, channels), the file's own type."""
        page = self._tif.pages[self._pages[0 if self._hidden else number]]
        _check(self._path, page)
        values, inverted = (self._read_hidden(page, number), False) if self._hidden else self._decode(page)
        if page.photometric == _PALETTE and page.colormap is not None and values.ndim == 2:
            return _pillow._grey_if_grey((page.colormap.T[values] >> 8).astype(np.uint8))
        if page.photometric == _WHITE_IS_ZERO and not inverted and values.dtype.kind == "u":
            if page.bitspersample == 1:  # stretched already; an array of tifffile's own means what it says: True is 255
                return values if self._tif.is_shaped else np.uint8(255) - values
            values = values.dtype.type(2**page.bitspersample - 1) - values
        return values

    def _read_hidden(self, page: Any, number: int) -> NDArray[Any]:
        kind = page.dtype.newbyteorder(self._tif.byteorder)
        offset = self._tif.series[0].dataoffset + number * page.nbytes
        values = self._tif.filehandle.read_array(kind, page.size, offset)
        if values.size != page.size:
            raise FileError(self._path, f"cut off: page {number} is not complete")
        return values.reshape(page.shape)

    def _decode(self, page: Any) -> tuple[NDArray[Any], bool]:
        """The stored values, and whether white-is-zero was already turned round."""
        bits = page.bitspersample
        if page.photometric in _PLAIN and page.dtype is not None:
            if 8 < bits < 16 and page.dtype.kind == "u" and _is_simple(page):
                return _unpacked(self._path, self._tif, page), False
            try:
                values = page.asarray()
            except (KeyError, ValueError, NotImplementedError, ModuleNotFoundError) as error:
                if "imagecodecs" not in str(error) and not isinstance(error, ModuleNotFoundError):
                    raise
            else:
                values = np.moveaxis(values, 0, -1) if page.axes == "SYX" else values
                return (values * np.uint8(255), False) if values.dtype == bool else (values, False)
        values = _pillow.decode(self._path, ("TIFF",), page.index, self._upright(page))
        expected = np.dtype(np.uint8) if bits < 8 else page.dtype
        if values.dtype != expected:  # Pillow cuts deep colours to 8 bits
            kind = f"compression {page.compression}, photometric {page.photometric}, {bits} bits"
            raise FileError(self._path, f"a TIFF of {kind} cannot be read; expected it uncompressed or deflated")
        return values, bits <= 8

    def _upright(self, page: Any) -> io.BytesIO | None:
        """The file without the page's orientation, by which Pillow would turn it; None where there is none."""
        tag = page.tags.get(_pillow.ORIENTATION)
        if tag is None or tag.value == 1:
            return None
        with open(self._path, "rb") as stream:
            content = io.BytesIO(stream.read())
        content.seek(tag.valueoffset)
        content.write(struct.pack(self._tif.byteorder + "H", 1))
        return content


def _check(path: Pathlike, page: Any) -> None:
    """Rows that are missing must not come back as black."""
    _pillow.check_plausible(path, (page.imagewidth, page.imagelength), 1)
    check_unpacked(path, page.nbytes, os.path.getsize(path))  # channels and bits may be damaged, too
    segments = math.prod(page.chunked) if page.chunked else 0
    counts = page.databytecounts
    most = os.path.getsize(path)
    whole = len(counts) >= segments and all(0 < count <= most for count in counts[:segments])
    if not segments or not whole or len(page.dataoffsets) < segments:
        raise FileError(path, f"page {page.index} lacks a part of its pixels")
    if int(page.compression) in _DEFLATE and max(counts) * _DEFLATE_TIMES > MOST_UNPACKED:
        for offset, size in zip(page.dataoffsets, counts, strict=False):  # libraries unpack all there is
            page.parent.filehandle.seek(offset)
            _inflated(path, page.parent.filehandle.read(size), page.nbytes, keep=False)


def _inflated(path: Pathlike, data: bytes, most: int, *, keep: bool = True) -> bytes:
    """The bytes of a deflated part of a page, at most ``most`` and some; none without ``keep``."""
    stream, kept, size = zlib.decompressobj(), [], 0
    while data and not stream.eof:
        piece = stream.decompress(data, _PIECE)
        data, size = stream.unconsumed_tail, size + len(piece)
        kept += [piece] if keep else []
        if size > most + _PIECE:
            raise FileError(path, f"damaged: a part of a page unpacks to more than the page's {most} bytes")
    if not stream.eof:
        raise FileError(path, "damaged or cut off: a part of a page ends too early")
    return b"".join(kept)


def _is_simple(page: Any) -> bool:
    """Strips of whole rows, uncompressed or deflated, channels together."""
    compression = int(page.compression)
    known = compression == _UNCOMPRESSED or compression in _DEFLATE
    return known and not page.is_tiled and page.predictor == 1 and int(page.planarconfig or 1) == 1


def _unpacked(path: Pathlike, tif: Any, page: Any) -> NDArray[np.uint16]:
    """Integers of 9 to 15 bits that fill the bytes without gaps; every row starts on a byte."""
    height, width = page.imagelength, page.imagewidth
    n, bits = width * page.samplesperpixel, page.bitspersample
    row_bytes = (n * bits + 7) // 8
    parts = []
    for offset, size in zip(page.dataoffsets, page.databytecounts, strict=False):
        tif.filehandle.seek(offset)
        data = tif.filehandle.read(size)
        data = _inflated(path, data, height * row_bytes) if int(page.compression) in _DEFLATE else data
        whole = len(data) // row_bytes
        parts.append(np.frombuffer(data, dtype=np.uint8, count=whole * row_bytes).reshape(whole, row_bytes))
    packed = np.concatenate(parts)[:height]
    if len(packed) < height:
        raise FileError(path, f"cut off: {len(packed)} of {height} rows are there")
    values = np.empty((height, n), dtype=np.uint16)
    step = max(1, 2**20 // n)  # rows at a time: the work needs ten times the memory of its result
    for k in range(0, height, step):
        block = packed[k : k + step]
        values[k : k + step] = unpack_bits(_REVERSED[block] if page.fillorder == 2 else block, n, bits)
    return values.reshape(height, width, page.samplesperpixel) if page.samplesperpixel > 1 else values


_REVERSED = np.packbits(np.unpackbits(np.arange(256, dtype=np.uint8)).reshape(256, 8)[:, ::-1], axis=1)[:, 0]


def unpack_bits(packed: NDArray[np.uint8], n: int, bits: int) -> NDArray[np.uint16]:
    """``n`` big-endian integers of ``bits`` bits (at most 16) from every row of bytes: (rows, bytes) -> (rows, n)."""
    first, shift = np.divmod(np.arange(n) * bits, 8)
    padded = np.pad(packed, ((0, 0), (0, 2))).astype(np.uint32)
    # Three bytes hold any value: it starts within the first and is at most 16 bits long.
    window = padded[:, first] << 16 | padded[:, first + 1] << 8 | padded[:, first + 2]
    return (window >> (24 - bits - shift).astype(np.uint32) & (2**bits - 1)).astype(np.uint16)


def page_chain(path: Pathlike) -> list[int]:
    """Indices of the pages that are pictures of their own, not thumbnails or masks (TIFF 6.0, section 2).

    Following the chain of pages to its end is also the check that nothing was cut off: a stack
    without its end would otherwise look like a shorter one.

    Raises
    ------
    FileError
        Names the page that is missing.
    """
    pictures: list[int] = []
    seen: set[int] = set()
    with open(path, "rb") as stream:
        head = stream.read(16)
        order, big = ("<" if head[:2] == b"II" else ">"), head[2:4] in (b"+\0", b"\0+")
        entry, count, offset = (20, order + "Q", order + "Q") if big else (12, order + "H", order + "I")
        at = _number(head[8:16] if big else head[4:8], offset)
        while at:
            if at in seen:
                raise FileError(path, f"damaged: page {len(seen)} is an earlier one again")
            stream.seek(at)
            entries = _number(stream.read(struct.calcsize(count)), count) or 0
            table = stream.read(min(entries, 65536) * entry)
            at_next = _number(stream.read(struct.calcsize(offset)), offset)
            if not entries or at_next is None:
                raise FileError(path, f"damaged or cut off: page {len(seen)} is not there")
            if not _is_reduced_or_mask(table, order, entry):
                pictures.append(len(seen))
            seen.add(at)
            at = at_next
    if not seen:
        raise FileError(path, "damaged or cut off: no page")
    return pictures or list(range(len(seen)))


def _is_reduced_or_mask(table: bytes, order: str, entry: int) -> bool:
    """Bits 0 and 2 of NewSubfileType (tag 254), the first entry where it is there."""
    tag, kind = struct.unpack(order + "HH", table[:4])
    value_at = entry - (8 if entry == 20 else 4)
    size = "H" if kind == 3 else "I"
    value = struct.unpack_from(order + size, table, value_at)[0]
    return tag == 254 and bool(value & 0b101)


def _number(data: bytes, fmt: str) -> int | None:
    return struct.unpack(fmt, data)[0] if len(data) == struct.calcsize(fmt) else None
