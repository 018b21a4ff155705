"""Lines of a thermal camera's picture that hang: their numbers stay what they were while all others' noise goes on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.io import FileError
from windmark.pipeline.deform.pictures import read
from windmark.pipeline.infrared.load import InfraredRun

Mask = NDArray[np.bool_]

ACCIDENT = 1e-9
"""Probability that a line of a picture stands still by accident, from which on it hangs."""


def stuck_lines(picture: NDArray[np.generic], before: NDArray[np.generic]) -> tuple[Mask, Mask]:
    """Rows (H,) and columns (W,) of a picture (H, W) that are bit by bit as in the one ``before``.

    Where so many pixels of the other lines are the same, too, that it may be accident (coarse numbers, no noise), or
    the pictures are of other sizes, none is.
    """
    height, width = picture.shape
    if before.shape != picture.shape:
        return np.zeros(height, bool), np.zeros(width, bool)
    same = np.asarray(picture == before)
    return _still(same), _still(same.T)


def _still(same: Mask) -> Mask:
    part = same.mean(axis=1)
    usual, count = max(float(np.median(part)), 0.5 / same.size), same.shape[1]
    return (part == 1) & (count * np.log(usual) < np.log(ACCIDENT))


def stuck_pixels(run: InfraredRun, camera: str, index: int, picture: NDArray[np.generic]) -> Mask:
    """(H, W) pixels of a camera's picture of a frame that lie on lines which hang since the frame before, or longer."""
    none = np.zeros(picture.shape, bool)
    item = run.timeline.frames[index - 1].images.get(camera) if index > 0 else None
    if item is None:
        return none
    try:
        before = np.asarray(read(item, run.deforming.test.station(camera)))
    except FileError:
        return none  # said of that frame
    rows, columns = stuck_lines(picture, before)
    return none | rows[:, None] | columns[None, :]


def stuck_words(camera: str, stuck: Mask, xy: NDArray[np.float64], shown: Mask) -> list[str]:
    """What is said of lines that hang where nodes at pixels ``xy`` (V, 2), of those ``shown`` (V,), lie on them.

    Of others, as the black rim of a picture is made of, nothing is said.
    """
    column, row = np.rint(np.nan_to_num(xy[shown], nan=-1.0)).astype(int).T
    inside = (column >= 0) & (row >= 0) & (column < stuck.shape[1]) & (row < stuck.shape[0])
    if not stuck[row[inside], column[inside]].any():
        return []
    rows, columns = np.flatnonzero(stuck.all(axis=1)), np.flatnonzero(stuck.all(axis=0))
    which = [f"{name}{'s' * (len(k) > 1)} {_listed(k)}" for name, k in (("row", rows), ("column", columns)) if len(k)]
    return [f"{camera}: {' and '.join(which)} of its picture stand as in the frame before, bit by bit: they hang, and "
            "do not count"]  # fmt: skip


def _listed(lines: NDArray[np.int64]) -> str:
    some = ", ".join(map(str, lines[:4].tolist()))
    return f"{some} and {len(lines) - 4} more" if len(lines) > 4 else some
