"""What a picture's levels say of the camera and of how they were stored: where it clips, which bits say nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PLATEAU, STEP = 20, 5
"""So many pixels at a picture's largest level, and so many times as many as at the next lower one that it has, are a
clipped picture. The next lower one: levels of a sensor of fewer bits lie several apart."""

UNUSED, STAMPED, SURE = 8, 1e-3, 20
"""So many low bits are looked at; part of the pixels that may have them all the same (a number of the frame that a
camera writes into its first pixels); different levels from which on it is no accident that none has them: of twenty
that happens once in 2^20."""


def clipped_level(picture: NDArray[np.generic]) -> float:
    """The largest level of a picture of whole numbers that is clipped there, by the pixels that pile up; else inf.

    A camera clips where its electronics do, which may be far below the largest number that a file could hold.
    """
    if picture.dtype.kind not in "ui" or not picture.size:
        return float("inf")
    top = int(picture.max())
    count = int((picture == top).sum())
    if not PLATEAU <= count < picture.size:
        return float("inf")
    below = int((picture == picture[picture != top].max()).sum())
    return float(top) if count > STEP * below else float("inf")


def unused_bits(picture: NDArray[np.generic]) -> tuple[int, int]:
    """How many low bits are zero in all levels of a picture, or of several: at least, and at most, so many.

    A camera of 12 bits whose levels are stored as the upper ones of 16 leaves four unused: its levels are multiples of
    16. A picture of few different levels says little, and the two numbers differ; numbers that are no whole ones say
    nothing: (0, `UNUSED`).
    """
    if picture.dtype.kind not in "ui" or not picture.size:
        return 0, UNUSED
    most = 0
    while most < UNUSED and np.mean((picture & ((2 << most) - 1)) != 0) <= STAMPED:  # type: ignore[operator]
        most += 1
    return (most if most and len(np.unique(picture)) >= SURE else 0), most
