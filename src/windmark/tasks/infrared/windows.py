"""Frames next to each other in a history of temperatures, as its breaks and odd pictures are looked for in."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PAUSE = 1.5
"""Times the usual time between frames that is a pause."""
NORMAL = 1.4826
"""Sigma of normal deviates over the median of their size."""


def frames_round(
    values: Sequence[Array | None], times: Array, before: int, behind: int
) -> Iterator[tuple[int, Array]]:
    """Each frame k with so many frames before and behind it: their temperatures (before + 1 + behind, N).

    Only where a camera has pictures of all of them, and no pause lies between; of the nodes that are known in all.

    Parameters
    ----------
    values : (V,) of each of F frames, NaN where unknown; None where the camera has no picture
    times : (F,) seconds
    """
    spacing = np.diff(times)
    longest = PAUSE * float(np.median(spacing)) if len(spacing) else 0.0
    for k in range(before, len(values) - behind):
        near = [v for v in values[k - before : k + behind + 1] if v is not None]
        if len(near) <= before + behind or (spacing[k - before : k + behind] > longest).any():
            continue
        known = np.array(near)
        known = known[:, np.isfinite(known).all(axis=0)]
        if known.size:
            yield k, known


def spread(values: Array) -> float:
    """Robust sigma of values (N,)."""
    return size(values - np.median(values))


def size(values: Array) -> float:
    """Of a typical one of values (N,) about 0, as a sigma."""
    return NORMAL * float(np.median(np.abs(values)))
