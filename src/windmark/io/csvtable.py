"""CSV tables with a header (RFC 4180): strict reading that knows every line number, exact writing."""

from __future__ import annotations

import sys
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.io.atomic import atomic_write
from windmark.io.csv_rows import BETWEEN, rows_of
from windmark.io.errors import LARGEST, LONGEST_NAME, FileError
from windmark.io.header_units import split_units
from windmark.io.text import Pathlike, read_text

Array = NDArray[np.float64]

_CHUNK = 10_000
"""Rows that are turned into text at a time."""
_PACKED = 40_000
"""Cells that are put together at a time."""


@dataclass(frozen=True)
class Table:
    """The cells of a table as text, stripped, with the line (N,) each row starts on.

    ``cells`` has for each column the cells of some thousand rows in one text each, `BETWEEN` two of them: as single
    texts they take ten times as much memory. ``length_unit``: what the header says of the lengths, or "".
    """

    path: Pathlike
    columns: tuple[str, ...]
    cells: tuple[list[str], ...]
    lines: NDArray[np.int64]
    length_unit: str = ""

    def __len__(self) -> int:
        return len(self.lines)

    def __contains__(self, column: str) -> bool:
        return column in self._place

    @cached_property
    def _place(self) -> dict[str, int]:
        return {column: k for k, column in enumerate(self.columns)}

    def text(self, column: str) -> list[str]:
        """The cells of one column.

        Raises
        ------
        FileError
            For a cell of more than 256 characters, as a quote that is not closed makes them.
        """
        return [sys.intern(cell) for part in self._parts(column) for cell in part]

    def _parts(self, column: str) -> Iterator[list[str]]:
        """The cells of a column, some thousand rows at a time."""
        row = 0
        for part in self.cells[self._place[column]]:
            cells = part.split(BETWEEN)
            if len(max(cells, key=len)) > LONGEST_NAME:
                k, cell = next((k, cell) for k, cell in enumerate(cells) if len(cell) > LONGEST_NAME)
                what = f"{column} begins {cell[:20]!r} and has {len(cell)} characters"
                self.fail(row + k, f"{what}; expected at most {LONGEST_NAME}")
            yield cells
            row += len(cells)

    def names(self) -> list[str]:
        """The column ``name``: no cell empty, none twice.

        Raises
        ------
        FileError
            Names the line of the first name that is missing or there before.
        """
        names = self.text("name")
        first: dict[str, int] = {}
        for row, name in enumerate(names):
            if not name:
                self.fail(row, "name is empty; expected a name")
            if name in first:
                self.fail(row, f"the name {name!r} is already on line {self.lines[first[name]]}; names must be unique")
            first[name] = row
        return names

    def numbers(self, column: str, *, optional: bool = False) -> Array:
        """One column as (N,) numbers that can be reckoned with; with ``optional`` an empty cell (or nan) is NaN.

        Raises
        ------
        FileError
            Names line and column of the first cell that is no finite number, or beyond `LARGEST`.
        """
        out, row = [np.zeros(0)], 0
        for cells in self._parts(column):
            try:
                values = np.array([float(cell or "nan") for cell in cells])
            except ValueError:
                values = np.array([_number(cell) for cell in cells])
            empty = np.array([cell.lower() in ("", "nan") for cell in cells], dtype=bool)
            bad = ~(np.abs(values) <= LARGEST) & ~(optional & empty)
            bad |= np.array(["_" in cell for cell in cells], dtype=bool)  # Python's 1_000 is nobody's number here
            if bad.any():
                k = int(np.argmax(bad))
                hint = " with a decimal point" if "," in cells[k] else ""
                hint = f" of at most {LARGEST:g}" if np.isfinite(values[k]) and abs(values[k]) > LARGEST else hint
                self.fail(row + k, f"{column} is {cells[k]!r}; expected a finite number{hint}")
            out.append(values)
            row += len(cells)
        return np.concatenate(out)

    def together(self, *columns: str) -> Array | None:
        """Columns that come together as (N, len(columns)), None where the table lacks them; empty cells are NaN.

        Raises
        ------
        FileError
            When only some of the columns are there.
        """
        there = [column for column in columns if column in self]
        if not there:
            return None
        if len(there) < len(columns):
            missing = ", ".join(column for column in columns if column not in self)
            raise FileError(self.path, f"the table has {', '.join(there)} but not {missing}", "header")
        return np.stack([self.numbers(column, optional=True) for column in columns], axis=1)

    def check(self, good: ArrayLike, expected: str) -> None:
        """Raise `FileError` for the first row where ``good`` (N,) is false."""
        rows = np.flatnonzero(~np.asarray(good, dtype=bool))
        if len(rows):
            self.fail(int(rows[0]), expected)

    def fail(self, row: int, what: str) -> NoReturn:
        """Raise `FileError` for a row."""
        raise FileError(self.path, what, int(self.lines[row]))


def _number(cell: str) -> float:
    try:
        return float(cell or "nan")
    except ValueError:
        return float("inf")  # found, and named, as not finite


