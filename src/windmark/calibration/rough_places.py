"""The rough table that holds a free network: markers that are far from their places in it, and exchanged ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import exchanged_pairs
from windmark.errors import g2
from windmark.geometry.similarity import align
from windmark.scene import Doubt

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FAR = 8.0
"""Robust sigmas of the table from which on a marker does not hold the frame."""
ROUNDS = 20
MEDIAN3 = 1.5382
"""Median length of a vector of three standard normal numbers."""
LEAST = 6
"""Markers of which most can tell that others are beside their places."""


def held_by_table(
    points: Array, table: Array, spread: Array, names: Sequence[str], unit: str, *, scale: bool
) -> tuple[Mask, tuple[Doubt, ...]]:
    """Which markers hold a frame that is fitted to a rough table, and what is said of the others.

    The fit is repeated without those that are far beyond what most are off, so that two exchanged rows neither turn nor
    stretch the frame. Coordinates are those that the pictures say for all of them.

    Parameters
    ----------
    points, table : (N, 3) of the network, in any frame and scale, and of the table
    spread : (N,) 1 sigma per coordinate that the pictures leave of each, in the table's lengths
    names, unit : of the markers, and of the table
    scale : whether the network's own is unknown
    """
    held, usual, there, sigma = np.ones(len(points), dtype=np.bool_), np.inf, points, spread
    for _ in range(ROUNDS if len(points) >= LEAST else 0):
        there = align(points[held], table[held], scale=scale).apply(points)
        far = np.linalg.norm(there - table, axis=1)
        usual = max(float(np.median(far)) / MEDIAN3, 1e-9 * float(np.ptp(table, axis=0).max()))
        sigma = np.hypot(usual, spread)
        now = far < FAR * sigma
        if 2 * now.sum() <= len(points) or (now == held).all():
            break
        held = now
    out = np.flatnonzero(~held)
    pairs = exchanged_pairs(there[out], table[out], sigma[out])
    words = "{} and {} are exchanged in the table"
    doubts = [Doubt((names[out[a]], names[out[b]]), words, "swapped") for a, b in pairs]
    told = {k for pair in pairs for k in pair}
    for k, marker in enumerate(out.tolist()):
        if k not in told:
            words = (f"{{}} is {g2(np.linalg.norm(there[marker] - table[marker]))} {unit}".rstrip()
                     + f" from its place in the table, where most are {g2(MEDIAN3 * usual)} off")  # fmt: skip
            doubts.append(Doubt((names[marker],), words, "marker"))
    return held, tuple(doubts)
