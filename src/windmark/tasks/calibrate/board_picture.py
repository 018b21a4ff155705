"""A board of dots, and a picture of one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from windmark.calibration import BoardView
from windmark.errors import UsageError
from windmark.scene import Detections
from windmark.tasks.calibrate.picture import Picture

MARK_KINDS = ("holes", "large", "small")


@dataclass(frozen=True)
class Board:
    """A regular board of dots.

    Parameters
    ----------
    pitch : from column to column, in the length unit
    marks : (column, row) of dots that are not like the others; rows count downwards where columns count to the right
    mark_kind : how they show: "holes" in ring dots, or "large" or "small" dots
    columns, rows : of the whole board, if known; of a staggered one in half pitches
    layout, aspect : see `calibration.find_board`
    length_unit : of the pitch: in, ft, mm, cm or m; "" where nobody says it
    """

    pitch: float
    marks: tuple[tuple[int, int], ...] = ()
    mark_kind: str = "holes"
    columns: int | None = None
    rows: int | None = None
    layout: str = "square"
    aspect: float = 1.0
    length_unit: str = ""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.pitch) and self.pitch > 0):
            raise UsageError(f"board: pitch must be positive, got {self.pitch!r}")
        if self.mark_kind not in MARK_KINDS:
            raise UsageError(f"board: mark_kind must be one of {', '.join(MARK_KINDS)}, got {self.mark_kind!r}")


@dataclass(frozen=True)
class BoardPicture(Picture):
    """A picture of a board: its spots, the holes of ring dots, and which spot is which dot.

    Parameters
    ----------
    holes : spots of the other polarity, None where none are looked for
    board : what was found, None if there is no board
    """

    holes: Detections | None = None
    board: BoardView | None = None

    @property
    def count(self) -> int:
        """Dots, if the picture takes part."""
        return 0 if self.board is None or self.problem else len(self.board)

    @property
    def rms_px(self) -> float | None:
        """Of the dots' distances from where their neighbours predict them."""
        return None if self.board is None else float(np.sqrt((self.board.residual_px**2).mean()))

    @property
    def log10_nfa(self) -> float | None:
        """Of the lattice."""
        return None if self.board is None else self.board.log10_nfa