def read_table(
    path: Pathlike, *, required: Sequence[str], known: Sequence[str] | None, lengths: Sequence[str] = (),
    plain: Sequence[str] = (), otherwise: str = "",
) -> Table:  # fmt: skip
    """Read a table with a header line.

    Columns may come in any order and case, those ``required`` and others that are ``known`` (None: any), separated by
    comma, semicolon or tab (as the header is). The header may have a unit behind ``lengths`` (``x [mm]``), and empty
    brackets behind columns that are ``plain``. Blank lines and lines that start with ``#`` are skipped. UTF-8, with or
    without byte order mark. ``otherwise``: what to do where a required column is missing.

    Raises
    ------
    FileError
        When a required column is missing, a column is unknown or there twice, or a row has too few
        or too many cells; names the line.
    """
    text = read_text(path)
    separator, rows = ",", rows_of(path, text, None)
    try:
        line, header = next(rows)
    except StopIteration:
        raise FileError(path, f"no header line; expected {','.join(required)}") from None
    separator = next((s for s in ";\t," if any(s in cell for cell in header)), ",")
    rows = rows_of(path, text, separator)
    line, header = next(rows)
    header_cells = tuple(cell.lower() for cell in _without_empty_end(header))
    columns, length_unit = split_units(path, line, header_cells, lengths, plain)
    _check_header(path, line, columns, required, known, otherwise)
    packed = _Packed(len(columns))
    for line, row in rows:
        row = _fitted(row, len(columns))
        if len(row) != len(columns):
            what = f"{len(row)} values; expected {len(columns)} ({', '.join(columns)})"
            raise FileError(path, what, line)
        packed.add(line, row)
    return Table(path, columns, *packed.done(), length_unit)


def table_of(path: Pathlike, columns: tuple[str, ...], rows: Sequence[list[str]], lines: Sequence[int]) -> Table:
    """A table of cells that were read otherwise; ``lines`` (N,) on which the rows start."""
    packed = _Packed(len(columns))
    for line, row in zip(lines, rows, strict=True):
        if any(BETWEEN in cell for cell in row):
            raise FileError(path, "holds a zero byte; expected text", line)
        packed.add(line, row)
    return Table(path, columns, *packed.done())


class _Packed:
    """Rows put together into the texts of `Table.cells`."""

    def __init__(self, columns: int) -> None:
        self.cells: tuple[list[str], ...] = tuple([] for _ in range(columns))
        self.lines = array("q")
        self._rows: list[list[str]] = []
        self._at_once = max(1, _PACKED // max(1, columns))

    def add(self, line: int, row: list[str]) -> None:
        """One row more."""
        self._rows.append(row)
        self.lines.append(line)
        if len(self._rows) >= self._at_once:
            self._pack()

    def _pack(self) -> None:
        for column, cells in zip(self.cells, zip(*self._rows, strict=True), strict=True):
            column.append(BETWEEN.join(cells))
        self._rows = []

    def done(self) -> tuple[tuple[list[str], ...], NDArray[np.int64]]:
        """All cells, and the lines of the rows."""
        if self._rows:
            self._pack()
        return self.cells, np.array(self.lines, dtype=np.int64)


def _without_empty_end(cells: list[str]) -> list[str]:
    last = max((k for k, cell in enumerate(cells) if cell), default=-1)
    return cells[: last + 1]


def _fitted(row: list[str], n: int) -> list[str]:
    """Spreadsheets add empty cells at the end; they carry nothing."""
    return row[:n] if len(row) > n and not any(row[n:]) else row


def _check_header(
    path: Pathlike, line: int, columns: tuple[str, ...], required: Sequence[str], known: Sequence[str] | None,
    otherwise: str,
) -> None:  # fmt: skip
    listed = f"the columns are {','.join(known or required)}"
    there, allowed = Counter(columns), None if known is None else set(known)
    for column in required:
        if column not in there:
            what = f"no column {column!r} in the header {','.join(columns)!r}"
            raise FileError(path, f"{what}; {listed}{otherwise}", line)
    for column in columns:
        if allowed is not None and column not in allowed:
            raise FileError(path, f"unknown column {column!r}; {listed}", line)
        if there[column] > 1:
            raise FileError(path, f"the column {column!r} is there more than once", line)


def write_table(path: Pathlike, columns: Mapping[str, ArrayLike], *, comment: str = "") -> None:
    """Write columns of equal length as CSV, whole or not at all; the counterpart of `read_table`.

    Floats keep every digit, NaN is an empty cell, booleans are 1 and 0. Lines end in a line feed. A ``comment`` of one
    line or more goes above the header, behind a ``#``: what holds for the whole table, such as the length unit.

    Raises
    ------
    ValueError
        When the columns differ in length or are not one-dimensional.
    FileError
        When the file cannot be written.
    """
    arrays = {name: np.asarray(values) for name, values in columns.items()}
    lengths = {name: array.shape for name, array in arrays.items()}
    if len(set(lengths.values())) > 1 or any(array.ndim != 1 for array in arrays.values()):
        raise ValueError(f"write_table: columns must be one-dimensional and equally long, got {lengths}")
    rows = max((len(array) for array in arrays.values()), default=0)
    with atomic_write(path) as stream:
        stream.writelines(f"# {line}\n" for line in comment.splitlines())
        stream.write(",".join(map(_quoted, arrays)) + "\n")
        for start in range(0, rows, _CHUNK):  # as text a table takes many times its memory
            cells = [_cells(array[start : start + _CHUNK]) for array in arrays.values()]
            stream.writelines(",".join(row) + "\n" for row in zip(*cells, strict=True))


def _cells(values: NDArray[Any]) -> list[str]:
    if values.dtype.kind == "f":
        return ["" if v != v else repr(v) for v in values.astype(float).tolist()]
    if values.dtype.kind in "biu":
        return [str(int(v)) for v in values.tolist()]
    return [_quoted(str(v)) for v in values.tolist()]


def _quoted(cell: str) -> str:
    """Quote where a reader would otherwise see a separator, a comment or another cell."""
    if cell.startswith("#") or any(mark in cell for mark in ',;\t"\r\n'):
        return '"' + cell.replace('"', '""') + '"'
    return cell
