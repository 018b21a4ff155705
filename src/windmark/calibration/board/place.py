"""From a lattice with columns and rows to indices: turn, shift, and what is left open."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.calibration.board.axes import Frame, seen, symmetries
from windmark.calibration.board.grow import Lattice
from windmark.calibration.board.view import Freedom
from windmark.geometry.two_view.homography import fit_homography

Ints = NDArray[np.int64]

_SHOWN = 0.6  # share of the cells beyond a side that must be in the picture to say that the board ends there


@dataclass(frozen=True)
class Placed:
    """``index = basis @ cell + shift``, and what of it is open."""

    basis: Ints
    shift: Ints
    freedom: tuple[Freedom, ...]

    def closed(self, lattice: Lattice, frame: Frame, layout: str) -> tuple[bool, bool, bool, bool]:
        """Whether the board is seen to end: before the first column, after the last, the same of the rows."""
        cells = lattice.cell[lattice.spots]
        index = cells @ self.basis.T + self.shift
        h = fit_homography(index.astype(float), lattice.xy[lattice.spots])
        if h is None:
            return (False,) * 4
        low, high = index.min(axis=0), index.max(axis=0)
        reach = 1 if layout == "square" else 2
        out = []
        for axis in (0, 1):
            along = np.arange(low[1 - axis], high[1 - axis] + 1)
            for side in (low[axis] - reach, high[axis] + reach):
                beyond = np.empty((len(along), 2), dtype=np.int64)
                beyond[:, axis], beyond[:, 1 - axis] = side, along
                out.append(bool(seen(beyond, h, frame).mean() >= _SHOWN))
        return out[0], out[1], out[2], out[3]


def place(lattice: Lattice, basis: Ints, columns: int | None, rows: int | None, aspect: float, layout: str) -> Placed:
    """Indices from the first column and row seen, turned so that they fit the board."""
    cells = lattice.cell[lattice.spots]
    placed = []
    for turn in symmetries(aspect):
        index = cells @ (turn @ basis).T
        room = [np.inf if n is None else n - k for n, k in zip((columns, rows), np.ptp(index, axis=0) + 1, strict=True)]
        shift = -index.min(axis=0)
        odd = layout != "square" and (index[0] + shift).sum() % 2 == 1  # dots are where column + row is even
        if min(room) >= 0 and (not odd or max(room) > 0):
            shift = shift + (np.array([1, 0] if room[0] > 0 else [0, 1]) if odd else 0)
            placed.append(Placed(turn @ basis, shift, _freedom(room)))
    # One of the turns by 0 and 180 degrees fits where the other does, but for staggered boards without room.
    left: Freedom | None = "quarter turns" if len(placed) > 2 else "half turn" if len(placed) == 2 else None
    first = placed[0]
    return replace(first, freedom=(*((left,) if left else ()), *first.freedom))


def _freedom(room: list[float]) -> tuple[Freedom, ...]:
    names: tuple[Freedom, Freedom] = ("columns", "rows")
    return tuple(name for name, left in zip(names, room, strict=True) if left > 0)
