"""What a picture's levels say of the camera: where it clips."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PLATEAU, STEP = 20, 5
"""So many pixels at a picture's largest level, and so many times as many as at the next lower one that it has, are a
clipped picture. The next lower one: levels of a sensor of fewer bits lie several apart."""


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
