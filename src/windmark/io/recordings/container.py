"""Whether a film's file is as long as its container says: AVI (RIFF), MP4 and MOV (boxes), MKV and WebM (EBML)."""

from __future__ import annotations

from windmark.io.errors import FileError
from windmark.io.recordings.base import ByteFile
from windmark.io.text import Pathlike

_EBML, _SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"
_PADDING = 8
"""Bytes that writers count with a chunk or do not: padding, its own head."""
_MOST = 100_000
"""Parts of the top level; no film has more."""


def check_whole(path: Pathlike) -> None:
    """Refuse a film that was cut off: its container's outermost parts say where they end.

    A part of unknown length, as one that was written live has, says nothing; nor does a container that is none of
    these. RIFF: Microsoft, Multimedia Programming Interface 1.0; boxes: ISO/IEC 14496-12, 4.2; EBML: RFC 8794.
    """
    file = ByteFile(path)
    try:
        head = file.read(0, min(12, file.size))
        if head[:4] == b"RIFF":
            end = _riff(file)
        elif head[4:8] == b"ftyp":
            end = _boxes(file)
        elif head[:4] == _EBML:
            end = _segment(file)
        else:
            return
    finally:
        file.close()
    if end > file.size + _PADDING:
        raise FileError(
            path, f"cut off: its header tells of {end} bytes, the file has {file.size}; copy it again, or write what "
            "is left of it with another program (ffmpeg -i FILM -c copy NEW)"
        )  # fmt: skip


def _riff(file: ByteFile) -> int:
    """Where the last RIFF ends: long films have several."""
    at = end = 0
    while at + 8 <= file.size:
        name, size = file.unpack("<4sI", at)
        if name != b"RIFF" or not size:
            break
        end = at + 8 + size
        at = end + size % 2
    return end


def _boxes(file: ByteFile) -> int:
    """Where the last box ends."""
    at = 0
    for _ in range(_MOST):
        if at + 16 > file.size:
            break
        size, _name, long = file.unpack(">I4sQ", at)
        size = long if size == 1 else size
        if size < 8:  # 0: it reaches to the end
            break
        at += size
    return at


def _segment(file: ByteFile) -> int:
    """Where the first segment ends."""
    at = 0
    for _ in range(_MOST):
        if at + 12 > file.size:
            break
        name = file.read(at, 4)
        width = 9 - file.read(at + 4, 1)[0].bit_length()
        if width > 8 or at + 4 + width > file.size:
            break
        size = int.from_bytes(file.read(at + 4, width), "big") & (2 ** (7 * width) - 1)
        if size == 2 ** (7 * width) - 1:  # unknown
            break
        at += 4 + width + size
        if name == _SEGMENT:
            break
    return at
