"""Points on a line: they fix no pose."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

THIN = 1e-4
"""Markers whose distance from their best line is less than this part of their largest extent lie on it."""

ON_LINE_PX = 0.5
"""Spots that are no farther from a line than this beyond their noise lie on it: no pose that rests on less is one."""


def off_line(points: Array) -> float:
    """Root mean square distance of points (N, 2) or (N, 3) from their best line."""
    off = points - points.mean(axis=0)
    squares = off.T @ off
    if len(squares) == 2:
        # The small root without a difference of large numbers; numpy's solver takes longer for two by two.
        (a, b), (_, c) = squares.tolist()
        large = 0.5 * (a + c + math.hypot(a - c, 2 * b))
        return math.sqrt(max(a * c - b * b, 0.0) / large / len(points)) if large > 0 else 0.0
    return float(np.sqrt(max(np.linalg.eigvalsh(squares)[:-1].sum(), 0.0) / len(points)))


def on_line(xyz: Array) -> bool:
    """Whether markers (N, 3) lie on one line."""
    return not off_line(xyz) > THIN * float(np.ptp(xyz, axis=0).max())
