"""The rows of a CSV text and the lines they start on."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from itertools import chain

from windmark.io.errors import FileError
from windmark.io.text import Pathlike

BETWEEN = "\0"
"""No cell holds it: what puts cells together may put it between them."""
HINT = re.compile(r'"?sep=.?"?', re.IGNORECASE)
"""A first line that tells spreadsheets the separator."""
_LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+")


def rows_of(path: Pathlike, text: str, separator: str | None) -> Iterator[tuple[int, list[str]]]:
    """Line number (1-based) and stripped cells of every row; the bare line where ``separator`` is None.

    Blank lines, rows of empty cells, lines that start with ``#`` and a first line ``sep=;`` (a hint to spreadsheets)
    are left out.

    Raises
    ------
    FileError
        For quotes that are not those of CSV, and zero bytes; names the line.
    """
    numbered = _Counted(text)
    for line in numbered:
        start = numbered.line
        if not line.strip() or line.lstrip().startswith("#") or (start == 1 and HINT.fullmatch(line.strip())):
            continue
        if separator is None:
            yield start, [line]
            continue
        row = line.split(separator) if '"' not in line else _quoted_row(path, line, numbered, separator)
        row = [cell.strip() for cell in row]
        if BETWEEN in line:
            raise FileError(path, "holds a zero byte; expected text", start)
        if any(row):
            yield start, row


def _quoted_row(path: Pathlike, line: str, numbered: _Counted, separator: str) -> list[str]:
    """A row with quotes: one reader for it alone takes further lines only inside a quoted cell, so a '#' there is no
    comment.
    """
    start = numbered.line
    try:
        row = next(csv.reader(chain([line], numbered), delimiter=separator, strict=True, skipinitialspace=True))
    except (csv.Error, StopIteration) as error:
        raise FileError(path, f"not a CSV row: {error}", start) from error
    if any(BETWEEN in cell for cell in row):
        raise FileError(path, "holds a zero byte; expected text", start)
    return row


class _Counted:
    """The lines of a text, ends kept, with the number of the last line given out."""

    def __init__(self, text: str) -> None:
        self.line = 0
        self._lines = _LINE.finditer(text)

    def __iter__(self) -> _Counted:
        return self

    def __next__(self) -> str:
        line = next(self._lines)[0]
        self.line += 1
        return line
