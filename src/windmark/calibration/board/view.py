"""What `find_board` gives back: which spot is which dot, or why there is no board."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.scene import Detections, MarkerSet

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

Freedom = Literal["quarter turns", "half turn", "columns", "rows"]
FREEDOMS = {
    "quarter turns": "the board may be turned by 90, 180 or 270 degrees",
    "half turn": "the board may be turned by 180 degrees",
    "columns": "any number may be added to the columns",
    "rows": "any number may be added to the rows",
}
"""What may be left open in a `BoardView`, in words."""
Cause = Literal["too_few", "no_lattice", "weak", "axes", "size", "mirrored"]
CAUSES = {
    "too_few": "too few spots for a board",
    "no_lattice": "no spot has neighbours that form a lattice",
    "weak": "the best lattice could be chance",
    "axes": "the directions of columns and rows are not certain",
    "mirrored": "the marks are there, but mirrored",
    "size": "more columns or rows than the board has",
}
"""Every cause of a `BoardNotFound`, in words."""


@dataclass(frozen=True)
class BoardView:
    """K spots of one picture that are dots of a board.

    Parameters
    ----------
    spot : (K,) index into the detections
    column, row : (K,) of the dot. Seen from the front rows follow columns clockwise (x right, y down)
    residual_px : (K,) distance of each spot from where its neighbours predict it
    scatter : robust 1 sigma of that, per coordinate, in spacings
    freedom : what the picture leaves open, see `FREEDOMS`; empty where every index is that of the board itself.
        A board of even spacing looks the same after these moves: each picture may be used alone, with its own pose
    closed : whether the board is seen to end before the first column, after the last, before the first row, after the
        last
    log10_nfa : decimal logarithm of the false-alarm number: how many such lattices chance would make of these spots
    layout, aspect : as asked for
    """

    spot: Ints
    column: Ints
    row: Ints
    residual_px: Array
    scatter: float
    freedom: tuple[Freedom, ...]
    closed: tuple[bool, bool, bool, bool]
    log10_nfa: float
    layout: str
    aspect: float

    def __bool__(self) -> bool:
        return True

    def __len__(self) -> int:
        return len(self.spot)

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows from the first to the last seen."""
        return int(np.ptp(self.column)) + 1, int(np.ptp(self.row)) + 1

    def xyz(self, spacing: float) -> Array:
        """(K, 3) nominal coordinates: x along columns, y along rows, z = 0. ``spacing`` is that of columns."""
        return _places(self.column, self.row, spacing, self.aspect)

    def xy(self, detections: Detections) -> Array:
        """(K, 2) pixels of the same dots."""
        return np.asarray(detections.xy[self.spot])

    def marker(self, columns: int, rows: int) -> Ints:
        """(K,) index into `board_marker_set` of the board.

        Raises
        ------
        ValueError
            A dot is not on a board of that size.
        """
        inside = (self.column >= 0) & (self.column < columns) & (self.row >= 0) & (self.row < rows)
        if not inside.all():
            raise ValueError(
                f"BoardView.marker: expected columns 0 ... {columns - 1} and rows 0 ... {rows - 1}, got"
                f" {self.column.min()} ... {self.column.max()} and {self.row.min()} ... {self.row.max()}"
            )
        number = self.row * columns + self.column
        if self.layout == "square":
            return np.asarray(number)
        column, row = _dots(columns, rows, self.layout)
        return np.searchsorted(row * columns + column, number)


@dataclass(frozen=True)
class BoardNotFound:
    """The spots say no. Falsy.

    Parameters
    ----------
    reason : why, in words for the user
    cause : key of `CAUSES`
    best_count : dots of the largest lattice met
    """

    reason: str
    cause: Cause
    best_count: int = 0

    def __bool__(self) -> bool:
        return False


def board_marker_set(
    columns: int, rows: int, spacing: float, *, aspect: float = 1.0, layout: str = "square", radius: float = np.nan
) -> MarkerSet:
    """Nominal markers of a board, row by row, named ``c<column>r<row>``; x along columns, y along rows, z = 0.

    Parameters
    ----------
    columns, rows : of the board; of a staggered one in half spacings: dots are where column + row is even
    spacing : from column to column, in the length unit
    aspect : spacing of rows by spacing of columns
    layout : "square" or "staggered"
    radius : of the dots, in the length unit

    Raises
    ------
    ValueError
        A size below 1, a spacing that is not positive, an unknown layout.
    """
    for name, value in (("columns", columns), ("rows", rows)):
        if not (value >= 1 and int(value) == value):
            raise UsageError(f"board_marker_set: {name} must be a whole number from 1, got {value!r}")
    for name, length in (("spacing", spacing), ("aspect", aspect)):
        if not (np.isfinite(length) and length > 0):
            raise UsageError(f"board_marker_set: {name} must be a positive number, got {length!r}")
    column, row = _dots(columns, rows, check_layout(layout))
    names = [f"c{i:02d}r{j:02d}" for i, j in zip(column, row, strict=True)]
    xyz = _places(column, row, spacing, aspect)
    # z points away from the viewer, so the dots face -z.
    return MarkerSet.make(names, xyz, normal=np.tile([0.0, 0, -1], (len(xyz), 1)), radius=np.full(len(xyz), radius))


def check_layout(layout: str) -> str:
    """The layout, if it is one."""
    if layout not in ("square", "staggered"):
        raise UsageError(f'layout must be "square" or "staggered", got {layout!r}')
    return layout


def _dots(columns: int, rows: int, layout: str) -> tuple[Ints, Ints]:
    row, column = (index.ravel() for index in np.indices((int(rows), int(columns))))
    kept = np.ones(len(row), bool) if layout == "square" else (row + column) % 2 == 0
    return column[kept], row[kept]


def _places(column: ArrayLike, row: ArrayLike, spacing: float, aspect: float) -> Array:
    x, y = np.asarray(column, dtype=float) * spacing, np.asarray(row, dtype=float) * (spacing * aspect)
    return np.stack([x, y, np.zeros_like(x)], axis=1)
