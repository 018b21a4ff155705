"""Candidates that are no markers, each with the reason."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

ACCEPTED, SHAPE, FAINT, SHALLOW, SMALL, LARGE, FORMLESS = range(7)
UNCERTAIN, SURPLUS, MISFIT, BLURRED, SAME, PALE, PART, OTHER = range(7, 15)
REASONS = {
    SHAPE: "no disc of this size: the merit is above the limit",
    FAINT: "too faint for its shape: depth / noise / merit is below the limit",
    SHALLOW: "shallower than the smallest depth asked for",
    SMALL: "smaller than the radius asked for",
    LARGE: "larger than the radius asked for",
    FORMLESS: "no radius can be measured: no hole of positive depth and volume",
    UNCERTAIN: "its place cannot be determined",
    SURPLUS: "more spots than asked for, and others are better",
    MISFIT: "no blurred disc: the fitted template explains too little of what is there",
    PALE: "paler than the image's markers: less contrast than those near it and the others",
    PART: "part of something else: its edge is not there all the way round",
    OTHER: "another shape: its outline or its inside is not that of a disc (square, cross, letter, ring, dome)",
    SAME: "a better marker lies there",
    BLURRED: "sharper or more blurred than the image's markers",
}
"""Meaning of the codes of `Rejected.reason`."""


@dataclass(frozen=True)
class Rejected:
    """N candidates that were looked at and are no markers, best first.

    Parameters
    ----------
    xy : (N, 2) centres in pixels
    radius_px : (N,) measured radius; NaN where none can be measured
    merit : (N,) the paper's merit of the reference radius that did best there
    depth : (N,) contrast to the background in grey levels
    quality : (N,) depth / noise / merit, see `detect`
    reason : (N,) what decided, a code of `REASONS`
    """

    xy: Array
    radius_px: Array
    merit: Array
    depth: Array
    quality: Array
    reason: Ints

    def __len__(self) -> int:
        return len(self.xy)

    @property
    def words(self) -> list[str]:
        """The reasons in words."""
        return [REASONS[code] for code in self.reason.tolist()]

    def take(self, index: ArrayLike) -> Rejected:
        """The candidates of a mask or of indices, in that order."""
        i = np.asarray(index)
        if not i.size and i.dtype != bool:
            i = i.astype(np.int64)
        return Rejected(**{f.name: getattr(self, f.name)[i] for f in fields(self)})

    @staticmethod
    def none() -> Rejected:
        """No candidate at all."""
        return Rejected(
            np.empty((0, 2)), np.empty(0), np.empty(0), np.empty(0), np.empty(0), np.empty(0, dtype=np.int64)
        )
