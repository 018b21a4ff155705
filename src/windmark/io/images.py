"""Images: PNG, JPEG, TIFF (stacks, 12-bit, float) and BMP, and frames of any recording, as the camera stored them.

Pixels come back in the sensor's own rows and columns: an orientation tag (EXIF) is *not* applied,
because the camera's interior parameters belong to the sensor, and a picture turned for the eye no
longer fits them. No colour management and no scaling either: a grey level is what the file says.
The only changes are: a palette is expanded, 1 to 4 bits per pixel are stretched to 0 ... 255, and
"white is zero" of unsigned integers is turned round, so that brighter is larger; signed ones and floats are as stored.
"""

from __future__ import annotations

import os
from collections.abc import Generator, Iterable
from contextlib import closing
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.io import _pillow
from windmark.io._tiff import open_tiff
from windmark.io.atomic import atomic_path, atomic_write, told_file
from windmark.io.errors import FileError, decoding
from windmark.io.recordings.address import FrameAddress, frame_address
from windmark.io.recordings.open import frames, recording_kind
from windmark.io.text import Pathlike
from windmark.scene.shown import ARRAY, PATH, check_kinds

Image = NDArray[Any]

_EXTENSIONS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".bmp": "BMP", ".tif": "TIFF", ".tiff": "TIFF"}


ONLY: Literal["only"] = "only"
Page = int | Literal["only"] | None


def read_image(path: Pathlike, *, page: Page = ONLY) -> Image:
    """Read an image; the content tells the format, not the extension.

    Parameters
    ----------
    path : PNG, JPEG, TIFF or BMP; or any recording that `frames` takes, with an address: ``run.cine[120]``,
        ``stack.tif[3]``, ``file.h5:/cam1/images[5]``
    page : which picture of a stack or recording, from 0; "only" for that of a file that has just one; None for all of
        them, stacked along a first axis

    Returns
    -------
    (H, W) grey or (H, W, 2 ... 4) with alpha or colours, in the file's own type: uint8, uint16 (also for
    10-, 12- and 14-bit files, values unchanged), float32 ...; see `to_grey`

    Raises
    ------
    FileError
        When the file is missing, empty, no image, damaged, cut off, has no such page, or several and none was named.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import windmark as wm
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     wm.write_image(f"{folder}/run7.png", np.full((4, 6), 1000, dtype=np.uint16))
    ...     image = wm.read_image(f"{folder}/run7.png")
    >>> image.shape, image.dtype.name, int(image[0, 0])
    ((4, 6), 'uint16', 1000)
    """
    if page not in (None, ONLY) and (not isinstance(page, int | np.integer) or page < 0):
        raise UsageError(f'read_image: page must be a number from 0, "only" or None, got {page!r}')
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
    """Number of pictures in a file: 1, but for TIFF stacks and other recordings. Errors as `read_image`."""
    address = frame_address(path)
    kind = _kind(address)
    with decoding(address.file):
        if kind == "TIFF" and address.number is None:
            with open_tiff(address.file) as stack:
                return stack.count
        if kind in ("TIFF", "picture"):
            return 1
        with frames(path) as recording:
            return len(recording)


def _pictures(path: Pathlike, page: Page) -> Generator[Image, None, None]:
    """The chosen picture, or all."""
    return (picture for picture, _ in _pictures_with_mosaic(path, page))


def with_mosaic(path: Pathlike, page: Page) -> tuple[Image, str | None]:
    """The chosen picture, and the pattern of the mosaic that it is."""
    with closing(_pictures_with_mosaic(path, page)) as pictures:
        return next(pictures)


