"""Parts that fail alone: a drawing, or a picture that cannot be read, must never cost the numbers of the others."""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable, Iterator, Sequence, Sized
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from windmark.io import FileError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@contextmanager
def alone(what: str, failed: list[str]) -> Iterator[None]:
    """A part that fails alone: whatever goes wrong in it is said in ``failed``, with its place in the program."""
    try:
        yield
    except Exception as error:
        at = traceback.extract_tb(error.__traceback__)[-1]
        said = " ".join(str(error).split())[:300]
        failed.append(f"{what}: {type(error).__name__}: {said} ({os.path.basename(at.filename)}:{at.lineno})")


def png_alone(what: str, draw: Callable[[], Figure], failed: list[str], dpi: int = 110) -> bytes | None:
    """A picture that fails alone, as PNG; None where it cannot be drawn."""
    from windmark.app.pictures import png

    with alone(what, failed):
        return png(draw(), dpi)
    return None


def write_png(path: Path, draw: Callable[[], Figure], failed: list[str], dpi: int = 110) -> None:
    """A picture that fails alone, as a file of the result."""
    if (drawn := png_alone(path.name, draw, failed, dpi)) is not None:
        path.write_bytes(drawn)


class Unreadable:
    """Images that cannot be read, each by itself: the others go on without them."""

    def __init__(self) -> None:
        self.why: dict[str, str] = {}
        self._first: FileError | None = None

    @contextmanager
    def unless_readable(self, name: str, place: Path | None = None) -> Iterator[None]:
        """The work on an image; where it cannot be read, that is noted. A fault of writing into ``place`` is raised."""
        try:
            yield
        except FileError as error:
            if place is not None and error.path.is_relative_to(place):
                raise
            self.why[name] = str(error)
            self._first = self._first or error

    def refuse_unless(self, found: Sized) -> None:
        """Raise what was wrong with the first one where nothing is left."""
        if self._first is not None and not len(found):
            raise self._first

    def lines(self) -> list[str]:
        """What is left out, as lines of the answer."""
        return [f"left out: {name}: {why}" for name, why in self.why.items()]


def not_drawn(failed: Sequence[str]) -> list[str]:
    """What failed, as lines of the answer."""
    return [f"not drawn: {said}" for said in failed]
