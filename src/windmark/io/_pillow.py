"""Pictures decoded by Pillow: PNG, JPEG, BMP, and the TIFF compressions that tifffile leaves to others."""

from __future__ import annotations

import io
import os
import threading
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from windmark.io.errors import FileError
from windmark.io.text import Pathlike

if TYPE_CHECKING:
    from PIL.Image import Image

_GUARD = threading.Lock()

ORIENTATION = 0x0112


def decode(path: Pathlike, formats: tuple[str, ...], frame: int = 0, content: IO[bytes] | None = None) -> NDArray[Any]:
    """The pixels of a picture as they are stored: no turning, no colour management, palettes expanded.

    ``content``, where given, is read instead of the file ``path``.

    Raises
    ------
    FileError
        When the picture is damaged, or Pillow would cut 16-bit colours to 8 bits.
    """
    with open_picture(path if content is None else content, formats) as picture:
        picture.seek(frame)
        check_plausible(path, picture.size)
        if picture.format == "TIFF":  # Pillow turns a TIFF by its metadata while it loads
            picture.getexif()[ORIENTATION] = 1
        if picture.format == "PNG" and _is_deep_colour(path):
            raise FileError(path, "a PNG with 16 bits per colour; expected 8 bits, or 16-bit grey (or a TIFF)")
        return _array(picture)


def open_picture(source: Pathlike | IO[bytes], formats: tuple[str, ...]) -> Image:
    """Open without Pillow's limit on the number of pixels: cameras of 100 Mpx are no attack.

    The limit is a global of Pillow, tested only while opening; it is lifted for that moment, one thread at a time.
    """
    from PIL import Image

    with _GUARD:
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            return Image.open(source, formats=formats)
        finally:
            Image.MAX_IMAGE_PIXELS = limit


def check_plausible(path: Pathlike, size_px: tuple[int, int]) -> None:
    """Refuse a size that no compression can have put into so small a file, before the memory is filled with nothing.

    Deflate reaches 1032 : 1, which is 8256 pixels of one bit per byte; the other compressions stay below.
    """
    width, height = size_px
    if width < 1 or height < 1:
        raise FileError(path, f"damaged or cut off: {width} x {height} pixels")
    if width * height > 10_000 * os.path.getsize(path) + 1_000_000:
        raise FileError(path, f"damaged or cut off: {width} x {height} pixels cannot come from a file this small")


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


def _is_deep_colour(path: Pathlike) -> bool:
    """Whether the PNG header says 16 bits and more than one channel (IHDR: bit depth, colour type at 24, 25)."""
    with open(path, "rb") as stream:
        head = stream.read(26)
    return len(head) == 26 and head[24] == 16 and head[25] != 0
