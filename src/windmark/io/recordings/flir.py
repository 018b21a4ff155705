"""Tables of temperatures or grey levels, as infrared programs export them: one number per pixel, rows as lines.

Semicolon, tab or comma between the cells, a decimal point or comma, lines of words before or between the pictures.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark.io.errors import FileError, reading
from windmark.io.recordings.base import Image, Recording
from windmark.io.text import Pathlike

_LEAST = 4
"""Fewer numbers in a line than this are parameters, not pixels."""
_CELL = re.compile(r"\s*[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?\s*|\s*-?nan\s*", re.IGNORECASE)


class TableRecording(Recording):
    """One picture, or several of one size below each other."""

    kind = "table of pixels"

    def __init__(self, path: Pathlike) -> None:
        super().__init__(path)
        self._pictures = read_pixel_tables(path)
        self.count, self.shape, self.dtype = len(self._pictures), self._pictures[0].shape, np.dtype(np.float64)
        self.bits = 64
        self.noted("numbers of a table: temperatures or levels, as exported")

    def read(self, number: int) -> Image:
        """One picture."""
        return self._pictures[number].copy()

    def name(self, number: int) -> str:
        """The stem of the file where there is nothing to count."""
        return self.stem if self.count == 1 else super().name(number)


def read_pixel_tables(path: Pathlike) -> list[NDArray[np.float64]]:
    """The pictures of a table: runs of lines with the same number of numbers, all of one size.

    Raises
    ------
    FileError
        When there is none, when sizes differ, or when the file has columns with names, as tables of markers have.
    """
    with reading(path):
        content = Path(path).read_bytes()
    text = content.decode("utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig", "replace")
    lines = text.splitlines()
    _refuse_named_columns(path, lines)
    best: list[NDArray[np.float64]] = []
    for delimiter in (";", "\t", ","):
        if delimiter in text:
            found = _blocks(lines, delimiter)
            best = max(best, found, key=lambda blocks: sum(b.size for b in blocks))
    if not best:
        raise FileError(path, "no picture in it; expected rows of numbers with ;, tab or comma between them")
    shapes = sorted({b.shape for b in best})
    if len(shapes) > 1:
        raise FileError(path, f"rows of different lengths: pictures of {shapes}; expected one size")
    return best


def _refuse_named_columns(path: Pathlike, lines: list[str]) -> None:
    """A first line of words, as many as the next line has cells, names columns."""
    first, second = ([*[line for line in lines if line.strip()], "", ""])[:2]
    for delimiter in (";", "\t", ","):
        names = [c.strip() for c in first.split(delimiter)]
        if len(names) > 1 and len(names) == len(second.split(delimiter)) and not any(_CELL.fullmatch(n) for n in names):
            raise FileError(path, "a table with named columns; expected rows of pixels")


def _blocks(lines: list[str], delimiter: str) -> list[NDArray[np.float64]]:
    """Runs of at least two lines with equally many numbers."""
    blocks: list[NDArray[np.float64]] = []
    rows: list[list[float]] = []
    for line in [*lines, ""]:
        row = _row(line, delimiter)
        if rows and len(row) != len(rows[0]):
            if len(rows) > 1:
                blocks.append(np.array(rows))
            rows = []
        if len(row) >= _LEAST:
            rows.append(row)
    return blocks


def _row(line: str, delimiter: str) -> list[float]:
    """The numbers of a line; none where it holds words. A word in the first cell is a row's name."""
    cells = line.strip().split(delimiter)
    while cells and not cells[-1].strip():
        cells.pop()
    if cells and not _CELL.fullmatch(cells[0]):
        cells = cells[1:]
    if len(cells) < _LEAST or not all(_CELL.fullmatch(c) for c in cells):
        return []
    return [float(c.replace(",", ".")) for c in cells]
