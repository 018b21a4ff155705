"""Tables of places from elsewhere: columns without a header, or with one of another program; the user names them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from windmark.errors import UsageError
from windmark.io.csvtable import table_of
from windmark.io.errors import FileError
from windmark.io.markers import COLUMNS, XYZ, marker_set_of
from windmark.io.text import Pathlike, read_text
from windmark.scene import MarkerSet

LEFT_OUT = "-"
"""In place of a column's name: nobody wants it."""
_COMMENTS = ("#", "!", "%", "//")
_STYLES: tuple[tuple[str | None, str], ...] = (
    (";", "."), ("\t", "."), (",", "."), (None, "."), (";", ","), ("\t", ","), (None, ","),
)  # fmt: skip
"""Separator (None: white space) and decimal mark."""
_TELLING = 500
"""Lines from which the style is told, but where none of them is a row."""
_WORDS = ("name", "volume", "role")


def read_listed_markers(path: Pathlike, columns: Sequence[str]) -> tuple[MarkerSet, list[str]]:
    r"""Markers of a table of numbers whose columns the user names: a list of a photogrammetry program, a spreadsheet.

    Cells are separated by semicolon, tab, comma or white space, numbers have a decimal point, or all of them a decimal
    comma: whichever makes rows of most lines. Blank lines and those that begin with #, !, % or // are left out, and so
    are lines before the first row, which have no coordinates. A name of several words wants another separator than
    blanks.

    Parameters
    ----------
    path : the file
    columns : one name for each column, of `markers.COLUMNS` or "-" for one that is left out; without ``name`` markers
        are named by their row: 1, 2, ...

    Returns
    -------
    The markers with all roles, in the file's order and unit, and the lines before the first row that are left out.

    Raises
    ------
    UsageError
        For columns that are unknown, missing or named twice.
    FileError
        Names the line that is no row, or whose cell is no number; and what is there where no line is a row.

    Examples
    --------
    >>> import tempfile
    >>> from windmark import io
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with open(f"{folder}/targets.txt", "w") as file:
    ...         _ = file.write("point  X  Y  Z  rays\nT1  0,5  0  2,25  7\nT2  1,5  0  2,5  9\n")
    ...     markers, left = io.read_listed_markers(f"{folder}/targets.txt", ("name", "x", "y", "z", "-"))
    >>> markers.name.tolist(), markers.xyz.tolist(), left
    (['T1', 'T2'], [[0.5, 0.0, 2.25], [1.5, 0.0, 2.5]], ['point  X  Y  Z  rays'])
    """
    wanted = _checked(columns)
    lines = [(k, line.strip()) for k, line in enumerate(read_text(path).splitlines(), 1)]
    lines = [(k, line) for k, line in lines if line and not line.startswith(_COMMENTS)]
    separator, mark = _style([line for _, line in lines], wanted)
    rows = [_row(line, separator, mark, wanted) for _, line in lines]
    first = next((n for n, row in enumerate(rows) if row is not None), None)
    if first is None:
        line, text = lines[0] if lines else (None, "")
        raise FileError(path, f"no line has {_listed(wanted)}; this one is {text[:60]!r}", line)
    begin = next((n for n, (_, text) in enumerate(lines) if _may_be(text, separator, wanted)), first)
    for (line, text), row in zip(lines[begin:], rows[begin:], strict=True):
        if row is None:
            raise FileError(path, f"expected {_listed(wanted)}, got {text[:60]!r}", line)
    kept = [k for k, name in enumerate(wanted) if name != LEFT_OUT]
    cells = [[row[k] for k in kept] for row in rows[first:] if row is not None]
    names = [wanted[k] for k in kept]
    if "name" not in names:
        names, cells = ["name", *names], [[str(n), *row] for n, row in enumerate(cells, 1)]
    table = table_of(path, tuple(names), cells, [line for line, _ in lines[first:]])
    return replace(marker_set_of(table), length_unit=""), [text for _, text in lines[:first]]


def _style(lines: list[str], columns: tuple[str, ...]) -> tuple[str | None, str]:
    """The separator and decimal mark that make rows of most lines; of the first ones, where these tell it."""
    for some in (lines[:_TELLING], lines):
        fitting = [sum(_row(line, *style, columns) is not None for line in some) for style in _STYLES]
        if max(fitting):
            break
    return _STYLES[fitting.index(max(fitting))]


def _checked(columns: Sequence[str]) -> tuple[str, ...]:
    names = tuple(name.strip().lower() for name in columns)
    known = f"expected names among {','.join(COLUMNS)}, or {LEFT_OUT} for a column that is left out"
    for name in names:
        if name not in (*COLUMNS, LEFT_OUT):
            raise UsageError(f"columns: {name!r} is no column of a table of markers; {known}")
        if name != LEFT_OUT and names.count(name) > 1:
            raise UsageError(f"columns: {name} is named more than once")
    missing = [name for name in XYZ if name not in names]
    if missing:
        raise UsageError(f"columns: {', '.join(missing)} is not named; {known}")
    return names


def _row(line: str, separator: str | None, mark: str, columns: tuple[str, ...]) -> list[str] | None:
    """The cells of a line, numbers with a decimal point; None where they are not those of ``columns``."""
    cells = [cell.strip().strip('"').strip() for cell in line.split(separator)]
    while len(cells) > len(columns) and not cells[-1]:
        cells.pop()
    if len(cells) != len(columns):
        return None
    for k, name in enumerate(columns):
        if name in _WORDS or name == LEFT_OUT:
            continue
        if mark == ",":  # of all numbers or of none: 1,234 beside 1.5 is a thousand
            cells[k] = "." if "." in cells[k] else cells[k].replace(",", ".")
        if not _is_number(cells[k]) and not (name not in XYZ and cells[k].lower() in ("", "nan")):
            return None
    return cells


def _may_be(line: str, separator: str | None, columns: tuple[str, ...]) -> bool:
    """Whether a line that is no row may be meant as one: as many cells, numbers among its coordinates; or more cells,
    as a name of several words has, and a number in each coordinate, counted from the line's ends.
    """
    cells = [cell.strip() for cell in line.split(separator)]
    more, among = len(cells) - len(columns), any
    words = next((k for k, name in enumerate(columns) if name in _WORDS), len(columns))
    if more > 0 and words < len(columns):
        cells, among = cells[: words + 1] + cells[words + 1 + more :], all
    there = [cells[columns.index(name)] for name in XYZ] if len(cells) == len(columns) else [""]
    return among(_is_number(cell.replace(",", "")) for cell in there)


def _is_number(cell: str) -> bool:
    try:
        return "_" not in cell and bool(np.isfinite(float(cell)))
    except ValueError:
        return False


def _listed(columns: tuple[str, ...]) -> str:
    return f"{len(columns)} values ({', '.join(columns)})"
