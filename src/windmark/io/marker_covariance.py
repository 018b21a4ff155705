"""Joint covariances of markers' coordinates, as the adjustment of a survey gives them: a table beside the markers'."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.io.csvtable import Table, read_table, write_table
from windmark.io.errors import FileError
from windmark.io.markers import read_marker_unit
from windmark.io.text import Pathlike
from windmark.scene import MarkerCovariance

Array = NDArray[np.float64]

PARTS = tuple(a + b for a in "xyz" for b in "xyz")
COLUMNS = ("first", "second", *PARTS)
"""xy is the covariance of the first marker's x with the second one's y, in the squared length unit."""


def read_marker_covariance(path: Pathlike) -> MarkerCovariance:
    """Read a table ``first,second,xx,xy,xz,yx,yy,yz,zx,zy,zz``: one line per pair of markers.

    Every marker has a line with itself. A pair without a line is not correlated; of A, B and B, A one is enough. The
    length unit is what a comment says, as in marker tables.

    Raises
    ------
    FileError
        Names the line: missing or unknown column, no number, an empty name, a pair twice, a marker without a line with
        itself; or says why the whole is no covariance.
    """
    table = read_table(path, required=COLUMNS, known=COLUMNS)
    if not len(table):
        raise FileError(path, "no markers; the table has no rows")
    first, second = table.text("first"), table.text("second")
    table.check([bool(a and b) for a, b in zip(first, second, strict=True)], "first or second is empty; expected names")
    own = {a: k for k, (a, b) in enumerate(zip(first, second, strict=True)) if a == b}
    names = list(own)
    place = {name: n for n, name in enumerate(names)}
    blocks = np.stack([table.numbers(part) for part in PARTS], axis=1).reshape(-1, 3, 3)
    cov = np.zeros((len(names), 3, len(names), 3))
    seen: dict[frozenset[str], int] = {}
    for row, (a, b) in enumerate(zip(first, second, strict=True)):
        _check_pair(table, row, a, b, place, seen)
        cov[place[a], :, place[b]], cov[place[b], :, place[a]] = blocks[row], blocks[row].T
        if a == b and np.abs(blocks[row] - blocks[row].T).max() > 1e-6 * np.abs(blocks[row]).max():
            table.fail(row, f"the covariance of {a} with itself is not symmetric; expected xy = yx, xz = zx, yz = zy")
    try:
        return MarkerCovariance(np.array(names, dtype=np.str_), cov.reshape(3 * len(names), -1), read_marker_unit(path))
    except UsageError as error:
        raise FileError(path, str(error).removeprefix("MarkerCovariance: ")) from None


def _check_pair(
    table: Table, row: int, a: str, b: str, place: dict[str, int], seen: dict[frozenset[str], int]
) -> None:
    for name in (a, b):
        if name not in place:
            table.fail(row, f"{name!r} has no line with itself, first and second {name}; expected one for each")
    if (pair := frozenset((a, b))) in seen:
        table.fail(row, f"{a} and {b} are already on line {seen[pair]}; expected every pair once")
    seen[pair] = int(table.lines[row])


def write_marker_covariance(path: Pathlike, known: MarkerCovariance) -> None:
    """Write what `read_marker_covariance` reads, whole or not at all; pairs that are not correlated are left out."""
    n = len(known)
    blocks = known.cov.reshape(n, 3, n, 3).transpose(0, 2, 1, 3)
    a, b = np.nonzero(np.triu(np.ones((n, n), dtype=np.bool_)) & (blocks != 0).any(axis=(2, 3)))
    parts = dict(zip(PARTS, blocks[a, b].reshape(-1, 9).T, strict=True))
    comment = f"length unit: {known.length_unit}" if known.length_unit else ""
    write_table(path, {"first": known.name[a], "second": known.name[b], **parts}, comment=comment)
