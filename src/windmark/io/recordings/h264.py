"""Which frames of an H.264 film are coded from frames that it has lost: every reference frame carries a number.

ITU-T H.264: byte stream and NAL units (7.3.1, Annex B), parameter set (7.3.2.1.1), slice header (7.3.3), frame_num
(7.4.3). FFmpeg decodes such frames from what is nearest, and does not say so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

_SLICE, _KEY, _SET = 1, 5, 7
"""Kinds of NAL units: a slice, one of a frame from which on nothing before is needed, a sequence parameter set."""
_HIGH = (44, 83, 86, 100, 110, 118, 122, 128, 134, 135, 138, 139, 244)
"""Profiles whose parameter sets tell of colours and scaling."""
_HEAD = 64
"""Bytes of a slice that its number is in, by far."""


@dataclass(frozen=True)
class Coded:
    """What a packet says of its frame: its number, whether others are coded from it, and whether it is a key frame."""

    number: int
    referred: bool
    key: bool


class Numbering:
    """The numbers of a stream's frames; of no use (`width` 0) where its parameter set is not there, or allows gaps."""

    def __init__(self, extradata: bytes | None) -> None:
        data = extradata or b""
        self._length = (data[4] & 3) + 1 if len(data) > 6 and data[0] == 1 else 0  # 0: start codes
        self.width, self._planes = 0, False
        sets = {nal for nal in (_of_avcc(data) if self._length else _by_codes(data)) if nal and nal[0] & 31 == _SET}
        if len(sets) == 1:
            try:
                self.width, self._planes = _numbered(_Bits(sets.pop()[1:]))
            except IndexError:  # cut off
                self.width = 0

    def of(self, packet: bytes) -> Coded | None:
        """Of a packet's first slice; None without one."""
        for nal in _by_length(packet, self._length) if self._length else _by_codes(packet):
            kind = nal[0] & 31 if nal else 0
            if kind not in (_SLICE, _KEY) or not self.width:
                continue
            bits = _Bits(nal[1:_HEAD])
            try:
                for _ in range(3):  # first macroblock, type, parameter set
                    bits.golomb()
                bits.take(2 if self._planes else 0)
                return Coded(bits.take(self.width), nal[0] >> 5 & 3 != 0, kind == _KEY)
            except IndexError:
                return None
        return None

    def orphans(self, coded: Sequence[Coded | None]) -> list[bool]:
        """Which packets, in order of decoding, are coded from a frame that is not there, or from one that is."""
        out, last, lost = [], None, False
        for frame in coded:
            if frame is None or frame.key:
                lost, last = False, None if frame is None else 0
            elif last is not None and frame.number not in (last, (last + 1) % 2**self.width):
                lost = True
            if frame is not None and frame.referred:
                last = frame.number
            out.append(lost)
        return out


class _Bits:
    """Bits of a NAL unit, most significant first, without the bytes that keep start codes out."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data.replace(b"\0\0\3", b"\0\0"), 0

    def take(self, count: int) -> int:
        value = 0
        for _ in range(count):
            value = value << 1 | self._data[self._at >> 3] >> (7 - (self._at & 7)) & 1
            self._at += 1
        return value

    def golomb(self) -> int:
        zeros = 0
        while not self.take(1):
            zeros += 1
        return (1 << zeros) - 1 + self.take(zeros)

    def signed(self) -> int:
        value = self.golomb()
        return (value + 1) // 2 if value % 2 else -(value // 2)


def _numbered(bits: _Bits) -> tuple[int, bool]:
    """Bits of a frame's number (0 where numbers may be left out), and whether colours are coded apart."""
    profile, _ = bits.take(8), bits.take(16)
    bits.golomb()
    planes = False
    if profile in _HIGH:
        colours = bits.golomb()
        planes = colours == 3 and bool(bits.take(1))
        bits.golomb(), bits.golomb(), bits.take(1)
        if bits.take(1):
            for k in range(12 if colours == 3 else 8):
                if bits.take(1):
                    _skip_scaling(bits, 16 if k < 6 else 64)
    width, order = bits.golomb() + 4, bits.golomb()
    if order == 0:
        bits.golomb()
    elif order == 1:
        bits.take(1), bits.signed(), bits.signed()
        for _ in range(bits.golomb()):
            bits.signed()
    bits.golomb()
    return (0 if bits.take(1) else width), planes


def _skip_scaling(bits: _Bits, size: int) -> None:
    last = after = 8
    for _ in range(size):
        if after:
            after = (last + bits.signed()) % 256
        last = after or last


def _of_avcc(data: bytes) -> Iterator[bytes]:
    """The sequence parameter sets of an MP4's or MKV's header (ISO/IEC 14496-15, 5.3.3.1)."""
    at = 6
    for _ in range(data[5] & 31):
        size = int.from_bytes(data[at : at + 2], "big")
        yield data[at + 2 : at + 2 + size]
        at += 2 + size


def _by_length(data: bytes, width: int) -> Iterator[bytes]:
    at = 0
    while at + width < len(data):
        size = int.from_bytes(data[at : at + width], "big")
        yield data[at + width : at + width + min(size, 4096)]
        at += width + size


def _by_codes(data: bytes) -> Iterator[bytes]:
    at = data.find(b"\0\0\1")
    while at >= 0:
        after = data.find(b"\0\0\1", at + 3)
        yield data[at + 3 : after if after >= 0 else len(data)]
        at = after
