"""Dots that are not like the others tell where the board's origin is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.calibration.board.grow import Lattice

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_NEAR = 0.25  # cells: a mark is on its cell
_SIZE = 0.15  # of the logarithm of radius by cell: larger or smaller than most


def mark_cells(lattice: Lattice, xy: Array) -> tuple[Ints, Ints]:
    """Cells of places (M, 2) that lie on the lattice or just beside it: (L, 2), and which places they are."""
    if not len(xy):
        return np.empty((0, 2), dtype=np.int64), np.empty(0, dtype=np.int64)
    spots = lattice.spots
    nearest = spots[cKDTree(lattice.xy[spots]).query(xy)[1]]
    at = lattice.predict(lattice.cell[nearest])
    away = np.linalg.solve(at.steps.transpose(0, 2, 1), (xy - lattice.xy[nearest])[..., None])[..., 0]
    near = np.flatnonzero((np.abs(away) < 2.5).all(axis=1))
    cells = lattice.cell[nearest[near]] + np.rint(away[near]).astype(np.int64)
    good = lattice.predict(cells).distance(xy[near]) < _NEAR
    return cells[good], near[good]


def odd_sized(lattice: Lattice, radius: Array, kind: str) -> Ints:
    """Spots on or beside the lattice that are larger ("large") or smaller ("small") for their cell than most."""
    cells, spots = mark_cells(lattice, lattice.xy)
    dots = lattice.spots
    ratio = _relative(lattice, cells, radius[spots]) - np.nanmedian(
        _relative(lattice, lattice.cell[dots], radius[dots])
    )
    return spots[(ratio if kind == "large" else -ratio) > _SIZE]


def _relative(lattice: Lattice, cells: Ints, radius: Array) -> Array:
    """Logarithm of radii by the size of their cells: perspective shrinks both alike."""
    area = np.abs(np.linalg.det(lattice.predict(cells).steps))
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(radius) - 0.5 * np.log(area))


def placements(cells: Ints, turns: Sequence[Ints], marks: Ints) -> list[tuple[Ints, Ints]]:
    """Turns and shifts, ``index = turn @ cell + shift``, that put a marked cell on every mark of the board.

    Parameters
    ----------
    cells : (L, 2) cells with a mark, false ones among them
    turns : changes of basis to be tried
    marks : (m, 2) columns and rows of the board's marks
    """
    found: dict[tuple[int, ...], tuple[Ints, Ints]] = {}
    for turn in turns:
        index = cells @ turn.T
        have = {tuple(c) for c in index.tolist()}
        for first in index:
            shift = marks[0] - first
            if all(tuple(c) in have for c in (marks - shift).tolist()):
                found[(*turn.ravel().tolist(), *shift.tolist())] = (turn, shift)
    return list(found.values())
