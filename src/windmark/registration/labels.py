"""What the user says about single spots: fixed labels and excluded spots, checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.scene import Detections, MarkerSet

Fixed = Mapping[int, int | str] | Sequence[tuple[int, int | str]]


def used_spots(usable: NDArray[np.bool_], excluded: ArrayLike | None) -> NDArray[np.bool_]:
    """(M,) spots that take part: those the lens model can invert and that are not excluded (indices or a mask)."""
    if excluded is None:
        return usable
    given, count = np.asarray(excluded), len(usable)
    if given.dtype == bool:
        if given.shape != (count,):
            raise ValueError(f"register: excluded as a mask must be ({count},) as there are so many spots, "
                             f"got {given.shape}")  # fmt: skip
        return usable & ~given
    if given.ndim != 1 or (given.size and not np.issubdtype(given.dtype, np.integer)):
        raise ValueError(f"register: excluded must be indices of spots or a mask, got {excluded!r}")
    bad = [int(i) for i in given if not 0 <= i < count]
    if bad:
        raise ValueError(f"register: excluded must be indices of the {count} spots, got {bad[0]}")
    used = usable.copy()
    used[given.astype(np.int64)] = False
    return used


def fixed_pairs(
    fixed: Fixed | None, detections: Detections, markers: MarkerSet, used: NDArray[np.bool_]
) -> tuple[tuple[int, int], ...]:
    """Pairs (spot among the used ones, marker index) of labels (spot, marker index or name).

    Raises
    ------
    ValueError
        For a spot or a marker that does not exist or takes no part, or comes twice.
    """
    given = list(fixed.items()) if isinstance(fixed, Mapping) else list(fixed or ())
    names = markers.name.tolist()
    place = np.cumsum(used) - 1
    pairs: list[tuple[int, int]] = []
    for spot, label in given:
        if not 0 <= spot < len(detections):
            raise ValueError(f"register: fixed must name spots by their index below {len(detections)}, got {spot}")
        if not used[spot]:
            raise ValueError(f"register: fixed spot {spot} is excluded, or the lens model cannot invert it")
        if isinstance(label, str):
            if label not in names:
                raise ValueError(f"register: fixed label {label!r} is not the name of a marker that takes part")
            marker = names.index(label)
        else:
            marker = int(label)
            if not 0 <= marker < len(markers):
                raise ValueError(
                    f"register: fixed must name markers by name or index below {len(markers)}, got {label}"
                )
        pairs.append((int(place[spot]), marker))
    for k, what in ((0, "spot"), (1, "marker")):
        seen = [pair[k] for pair in pairs]
        if len(set(seen)) < len(seen):
            raise ValueError(f"register: every {what} may be fixed only once, got {given}")
    return tuple(pairs)
