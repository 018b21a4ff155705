"""Pictures of a deformation test from their files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from windmark import io
from windmark.pipeline.light import light_of
from windmark.tasks import deform
from windmark.tasks.deform import DeformationTest, DeformedFrame, FrameImages, Station
from windmark.tasks.deform.task import Image, Reader, wrong_size


def read(item: io.PictureFile | Image, station: Station) -> Image:
    """The grey image of a camera.

    Raises
    ------
    FileError
        When it cannot be read or has another size.
    """
    return _checked(io.read_grey(item) if isinstance(item, io.PictureFile) else item, item, station)


def read_levels(item: io.PictureFile | Image, station: Station) -> io.Levels:
    """`read`, and what must be known of its pixels, see `io.read_levels`."""
    levels = io.read_levels(item) if isinstance(item, io.PictureFile) else io.Levels(item, None, 1)
    _checked(levels.grey, item, station)
    return levels


def read_light(item: io.PictureFile | Image, station: Station) -> tuple[io.Levels, Image]:
    """`read_levels`, and the same as values are taken of it, see `light_of`."""
    levels = read_levels(item, station)
    return levels, light_of(levels.grey, levels.mixed)


def _checked(image: Image, item: io.PictureFile | Image, station: Station) -> Image:
    if (why := wrong_size(image, station)) is not None:
        raise io.FileError(str(item) if isinstance(item, io.PictureFile) else f"image of {station.name}", why)
    return image


def follow_deformation(
    frames: Iterable[FrameImages], test: DeformationTest, *, read: Reader = read,
    handed_on: dict[str, Any] | None = None,
) -> Iterator[DeformedFrame]:  # fmt: skip
    """`tasks.deform.follow_deformation` of images and files alike."""
    return deform.follow_deformation(frames, test, read=read, handed_on=handed_on)
