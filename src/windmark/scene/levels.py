"""What a picture's levels say of the camera: where it clips."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PLATEAU, STEP = 20, 5
"""So many pixels at a picture's largest level, and so many times as many as one below, are a clipped picture."""


def clipped_level(picture: NDArray[np.generic]) -> float:
    """The largest level of a picture of whole numbers that is clipped there, by the pixels that pile up; else inf.

    A camera clips where its electronics do, which may be far below the largest number that a file could hold.
    """
    if picture.dtype.kind not in "ui" or not picture.size:
        return float("inf")
    top = int(picture.max())
    count, below = int((picture == top).sum()), int((picture == top - 1).sum())
    piled = count >= PLATEAU and count > STEP * below
    return float(top) if piled and count < picture.size else float("inf")
