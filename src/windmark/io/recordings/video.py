"""AVI, MP4, MOV and other films, through PyAV (the extra ``video``)."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from windmark.io.errors import FileError
from windmark.io.recordings.base import Image, Recording, check_size
from windmark.io.recordings.container import check_whole
from windmark.io.recordings.gaps import gaps_between, said_of
from windmark.io.recordings.h264 import Coded, Numbering
from windmark.io.text import Pathlike

_LOSSLESS = (
    "rawvideo", "ffv1", "huffyuv", "ffvhuff", "utvideo", "png", "v210", "v410", "v308", "magicyuv", "qtrle", "lagarith",
    "tiff", "bmp", "y41p", "yuv4", "r210", "zlib", "mszh", "bitpacked", "dpx",
)  # fmt: skip
_GREY = {"gray": "gray", "gray8": "gray", "gray8a": "gray", "ya8": "gray", "monow": "gray", "monob": "gray"}
_MOST_PIXELS = 400_000_000


class _Packet(NamedTuple):
    """Its frame's time stamp; whether that is a key frame, is shown, and what it says of itself (H.264)."""

    stamp: Any
    key: bool
    shown: bool
    coded: Coded | None


class VideoRecording(Recording):
    """Frames of a film in the order of showing: grey where it is stored so, else red, green, blue.

    Frames are counted once, from their packets; the way to one leads from the key frame before it.
    """

    kind = "film"

    def __init__(self, path: Pathlike) -> None:
        try:
            import av
        except ModuleNotFoundError:
            raise FileError(path, "films need PyAV: pip install windmark[video]") from None
        super().__init__(path)
        check_whole(path)
        self._guard = threading.Lock()
        self._orphans: set[int] = set()
        self._gaps: dict[int, int] = {}
        try:
            self._av, self._file = av, av.open(str(path), mode="r")
        except MemoryError:  # FFmpeg's own word on a count that no memory could hold: it has asked for none
            raise FileError(path, "damaged: one of its tables claims more entries than any film has") from None
        try:
            self._open()
        except BaseException:
            self._file.close()
            raise

    def _open(self) -> None:
        if not self._file.streams.video:
            raise FileError(self.path, "holds no pictures; expected a film")
        self._stream = self._file.streams.video[0]
        codec = self._stream.codec_context
        width, height = codec.width, codec.height
        check_size(self.path, width, height, 1)
        if width * height > _MOST_PIXELS:
            raise FileError(self.path, f"damaged: pictures of {width} x {height} pixels")
        codec.thread_type = "NONE"  # where slices are decoded side by side, FFmpeg does not tell of damage
        packets = self._packets()
        shown = [p for p in packets if p.shown]
        stamps = [p.stamp for p in shown]
        if any(s is None for s in stamps) or len(set(stamps)) != len(stamps):
            raise FileError(self.path, "its frames have no time stamps; write it again with another program")
        self._stamps = sorted(stamps)
        self.count = len(stamps)
        check_size(self.path, width, height, self.count)
        if self._stream.time_base:
            base = self._stream.time_base
            self.time_s = np.array([float(s * base) for s in self._stamps])
        self._gaps = gaps = gaps_between(self._stamps, rounded="matroska" in self._file.format.name)
        numbering = self._numbering
        numbered = numbering is not None and all(p.coded is not None for p in packets)
        if gaps and numbering is not None and numbered:
            orphans = numbering.orphans([p.coded for p in packets])
            self._orphans = {p.stamp for p, orphan in zip(packets, orphans, strict=True) if orphan}
        self._at = self.count
        self._frames: Iterator[tuple[Any, bool]] = iter(())
        first = self.read(0)
        self.shape, self.dtype = first.shape, first.dtype
        self.kind = f"film ({codec.name})"
        if codec.name not in _LOSSLESS:
            self.noted(f"{codec.name} loses grey levels: they are not the sensor's")
        if (codec.pix_fmt or "").startswith("yuv"):
            self.noted(f"stored as {codec.pix_fmt}: colours are recomputed")
        keys = np.searchsorted(self._stamps, sorted(p.stamp for p in shown if p.key))
        self.noted(said_of(gaps, None if numbered else keys, self.count))

    def _packets(self) -> list[_Packet]:
        """What is to be known of each packet, in order of decoding; the packets themselves may not fit into memory."""
        codec, out, held = self._stream.codec_context, list[_Packet](), 0
        numbering = Numbering(codec.extradata) if codec.name == "h264" else None
        self._numbering = numbering if numbering is not None and numbering.width else None
        for p in self._file.demux(self._stream):
            held += bool(p.size or p.dts is not None)
            if p.size:
                coded = None if self._numbering is None else self._numbering.of(bytes(p))
                out.append(_Packet(p.pts if p.pts is not None else p.dts, p.is_keyframe, not p.is_discard, coded))
        # An AVI counts pictures that were dropped, too, of which it holds nothing; its length says whether it is whole.
        if held < self._stream.frames and "avi" not in self._file.format.name:
            said = f"its header tells of {self._stream.frames} pictures, it holds {held}"
            raise FileError(self.path, f"cut off or damaged: {said}; copy it again")
        return out

    def lost_before(self, number: int) -> int:
        """See `gaps_between`."""
        return sum(count for behind, count in self._gaps.items() if behind <= number)

    def read(self, number: int) -> Image:
        """One frame."""
        if self._stamps[number] in self._orphans:
            raise FileError(self.path, f"frame {number} is coded from one that was lost from the film")
        with self._guard:
            if not self._at < number <= self._at + 8:
                self._seek(number)
            frame, whole = self._decoded(number)
            if number and not whole:  # a container whose key frames are marked wrongly
                self._seek(0)
                frame, whole = self._decoded(number)
            if frame is None:
                raise FileError(self.path, f"damaged or cut off: frame {number} cannot be decoded")
            if not whole:
                raise FileError(self.path, f"damaged: frame {number} is not whole, or a frame that it is coded from")
            return self._pixels(frame)

    def _seek(self, number: int) -> None:
        self._file.seek(self._stamps[number], stream=self._stream, backward=True, any_frame=False)
        self._frames, self._at = self._told_whole(self._file.decode(self._stream)), -1

    def _told_whole(self, frames: Iterable[Any]) -> Iterator[tuple[Any, bool]]:
        """Each frame, and whether it is as it was stored: FFmpeg fills in what is damaged, and marks that frame alone.

        Those behind it are coded from it up to the next key frame; those that are coded from both sides (B) also from
        the next one that is not.
        """
        lost, waiting = False, list[Any]()
        for frame in frames:
            waiting.append(frame)
            if int(frame.pict_type) == int(self._av.video.frame.PictureType.B):
                continue
            now = any(f.is_corrupt for f in waiting)
            for f in waiting:
                yield f, not (now or (lost and not f.key_frame))
            lost, waiting = now or (lost and not frame.key_frame), []
        now = lost or any(f.is_corrupt for f in waiting)
        yield from ((f, not now) for f in waiting)

    def _decoded(self, number: int) -> tuple[Any, bool]:
        """The frame with this frame's time stamp, decoding on from where the decoder is, and whether it is whole."""
        wanted = self._stamps[number]
        for frame, whole in self._frames:
            stamp = frame.pts if frame.pts is not None else frame.dts
            if stamp == wanted:
                self._at = number
                return frame, whole
            if stamp is not None and stamp > wanted:
                break
        self._at = len(self._stamps)  # the decoder is somewhere else: the next read seeks
        return None, False

    def _pixels(self, frame: Any) -> Image:
        kind = frame.format.name
        if kind == "pal8":
            indices, colours = frame.to_ndarray(format="pal8")
            colours = colours[:, 1:] if colours.shape[1] == 4 else colours
            grey = bool((colours == colours[:, :1]).all())
            return np.ascontiguousarray(colours[:, 0][indices] if grey else colours[indices])
        if kind in _GREY:
            self.bits = 8
            return np.ascontiguousarray(frame.to_ndarray(format="gray"))
        depth = max(c.bits for c in frame.format.components)
        grey = kind.startswith("gray") and depth <= 16
        self.bits = depth if grey or depth <= 8 else 16  # the decoder makes colours of 9 to 16 bits fill the sixteen
        if grey:
            return _grey_levels(frame, depth)
        return np.ascontiguousarray(frame.to_ndarray(format="rgb24" if depth <= 8 else "rgb48le"))

    def close(self) -> None:
        """Give the file back."""
        with self._guard:
            self._file.close()


def _grey_levels(frame: Any, depth: int) -> Image:
    """Grey of 9 to 16 bits as it is stored: the decoder's rows, without what fills them up."""
    plane = frame.planes[0]
    order = ">u2" if frame.format.name.endswith("be") else "<u2"
    rows = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[: frame.height, : 2 * frame.width]
    return np.ascontiguousarray(rows).view(order).astype(np.uint16) & np.uint16(2**depth - 1)
