"""The verbs `find_board` and `find_boards`: the regular grid of dots among the spots of a picture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from windmark.adjust import log_tail
from windmark.calibration.board import check, marks
from windmark.calibration.board.axes import Frame, candidate_axes, symmetries, whole_lines
from windmark.calibration.board.grow import Lattice, grow
from windmark.calibration.board.place import Placed, place
from windmark.calibration.board.seeds import NEAR, find_seeds
from windmark.calibration.board.view import BoardNotFound, BoardView, check_layout
from windmark.errors import UsageError, g2
from windmark.scene import Detections

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MIN_DOTS = 9
MAX_LOG10_NFA = -3.0
_CHUNK = 150  # spots looked at for seeds at a time
_LOOK = 1200  # spots looked at in all: a board of a hundredth of all spots still has some seeds among them
_TRIES = 10  # seeds grown per chunk
_MIRROR = np.diag([1, -1])


@dataclass(frozen=True)
class _Asked:
    """Keywords of `find_board`, checked."""

    columns: int | None
    rows: int | None
    marks: Ints
    mark_spots: str | Array | None
    layout: str
    aspect: float
    size_px: tuple[int, int] | None
    max_tilt_deg: float


def find_board(
    detections: Detections,
    *,
    columns: int | None = None,
    rows: int | None = None,
    marks: ArrayLike | None = None,
    mark_spots: str | Detections | ArrayLike | None = None,
    layout: str = "square",
    aspect: float = 1.0,
    size_px: tuple[int, int] | None = None,
    max_tilt_deg: float = 65.0,
) -> BoardView | BoardNotFound:
    """Find the regular grid of a dot board among the spots of one picture, with no camera and no start.

    A lattice grows from spots whose eight neighbours form one, cell by cell; each place is predicted from the cells
    already there, so perspective and lens may bend it. Spots that do not fit their neighbours are dropped: a dot
    that is left out does no harm, a wrong index would.

    Parameters
    ----------
    detections : spots of one image, false ones among them. Radii, where known, tell dots from other spots
    columns, rows : size of the board, if known; of a staggered board in half spacings
    marks : (m, 2) column and row of dots that are not like the others (origin discs); with two or more that no turn
        takes to each other the indices are those of the board
    mark_spots : how the marks show: "large" or "small" radius; or where: the `Detections` or (L, 2) pixels of, say,
        the light holes of ring dots (`detect` with the other polarity)
    layout : "square"; or "staggered": dots only where column + row is even (asymmetric grids, hexagonal ones with
        ``aspect`` = sqrt(3))
    aspect : spacing of rows by spacing of columns
    size_px : (width, height) of the picture; without it the box round all spots is taken
    max_tilt_deg : tilt of the board's normal to the line of sight up to which columns and rows are told from diagonals

    Returns
    -------
    BoardView or BoardNotFound
        Without marks the indices count from the first column and row seen, and ``freedom`` says what is open. The
        board is seen from its front: mirrored indices are never given.

    Raises
    ------
    ValueError
        A wrong option, named.
    """
    asked = _checked(columns, rows, marks, mark_spots, layout, aspect, size_px, max_tilt_deg)
    radius = detections.radius_px if np.isfinite(detections.radius_px).any() else None
    return _found(detections.xy, radius, asked)


def find_boards(
    detections: Sequence[Detections], *, columns: int | None = None, rows: int | None = None, **options: object
) -> list[BoardView | BoardNotFound]:
    """`find_board` for several pictures of one board; its size is learnt from those that show all four sides.

    Parameters
    ----------
    detections : of each picture
    columns, rows, **options : as of `find_board`
    """
    views = [find_board(d, columns=columns, rows=rows, **options) for d in detections]  # type: ignore[arg-type]
    if columns is not None and rows is not None:
        return views
    # Turned pictures show rows for columns.
    whole = Counter(tuple(sorted(v.size)) for v in views if isinstance(v, BoardView) and all(v.closed))
    if not whole:
        return views
    short, long = whole.most_common(1)[0][0]
    if columns is not None and columns == short:
        short, long = long, short
    again = {"columns": columns or long, "rows": rows or short, **options}
    return [find_board(d, **again) for d in detections]  # type: ignore[arg-type]


def _found(xy: Array, radius: Array | None, asked: _Asked) -> BoardView | BoardNotFound:
    if len(xy) < MIN_DOTS:
        return BoardNotFound(f"{len(xy)} spots are too few for a board, at least {MIN_DOTS} are needed", "too_few")
    tree = cKDTree(xy)
    lattice = _largest(xy, tree, radius)
    if lattice is None:
        return BoardNotFound("no spot is in the middle of neighbours that form a lattice", "no_lattice")
    spots = lattice.spots
    nfa = _log10_nfa(lattice, tree)
    if len(spots) < MIN_DOTS or not nfa < MAX_LOG10_NFA:
        return BoardNotFound(
            f"the largest lattice has {len(spots)} dots; chance would make {g2(10 ** min(nfa, 9))} such of these spots",
            "weak", len(spots),
        )  # fmt: skip
    frame = Frame.of(xy, asked.size_px)
    bases = candidate_axes(
        lattice.cell[spots], xy[spots], frame, layout=asked.layout, aspect=asked.aspect,
        size=(asked.columns, asked.rows), max_tilt_deg=asked.max_tilt_deg,
    )  # fmt: skip
    if not bases:
        return BoardNotFound(
            f"the lattice of {len(spots)} dots does not fit a board of {asked.columns or 'any'} columns and"
            f" {asked.rows or 'any'} rows tilted by at most {asked.max_tilt_deg:g} degrees", "size", len(spots),
        )  # fmt: skip
    placed = _by_marks(lattice, radius, bases, asked)
    if placed == "mirrored":
        return BoardNotFound(
            "the marks are there, but mirrored: rows follow columns clockwise (x right, y down), so check the signs of"
            " marks, or whether the picture is flipped", "mirrored", len(spots),
        )  # fmt: skip
    if placed is None and len(bases) > 1:
        return BoardNotFound(
            "a square grid seen at one tilt and a sheared one at another look alike here, and the board's edges do not"
            " tell: show an edge of the board, or give columns and rows, or a smaller max_tilt_deg",
            "axes", len(spots),
        )  # fmt: skip
    if placed is None:
        lattice.drop(spots[~whole_lines(lattice.cell[spots] @ bases[0].T)])
    placed = placed or place(lattice, bases[0], asked.columns, asked.rows, asked.aspect, asked.layout)
    return _view(lattice, placed, frame, nfa, asked)


def _largest(xy: Array, tree: cKDTree, radius: Array | None) -> Lattice | None:
    """The largest lattice; the search ends when what is not on it cannot make a larger one."""
    best: Lattice | None = None
    # Spots from all over the list: a detector's order may have the dots of one place together.
    order = np.argsort((np.arange(len(xy)) * 0.6180339887) % 1.0)
    for begin in range(0, min(len(order), _LOOK), _CHUNK):
        chunk = order[begin : begin + _CHUNK]
        if best is not None:
            chunk = chunk[best.cell[chunk, 0] < 0]
        for seed in find_seeds(xy, tree, chunk)[:_TRIES]:
            if best is not None and best.cell[seed.spot, 0] >= 0:
                continue
            lattice = grow(xy, tree, seed)
            check.clean(lattice, tree, radius)
            spots = lattice.spots
            if len(spots) < MIN_DOTS or check.leaves_out(lattice, tree):
                continue
            if best is None or len(spots) > len(best.spots):
                best = lattice
            if 2 * len(best.spots) >= len(xy):
                return best
        if best is not None and len(best.spots) >= len(order) - begin - _CHUNK:
            return best
    return best


def _log10_nfa(lattice: Lattice, tree: cKDTree) -> float:
    """How many lattices as full as this one chance would make: a binomial tail times the lattices that can be tried."""
    spots = lattice.spots
    if len(spots) < MIN_DOTS:
        return 0.0
    at = lattice.predict(lattice.cell[spots])
    gate = check.gate(check.scatter(lattice))
    reach = np.sqrt(np.abs(np.linalg.det(at.steps)))
    within = np.array([len(n) for n in tree.query_ball_point(lattice.xy[spots], 1.5 * reach)])
    density = float(np.median(within)) / (np.pi * 1.5**2)  # spots per cell
    chance = min(1.0, density * np.pi * gate**2)
    cells = len(spots) + len(lattice.beside(lattice.cell[spots]))
    tail = log_tail(len(spots) - 3, cells, chance) / np.log(10)  # three spots make the lattice
    return float(tail + np.log10(len(lattice.xy) * NEAR**2))


def _by_marks(
    lattice: Lattice, radius: Array | None, bases: list[Ints], asked: _Asked
) -> Placed | Literal["mirrored"] | None:
    """The one placement that puts a mark on every marked dot; None where there is none, or several."""
    if not len(asked.marks):
        return None
    if isinstance(asked.mark_spots, str):
        if radius is None:
            return None
        spots = marks.odd_sized(lattice, radius, asked.mark_spots)
        cells, which = marks.mark_cells(lattice, lattice.xy[spots])
        spots = spots[which]
    else:
        assert asked.mark_spots is not None
        cells, spots = marks.mark_cells(lattice, asked.mark_spots)[0], None
    turns = [turn @ b for b in bases for turn in symmetries(asked.aspect)]
    found = marks.placements(cells, turns, asked.marks)
    if len(found) != 1:
        return None if found or not marks.placements(cells, [_MIRROR @ t for t in turns], asked.marks) else "mirrored"
    turn, shift = found[0]
    if spots is not None:
        index = cells @ turn.T + shift
        mine = (index[:, None] == asked.marks).all(axis=2).any(axis=1)
        free = mine & (lattice.table[cells[:, 0], cells[:, 1]] < 0) & (lattice.cell[spots, 0] < 0)
        lattice.put(cells[free], spots[free])
    return Placed(turn, shift, ())


def _view(lattice: Lattice, placed: Placed, frame: Frame, nfa: float, asked: _Asked) -> BoardView:
    spots = lattice.spots
    index = lattice.cell[spots] @ placed.basis.T + placed.shift
    order = np.lexsort((index[:, 0], index[:, 1]))
    spots, index = spots[order], index[order]
    at = lattice.predict(lattice.cell[spots])
    return BoardView(
        spot=spots, column=index[:, 0], row=index[:, 1], residual_px=np.hypot(*(lattice.xy[spots] - at.xy).T),
        scatter=check.scatter(lattice), freedom=placed.freedom, closed=placed.closed(lattice, frame, asked.layout),
        log10_nfa=nfa, layout=asked.layout, aspect=asked.aspect,
    )  # fmt: skip


def _checked(
    columns: int | None, rows: int | None, marked: ArrayLike | None, mark_spots: object, layout: str, aspect: float,
    size_px: tuple[int, int] | None, max_tilt_deg: float,
) -> _Asked:  # fmt: skip
    for name, value in (("columns", columns), ("rows", rows)):
        if value is not None and not (value >= 1 and int(value) == value):
            raise UsageError(f"find_board: {name} must be None or a whole number from 1, got {value!r}")
    if not (np.isfinite(aspect) and aspect > 0):
        raise UsageError(f"find_board: aspect must be a positive number, got {aspect!r}")
    if not 0 < max_tilt_deg < 90:
        raise UsageError(f"find_board: max_tilt_deg must be between 0 and 90, got {max_tilt_deg!r}")
    cells = np.empty((0, 2)) if marked is None else np.asarray(marked, dtype=float)
    if cells.ndim != 2 or cells.shape[1] != 2 or (cells != np.rint(cells)).any():
        raise ValueError(f"find_board: marks must be (m, 2) whole columns and rows, got {marked!r}")
    if (len(cells) > 0) != (mark_spots is not None):
        raise ValueError("find_board: marks and mark_spots need each other, only one was given")
    if isinstance(mark_spots, Detections):
        mark_spots = mark_spots.xy
    if isinstance(mark_spots, str) and mark_spots not in ("large", "small"):
        raise ValueError(f'find_board: mark_spots must be "large", "small" or places, got {mark_spots!r}')
    if mark_spots is not None and not isinstance(mark_spots, str):
        mark_spots = np.asarray(mark_spots, dtype=float).reshape(-1, 2)
    return _Asked(
        columns, rows, cells.astype(np.int64), mark_spots, check_layout(layout), float(aspect), size_px, max_tilt_deg
    )
