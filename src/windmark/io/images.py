"""Images: PNG, JPEG, TIFF (stacks, 12-bit, float) and BMP, as the camera stored them.

Pixels come back in the sensor's own rows and columns: an orientation tag (EXIF) is *not* applied,
because the camera's interior parameters belong to the sensor, and a picture turned for the eye no
longer fits them. No colour management and no scaling either: a grey level is what the file says.
The only changes are: a palette is expanded, 1 to 4 bits per pixel are stretched to 0 ... 255, and
"white is zero" is turned round, so that brighter is always larger.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Generator, Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.io import _pillow
from windmark.io._tiff import open_tiff
from windmark.io.atomic import atomic_path, atomic_write
from windmark.io.colour import check_channel, check_mosaic, from_mosaic, to_grey
from windmark.io.errors import FileError, reading
from windmark.io.text import Pathlike

Image = NDArray[Any]

_MAGIC = {
    b"\x89PNG\r\n\x1a\n": "PNG", b"\xff\xd8\xff": "JPEG", b"BM": "BMP",
    b"II*\0": "TIFF", b"MM\0*": "TIFF", b"II+\0": "TIFF", b"MM\0+": "TIFF",
}  # fmt: skip
_EXTENSIONS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".bmp": "BMP", ".tif": "TIFF", ".tiff": "TIFF"}


def read_image(path: Pathlike, *, page: int | None = 0) -> Image:
    """Read an image; the content tells the format, not the extension.

    Parameters
    ----------
    path : PNG, JPEG, TIFF or BMP
    page : which picture of a TIFF stack, from 0; None for all of them, stacked along a first axis

    Returns
    -------
    (H, W) grey or (H, W, 2 ... 4) with alpha or colours, in the file's own type: uint8, uint16 (also for
    10-, 12- and 14-bit files, values unchanged), float32 ...; see `to_grey`

    Raises
    ------
    FileError
        When the file is missing, empty, no image, damaged, cut off, or has no such page.
    """
    if page is not None and (not isinstance(page, int | np.integer) or page < 0):
        raise ValueError(f"read_image: page must be a number from 0 or None, got {page!r}")
    if page is not None:
        with closing(_pictures(path, page)) as pictures:
            return next(pictures)
    stack = list(read_images(path))
    shapes = sorted({picture.shape for picture in stack})
    if len(shapes) > 1:
        raise FileError(path, f"the pages differ in shape: {shapes}; read them one by one")
    return np.stack(stack)


def read_images(path: Pathlike) -> Generator[Image, None, None]:
    """All pictures of a file, one after the other; the memory holds one at a time. Errors as `read_image`."""
    return _pictures(path, None)


def page_count(path: Pathlike) -> int:
    """Number of pictures in a file: 1, but for TIFF stacks. Errors as `read_image`."""
    with _decoding(path):
        if _format(path) != "TIFF":
            return 1
        with open_tiff(path) as stack:
            return stack.count


def read_grey(path: Pathlike, *, page: int = 0, channel: str = "grey", bayer: str | None = None) -> Image:
    """Read an image as one grey level per pixel: (H, W), linear in what the file says.

    Parameters
    ----------
    path, page : see `read_image`
    channel : "grey", "red", "green" or "blue", see `to_grey`
    bayer : pattern of a raw colour mosaic, "RGGB" and its like, see `from_mosaic`; None where the file is none

    Raises
    ------
    FileError
        As `read_image`; also where the file has not the colours that are asked for.
    """
    check_channel(channel)
    if bayer is not None:
        check_mosaic(bayer)
    picture = read_image(path, page=page)
    if bayer is not None and (picture.ndim != 2 or min(picture.shape) < 2):
        raise FileError(path, f"the shape is {picture.shape}; expected (H, W), the mosaic of a colour sensor, as bayer")
    if channel != "grey" and bayer is None and (picture.ndim == 2 or picture.shape[2] < 3):
        raise FileError(path, f"a picture without colours; expected colours to take {channel} from")
    return to_grey(picture, channel=channel) if bayer is None else from_mosaic(picture, bayer, channel=channel)


def _pictures(path: Pathlike, page: int | None) -> Generator[Image, None, None]:
    """The chosen picture, or all."""
    with _decoding(path):
        kind = _format(path)
        if kind == "TIFF":
            with open_tiff(path) as stack:
                _check_page(path, page, stack.count)
                for number in range(stack.count) if page is None else (page,):
                    yield _checked(path, stack.read(number))
        else:
            _check_page(path, page, 1)
            yield _checked(path, _pillow.decode(path, (kind,)))


def _check_page(path: Pathlike, page: int | None, count: int) -> None:
    if page is not None and page >= count:
        raise FileError(
            path, f"no page {page}; expected 0 to {count - 1}" if count > 1 else f"no page {page}; it has one"
        )


def _checked(path: Pathlike, values: Image) -> Image:
    """A writable array in native byte order, of a shape and type that is an image."""
    if values.ndim not in (2, 3) or (values.ndim == 3 and not 1 <= values.shape[2] <= 4) or not values.size:
        raise FileError(path, f"the shape is {values.shape}; expected (H, W) or (H, W, up to 4)")
    if values.dtype.kind not in "uif":
        raise FileError(path, f"the pixels are {values.dtype}; expected integers or floats")
    return np.require(values, dtype=values.dtype.newbyteorder("="), requirements=["C", "W", "O"])


def _format(path: Pathlike) -> str:
    with open(path, "rb") as stream:
        head = stream.read(8)
    if not head:
        raise FileError(path, "the file is empty; expected an image")
    for magic, kind in _MAGIC.items():
        if head.startswith(magic):
            return kind
    raise FileError(path, "not an image that windmark reads; expected PNG, JPEG, TIFF or BMP")


@contextmanager
def _decoding(path: Pathlike) -> Iterator[None]:
    """Whatever a decoder raises on a damaged file becomes `FileError`."""
    with reading(path):
        try:
            yield
        except FileError:
            raise
        except MemoryError as error:
            raise FileError(path, "damaged, or too large for the memory") from error
        except Exception as error:  # decoders raise nearly anything
            if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):
                raise  # the operating system's own refusal; EINVAL is a place before the file's start
            raise FileError(path, f"damaged or cut off: {error or type(error).__name__}") from error


# --- writing ---------------------------------------------------------------------------------


def write_image(path: Pathlike, image: ArrayLike, *, description: str = "") -> None:
    """Write an image, whole or not at all; the extension tells the format.

    Parameters
    ----------
    path : ``.png`` (uint8, uint16 grey), ``.tif``/``.tiff`` (any integers and floats, uncompressed),
        ``.jpg`` (uint8, quality 95, lossy) or ``.bmp`` (uint8)
    image : (H, W) or (H, W, 3 or 4); booleans (masks) become 0 and 255
    description : what the values are, kept in a TIFF's own tag; other formats have no place for it

    Raises
    ------
    ValueError
        For a shape or type that the format cannot hold.
    FileError
        When the file cannot be written.
    """
    values = _writable("write_image", path, image)
    kind = _EXTENSIONS[Path(path).suffix.lower()]
    if kind == "TIFF":
        with atomic_path(path) as temporary:
            _write_tiff(temporary, [values], description)
    else:
        # Pillow, writing to a file itself, does not notice that a full disk took only a part.
        content = _pillow.encode(kind, values)
        with atomic_write(path, "wb") as stream:
            stream.write(content)


def write_images(path: Pathlike, images: Iterable[ArrayLike]) -> None:
    """Write pictures as one TIFF stack, whole or not at all; the memory holds one at a time.

    Raises
    ------
    ValueError
        When there is none, or path is no TIFF.
    FileError
        When the file cannot be written.
    """
    if _EXTENSIONS.get(Path(path).suffix.lower()) != "TIFF":
        raise ValueError(f"write_images: path must end in .tif or .tiff, got {os.fspath(path)!r}")
    with atomic_path(path) as temporary:
        if not _write_tiff(temporary, (_writable("write_images", path, image) for image in images)):
            raise ValueError("write_images: images must hold at least one picture, got none")


def _writable(verb: str, path: Pathlike, image: ArrayLike) -> Image:
    values = np.asarray(image)
    kind = _EXTENSIONS.get(Path(path).suffix.lower())
    if kind is None:
        raise ValueError(f"{verb}: path must end in {', '.join(_EXTENSIONS)}, got {os.fspath(path)!r}")
    if values.ndim not in (2, 3) or (values.ndim == 3 and values.shape[2] not in (3, 4)) or not values.size:
        raise ValueError(f"{verb}: image must be (H, W) or (H, W, 3 or 4), got {values.shape}")
    values = values.astype(values.dtype.newbyteorder("="), copy=False)
    if values.dtype == bool:
        values = values.astype(np.uint8) * np.uint8(255)
    if kind == "TIFF":
        fits = values.dtype.kind in "uif"
    else:
        fits = values.dtype == np.uint8 or (kind == "PNG" and values.dtype == np.uint16 and values.ndim == 2)
    if kind == "JPEG" and values.ndim == 3:
        fits = fits and values.shape[2] == 3
    if not fits:
        what = f"{values.dtype} {values.shape}"
        raise ValueError(f"{verb}: {kind} cannot hold image {what}; write a .tif, or scale it to uint8 or uint16 first")
    return values


def _write_tiff(path: Path, pictures: Iterable[Image], description: str = "") -> int:
    import tifffile

    count = 0
    with tifffile.TiffWriter(path) as writer:
        for values in pictures:
            photometric = "rgb" if values.ndim == 3 else "minisblack"
            writer.write(
                np.ascontiguousarray(values), photometric=photometric, metadata=None, software="windmark",
                description=description.encode() or None,
            )  # fmt: skip
            count += 1
    return count
