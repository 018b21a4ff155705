"""Pictures of a deformation test from their files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from windmark import io
from windmark.tasks import deform
from windmark.tasks.deform import DeformationTest, DeformedFrame, FrameImages, Station
from windmark.tasks.deform.task import Image, wrong_size


def read(item: io.PictureFile | Image, station: Station) -> Image:
    """The grey image of a camera.

    Raises
    ------
    FileError
        When it cannot be read or has another size.
    """
    image = io.read_grey(item) if isinstance(item, io.PictureFile) else item
    if (why := wrong_size(image, station)) is not None:
        raise io.FileError(str(item) if isinstance(item, io.PictureFile) else f"image of {station.name}", why)
    return image


def follow_deformation(
    frames: Iterable[FrameImages], test: DeformationTest, *, handed_on: dict[str, Any] | None = None
) -> Iterator[DeformedFrame]:
    """`tasks.deform.follow_deformation` of images and files alike."""
    return deform.follow_deformation(frames, test, read=read, handed_on=handed_on)
