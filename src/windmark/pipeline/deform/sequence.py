"""What a deformation test that is over leaves in memory: the numbers of every frame, and some of its states."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation
from windmark.pipeline.deform.frames import FrameTable
from windmark.pipeline.deform.pictured import Gallery
from windmark.pipeline.deform.record import MISFIT, FrameRecord
from windmark.pipeline.deform.values import Compared
from windmark.tasks.deform.zero import Zero

Array = NDArray[np.float64]

KEPT = 120
"""States that are kept for the film; with more frames every second one is dropped, again and again."""


@dataclass
class Sequence:
    """What is left of a sequence when it is over.

    Parameters
    ----------
    records : the numbers of every frame
    zero : the wind-off state; None without one
    moved : (N, 3) how far the zero moved the markers from their table; None without one
    film : some evenly spaced frames with their states
    table : what is known of the frames besides
    interrupted : Ctrl-C ended it
    compared : the most deformed frame mapped with and without its deformation; None without values and zero
    clock : the camera whose pictures are the instants; "" where pictures of one number are of one instant
    remarks : what is odd about the pictures' times
    arrivals : what became of the files that arrived -> how many
    gallery : the instants that are shown by their pictures
    """

    records: list[FrameRecord] = field(default_factory=list)
    zero: Zero | None = None
    moved: Array | None = None
    film: list[tuple[FrameRecord, Deformation]] = field(default_factory=list)
    table: FrameTable = field(default_factory=FrameTable)
    interrupted: bool = False
    compared: Compared | None = None
    clock: str = ""
    remarks: tuple[str, ...] = ()
    arrivals: Counter[str] = field(default_factory=Counter)
    gallery: Gallery = field(default_factory=Gallery)
    _stride: int = 1

    def films(self, row: FrameRecord) -> bool:
        """Whether the film keeps the state of a frame that is added now."""
        return row.index % self._stride == 0

    def keep(self, row: FrameRecord, state: Deformation | None) -> None:
        """Add a frame; memory stays that of its few numbers. ``state``: where the film keeps it."""
        self.records.append(row)
        if state is not None:
            self.film.append((row, state))
        if len(self.film) > KEPT:
            self._stride *= 2
            self.film = [pair for pair in self.film if pair[0].index % self._stride == 0]

    @property
    def good(self) -> list[FrameRecord]:
        """The frames with a state."""
        return [r for r in self.records if r.status in ("cold", "tracked", MISFIT)]
