"""In which frame everything is adjusted: held by the primaries, or free."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from windmark.calibration import Distance, Free, Weighted
from windmark.calibration.datum import Datum
from windmark.scene import MarkerSet
from windmark.tasks.reconstruct.free import in_its_frame, labelled_names
from windmark.tasks.reconstruct.primaries import Located, with_sigma
from windmark.tasks.reconstruct.structure import Structure
from windmark.tasks.reconstruct.task import Refused, Task

Array = NDArray[np.float64]


class Frame(Protocol):
    """What an adjustment is held by; asked before and told after each round of linking."""

    datum: Datum
    table: MarkerSet | None
    distances: Sequence[Distance]

    def prepared(self, structure: Structure) -> tuple[Structure, list[str]]:
        """The structure in the frame, and names of its points."""

    def adjusted(self, structure: Structure, names: list[str]) -> None:
        """Take note of where points are after an adjustment."""


class Held:
    """The primaries hold it; each is the point nearest to where it was."""

    distances: Sequence[Distance] = ()

    def __init__(self, task: Task, structure: Structure, located: Located) -> None:
        self._located = located
        self._where: Array = structure.xyz[located.point]
        self.table: MarkerSet | None = with_sigma(task.primary)
        self._names = tuple(str(task.primary.name[p]) for p in located.primary)
        self.datum: Datum = Weighted(self._names, covariance=task.known_together(self._names))

    def prepared(self, structure: Structure) -> tuple[Structure, list[str]]:
        """Primaries by their names, other points by numbers."""
        names = numbered(len(structure.xyz))
        taken: set[int] = set()
        for name, place in zip(self._names, self._where, strict=True):
            nearest = int(np.linalg.norm(structure.xyz - place, axis=1).argmin())
            if nearest in taken:
                raise Refused("not_found", f"primary marker {name} was lost when all spots were linked")
            taken.add(nearest)
            names[nearest] = name
        return structure, names

    def adjusted(self, structure: Structure, names: list[str]) -> None:
        """The primaries' places."""
        index = {n: k for k, n in enumerate(names)}
        self._where = structure.xyz[[index[n] for n in self._names]]


class FreeFrame:
    """The points hold it, or given poses; see `free`."""

    table: MarkerSet | None = None

    def __init__(self, task: Task, distances: Sequence[Distance]) -> None:
        self._task, self.distances = task, distances
        self.datum: Datum = Free()

    def prepared(self, structure: Structure) -> tuple[Structure, list[str]]:
        """In its frame; labelled points have their names."""
        names = labelled_names(self._task, structure)
        return in_its_frame(self._task, structure, self.distances, names), names

    def adjusted(self, structure: Structure, names: list[str]) -> None:
        """Nothing to note."""


def numbered(count: int) -> list[str]:
    """Names of points that have none: s001, s002, ..."""
    return [f"s{k:0{max(3, len(str(count)))}d}" for k in range(1, count + 1)]


def holding(frame: Frame, names: Sequence[str]) -> dict[str, Any]:
    """What holds a structure with these ``names`` in its frame, as `structure.adjusted` takes it."""
    return {"datum": frame.datum, "names": names, "table": frame.table, "distances": frame.distances}
