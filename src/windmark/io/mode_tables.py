"""Tables of mode shapes: nodes of a structural model and how each mode moves them."""

from __future__ import annotations

import csv
import re

import numpy as np
from numpy.typing import NDArray

from windmark.io.csvtable import read_table
from windmark.io.errors import FileError
from windmark.io.text import Pathlike, read_text

Array = NDArray[np.float64]

XYZ = ("x", "y", "z")
_SHAPE = re.compile(r"d[xyz]_([1-9][0-9]{0,17})")


def read_modes(path: Pathlike) -> tuple[Array, Array]:
    """Read a table ``x,y,z,dx_1,dy_1,dz_1,dx_2,...``: one node per line, displacement by one unit of each mode.

    Columns may come in any order and case, separated by comma, semicolon or tab; ``#`` starts a comment line. The
    modes are numbered from 1 without gaps.

    Returns
    -------
    nodes (M, 3) and shapes (M, 3, k), in the file's own unit

    Raises
    ------
    FileError
        Names line and column: missing or unknown column, no number; no mode, or no node.
    """
    count = _count(path)
    shape_columns = [tuple(f"d{axis}_{n}" for axis in "xyz") for n in range(1, count + 1)]
    columns = [*XYZ, *(c for mode in shape_columns for c in mode)]
    table = read_table(path, required=columns, known=columns)
    if not len(table):
        raise FileError(path, "the table has no rows; expected one node per line")
    nodes = np.stack([table.numbers(c) for c in XYZ], axis=1)
    shapes = [np.stack([table.numbers(c) for c in mode], axis=1) for mode in shape_columns]
    return nodes, np.stack(shapes, axis=2)


def _count(path: Pathlike) -> int:
    """How many modes the header names: the largest number, so that one left out is found missing."""
    lines = (line for line in read_text(path).splitlines() if line.strip() and not line.lstrip().startswith("#"))
    header = next(lines, "")
    separator = next((s for s in ";\t" if s in header), ",")
    cells = [cell.strip().lower() for cell in next(csv.reader([header], delimiter=separator), [])]
    numbers = [int(found[1]) for cell in cells if (found := _SHAPE.fullmatch(cell))]
    if not numbers:
        raise FileError(path, "no mode in the header; expected the columns x,y,z,dx_1,dy_1,dz_1,dx_2,...", "header")
    return min(max(numbers), len(cells))  # more than that are not there, whatever a number says
