"""Folders and patterns of numbered pictures."""

from __future__ import annotations

import os
import re
from glob import escape, glob, has_magic
from itertools import pairwise
from pathlib import Path

from windmark.io.errors import FileError, decoding
from windmark.io.recordings.base import Image, Recording
from windmark.io.text import Pathlike

PICTURES = (".tif", ".tiff", ".png", ".jpg", ".jpeg", ".bmp")
_NUMBER = re.compile(r"(\d+)")
_LAST_NUMBER = re.compile(r"(\d+)\D*$")


class FolderRecording(Recording):
    """Pictures in files of their own, in natural order: ``run9`` comes before ``run10``.

    A frame keeps the stem of its file as its name.
    """

    kind = "numbered pictures"

    def __init__(self, path: Pathlike) -> None:
        super().__init__(path)
        self.files = picture_files(path)
        self.count = len(self.files)
        stems = [f.stem for f in self.files]
        self._names = stems if len(set(stems)) == len(stems) else [f"{f.parent.name}-{f.stem}" for f in self.files]
        first = self.read(0)
        self.shape, self.dtype = first.shape, first.dtype
        self.bits = 8 * self.dtype.itemsize
        self.noted(_gaps(stems))

    def read(self, number: int) -> Image:
        """One picture."""
        from windmark.io.images import read_image

        return read_image(self.files[number])

    def name(self, number: int) -> str:
        """The stem of the picture's file."""
        return self._names[number]


def picture_files(path: Pathlike) -> list[Path]:
    """The pictures of a folder, or that a pattern matches, in natural order.

    Raises
    ------
    FileError
        When there is none, or a folder holds several kinds.
    """
    text = os.fspath(path)
    with decoding(path):
        if os.path.isdir(text):
            files = [Path(e.path) for e in os.scandir(text) if e.name[0] != "." and is_picture(e.name) and e.is_file()]
            kinds = sorted({f.suffix.lower().replace("jpeg", "jpg").replace("tiff", "tif") for f in files})
            if len(kinds) > 1:
                some = os.path.join(text, f"*{kinds[0]}")
                raise FileError(path, f"a folder with {' and '.join(kinds)} pictures; say which, as in {some}")
            if not files:
                raise FileError(path, f"a folder without pictures; expected {', '.join(PICTURES)}")
        else:
            parent, name = os.path.split(text)
            pattern = os.path.join(escape(parent), name) if os.path.isdir(parent) else text  # a folder "run [2]"
            files = [Path(p) for p in glob(pattern, recursive=True) if os.path.isfile(p)]
            if not files:
                raise FileError(path, "no file matches this pattern")
            if (odd := next((f for f in files if not is_picture(f.name, ".csv")), None)) is not None:
                raise FileError(odd, f"is no picture; expected {', '.join(PICTURES)} or .csv, as {text} matches it")
    return sorted(files, key=lambda f: natural(str(f)))


def natural(text: str) -> list[tuple[int, int, str]]:
    """Key that sorts numbers in names by their value."""
    return [(0, int(p), p) if p.isdecimal() else (1, 0, p.lower()) for p in _NUMBER.split(text) if p]


def is_pattern(path: Pathlike) -> bool:
    """Whether a name is a pattern of names; a file of that very name is none."""
    return has_magic(os.fspath(path)) and not os.path.exists(path)


def is_picture(name: str, *more: str) -> bool:
    """Whether a name is that of a picture, or has one of some more extensions."""
    return name.lower().endswith(PICTURES + more)


def _gaps(stems: list[str]) -> str:
    """Numbers that are missing between the first and the last, in words."""
    found = [_LAST_NUMBER.search(s) for s in stems]
    numbers = sorted({int(m[1]) for m in found if m is not None})
    if len(numbers) != len(stems) or len(numbers) < 2:
        return ""
    gaps = [(a + 1, b - 1) for a, b in pairwise(numbers) if b > a + 1]
    if not gaps or len(gaps) > len(numbers) // 2:  # every second picture, every tenth: that is how they were saved
        return ""
    some = ", ".join(str(a) if a == b else f"{a} to {b}" for a, b in gaps[:3])
    return f"numbers {some}{' and more' if len(gaps) > 3 else ''} are missing in the names"