def _pictures_with_mosaic(path: Pathlike, page: Page) -> Generator[tuple[Image, str | None], None, None]:
    address, kind = frame_address(path), _kind(frame_address(path))
    if address.number is not None:
        if page not in (None, ONLY, address.number):
            raise FileError(path, f"names a frame, and page {page} another one; expected one of them")
        page = address.number
    with decoding(address.file):
        if kind == "TIFF":
            with open_tiff(address.file) as stack:
                for number in _numbers(address, page, stack.count, "pages"):
                    yield _checked(path, stack.read(number)), None
        elif kind == "picture":
            list(_numbers(address, page, 1, "pages"))
            yield _checked(path, _pillow.decode(address.file, ("PNG", "JPEG", "BMP"))), None
        else:
            with frames(address.recording) as recording:
                for number in _numbers(address, page, len(recording), "frames"):
                    yield _checked(path, recording[number]), recording.bayer


def _kind(address: FrameAddress) -> str | None:
    """The format; a folder or pattern is none of its own."""
    if address.number is not None and not os.path.isfile(address.file):
        return None
    with decoding(address.file):
        return recording_kind(address.file)


def _numbers(address: FrameAddress, page: Page, count: int, word: str) -> range:
    """Which pictures are wanted."""
    if page is None:
        return range(count)
    if isinstance(page, str):
        if count > 1:
            raise FileError(address.recording, f"has {count} {word}: say {address.recording}[0] for the first one")
        page = 0
    if page >= count:
        raise FileError(
            address.recording,
            f"no page {page}; expected 0 to {count - 1}" if count > 1 else f"no page {page}; it has one",
        )
    return range(page, page + 1)


def _checked(path: Pathlike, values: Image) -> Image:
    """A writable array in native byte order, of a shape and type that is an image."""
    if values.ndim not in (2, 3) or (values.ndim == 3 and not 1 <= values.shape[2] <= 4) or not values.size:
        raise FileError(path, f"the shape is {values.shape}; expected (H, W) or (H, W, up to 4)")
    if values.dtype.kind not in "uif":
        raise FileError(path, f"the pixels are {values.dtype}; expected integers or floats")
    return np.require(values, dtype=values.dtype.newbyteorder("="), requirements=["C", "W", "O"])


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

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import windmark as wm
    >>> cp = np.array([[-0.5, 0.25], [np.nan, 1.0]], dtype=np.float32)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     wm.write_image(f"{folder}/cp.tif", cp, description="pressure coefficient")
    ...     again = wm.read_image(f"{folder}/cp.tif")
    >>> np.array_equal(again, cp, equal_nan=True)
    True
    """
    check_kinds("write_image", path=(path, PATH), image=(image, ARRAY))
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
        raise UsageError(f"write_images: path must end in .tif or .tiff, got {os.fspath(path)!r}")
    with atomic_path(path) as temporary:
        if not _write_tiff(temporary, (_writable("write_images", path, image) for image in images)):
            raise UsageError("write_images: images must hold at least one picture, got none")


def _writable(verb: str, path: Pathlike, image: ArrayLike) -> Image:
    values = np.asarray(image)
    kind = _EXTENSIONS.get(Path(path).suffix.lower())
    if kind is None:
        raise UsageError(f"{verb}: path must end in {', '.join(_EXTENSIONS)}, got {os.fspath(path)!r}")
    if values.ndim not in (2, 3) or (values.ndim == 3 and values.shape[2] not in (3, 4)) or not values.size:
        raise UsageError(f"{verb}: image must be (H, W) or (H, W, 3 or 4), got {values.shape}")
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
        raise UsageError(f"{verb}: {kind} cannot hold image {what}; write a .tif, or scale it to uint8 or uint16 first")
    return values


def _write_tiff(path: Path, pictures: Iterable[Image], description: str = "") -> int:
    import tifffile

    count = 0
    with told_file(path) as stream, tifffile.TiffWriter(stream) as writer:
        for values in pictures:
            photometric = "rgb" if values.ndim == 3 else "minisblack"
            writer.write(
                np.ascontiguousarray(values), photometric=photometric, metadata=None, software="windmark",
                description=description.encode() or None,
            )  # fmt: skip
            count += 1
    return count
