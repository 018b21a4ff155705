"""What a set of real images is: its views with their truth, and how the truth was made."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
Array = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """One image and its truth.

    Parameters
    ----------
    name : of the view
    image : (H, W)
    polarity : "dark" or "bright"
    true : (N, 2) discs to be found
    other : (M, 2) discs that count neither as missed nor as false
    gate_px : a detection belongs to a true disc if it is at most so far away
    other_gate_px : and to another one if at most so far (the middle of a cut disc is not well defined)
    """

    name: str
    image: NDArray
    polarity: str
    true: Array
    other: Array = field(default_factory=lambda: np.zeros((0, 2)))
    gate_px: float = 2.0
    other_gate_px: float = 3.0


@dataclass(frozen=True)
class RealSet:
    """A set of images: what the user would give as the radius (steps of 1.3), how the truth was made, and the views."""

    folder: str
    radius_px: tuple[float, ...]
    truth: str
    views: Callable[[Path], Iterator[View]]
    quick: int
