"""Pictures decoded by Pillow: PNG, JPEG, BMP, and the TIFF compressions that tifffile leaves to others."""

from __future__ import annotations

import io
import os
import threading
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from windmark.io.bounded import BoundedFile, check_unpacked
from windmark.io.errors import FileError
from windmark.io.text import Pathlike

if TYPE_CHECKING:
    from PIL.Image import Image

_GUARD = threading.Lock()

ORIENTATION = 0x0112
_BYTES = {"I": 4, "F": 4, "I;16": 2, "I;16B": 2, "P": 3}
"""Bytes of a band's pixel, as they are handed on."""


def decode(path: Pathlike, formats: tuple[str, ...], frame: int = 0, content: IO[bytes] | None = None) -> NDArray[Any]:
    """The pixels of a picture as they are stored: no turning, no colour management, palettes expanded.

    ``content``, where given, is read instead of the file ``path``.

    Raises
    ------
    FileError
        When the picture is damaged.
    """
    with open_picture(path if content is None else content, formats) as picture:
        picture.seek(frame)
        check_plausible(path, picture.size, len(picture.getbands()) * _BYTES.get(picture.mode, 1))
        if picture.format == "TIFF":  # Pillow turns a TIFF by its metadata while it loads
            picture.getexif()[ORIENTATION] = 1
        deep = picture.format == "PNG" and _is_deep_colour(path)
        if not deep:
            return _array(picture)
    return _deep_colours(path)


def open_picture(source: Pathlike | IO[bytes], formats: tuple[str, ...]) -> Image:
    """Open without Pillow's limit on the number of pixels: cameras of 100 Mpx are no attack.

    The limit is a global of Pillow, tested only while opening; it is lifted for that moment, one thread at a time.
    """
    from PIL import Image

    with _GUARD:
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            if not isinstance(source, str | os.PathLike):
                return Image.open(source, formats=formats)
            stream = BoundedFile(source)  # chunks of damaged files may name any size
            try:
                picture = Image.open(stream, formats=formats)
            except BaseException:
                stream.close()
                raise
            picture._exclusive_fp = True
            return picture
        finally:
            Image.MAX_IMAGE_PIXELS = limit


def check_plausible(path: Pathlike, size_px: tuple[int, int], pixel_bytes: int) -> None:
    """Refuse a size that no compression can have put into so small a file, before the memory is filled with nothing.

    Deflate reaches 1032 : 1, which is 8256 pixels of one bit per byte; the other compressions stay below. What takes
    much memory is held to `check_unpacked`.
    """
    width, height = size_px
    if width < 1 or height < 1:
        raise FileError(path, f"damaged or cut off: {width} x {height} pixels")
    if width * height > 10_000 * os.path.getsize(path) + 1_000_000:
        raise FileError(path, f"damaged or cut off: {width} x {height} pixels cannot come from a file this small")
    check_unpacked(path, width * height * pixel_bytes, os.path.getsize(path))


def transparent_pixels(path: Pathlike, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Pixels (H, W) that a PNG's palette, or its one transparent colour, makes invisible; none in other pictures."""
    with open(path, "rb") as stream:
        if stream.read(8) != b"\x89PNG\r\n\x1a\n":
            return np.zeros(shape, dtype=bool)
    with open_picture(path, ("PNG",)) as picture:
        clear: Any = picture.info.get("transparency")
        if clear is None or picture.mode in ("LA", "RGBA"):
            return np.zeros(shape, dtype=bool)
        if picture.mode.startswith("I"):  # 16 bits, which Pillow would cut to 8
            return np.array(picture) == clear
        return np.array(picture.convert("RGBA"))[..., 3] == 0


def encode(kind: str, values: NDArray[Any]) -> bytes:
    """A picture as PNG, JPEG or BMP."""
    from PIL import Image

    content = io.BytesIO()
    options = {"quality": 95, "subsampling": 0} if kind == "JPEG" else {}
    Image.fromarray(np.ascontiguousarray(values)).save(content, format=kind, **options)
    return content.getvalue()


def _array(picture: Image) -> NDArray[Any]:
    if picture.mode in ("P", "PA"):
        return _grey_if_grey(np.array(picture.convert("RGBA" if "transparency" in picture.info else "RGB")))
    if picture.mode == "1":
        return np.array(picture).astype(np.uint8) * np.uint8(255)
    if picture.mode in ("CMYK", "YCbCr", "LAB", "HSV", "RGBX"):
        return np.array(picture.convert("RGB"))
    values = np.array(picture)
    if picture.mode == "I" and picture.format == "PNG":  # 16-bit grey, in older versions of Pillow
        values = values.astype(np.uint16)
    return values


def _grey_if_grey(colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A palette of greys is how many programs store a grey picture."""
    first = colours[..., 0]
    if all((colours[..., k] == first).all() for k in (1, 2)):
        return np.ascontiguousarray(first)
    return colours


def _deep_colours(path: Pathlike) -> NDArray[np.uint16]:
    """A PNG with 16 bits per channel, of which Pillow gives the upper 8: decoded twice, for each half of the bits.

    Its decoder unfilters bytes whatever they mean; the raw mode says which of them become pixels.
    """
    with open(path, "rb") as stream:
        kind = stream.read(26)[25]
    if kind == 4:  # grey with alpha: four bytes, as RGBA has
        both = _decoded_as(path, "RGBA", "RGBA")
        return both[..., 0::2] << np.uint16(8) | both[..., 1::2]
    if kind not in (2, 6):
        raise FileError(path, f"damaged: a PNG of 16 bits and colour type {kind}")
    mode = "RGB" if kind == 2 else "RGBA"
    return _decoded_as(path, mode, f"{mode};16B") << np.uint16(8) | _decoded_as(path, mode, f"{mode};16L")


def _decoded_as(path: Pathlike, mode: str, raw: str) -> NDArray[np.uint16]:
    """The pixels with the raw mode that is asked for, instead of the one that Pillow chose."""
    with open_picture(path, ("PNG",)) as opened:
        picture: Any = opened
        picture._mode = mode
        picture.tile = [(*picture.tile[0][:3], raw)]
        return np.array(picture).astype(np.uint16)


def _is_deep_colour(path: Pathlike) -> bool:
    """Whether the PNG header says 16 bits and more than one channel (IHDR: bit depth, colour type at 24, 25)."""
    with open(path, "rb") as stream:
        head = stream.read(26)
    return len(head) == 26 and head[24] == 16 and head[25] != 0
