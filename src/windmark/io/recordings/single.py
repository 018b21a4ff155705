"""One picture as a recording of one frame."""

from __future__ import annotations

from windmark.io.recordings.base import Image, Recording
from windmark.io.text import Pathlike


class PictureRecording(Recording):
    """A PNG, JPEG or BMP."""

    kind = "picture"

    def __init__(self, path: Pathlike) -> None:
        super().__init__(path)
        self.count = 1
        first = self.read(0)
        self.shape, self.dtype = first.shape, first.dtype
        self.bits = 8 * self.dtype.itemsize

    def read(self, number: int) -> Image:
        """The picture."""
        from windmark.io.images import read_image

        return read_image(self.path)

    def name(self, number: int) -> str:
        """The stem of the file: there is nothing to count."""
        return self.stem
