"""What discs of another size than the table's would change in a state, and the words for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2
from windmark.scene import Doubt
from windmark.scene.units import CommonRatio, radii_told, radii_words

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OtherDiscs:
    """The state with discs of the other size.

    Parameters
    ----------
    size : imaged radii over the table's
    follow : (F,) how all that was free changes with the other ones
    chosen : whether the state at hand is that with the imaged size
    """

    size: CommonRatio
    follow: Array
    chosen: bool = False

    def doubt(self, unit: str) -> tuple[Doubt, ...]:
        """That the table's radii fit worse than the imaged ones."""
        if not self.chosen:
            return ()
        fits = "The spots fit better as images of discs of that size, and are taken for such"
        return (Doubt((), f"{radii_words(self._ratio, unit)} {fits}", "discs"),)

    def unchecked(self, unit: str, sigmas: float) -> tuple[Doubt, ...]:
        """That the sigmas have more in them, where the other discs change something by over one of these."""
        if self.chosen or not self.size.matters(sigmas):
            return ()
        return (Doubt((), radii_told(self._ratio, unit, "every sigma has"), "radii"),)

    @property
    def _ratio(self) -> float:
        """With two figures, so that all frames of a test say the same."""
        factor = float(g2(max(self.size.ratio, 1 / self.size.ratio)))
        return factor if self.size.ratio > 1 else 1 / factor


def sigmas_of(change: Array, cov: Array) -> float:
    """How far a change (F,) of all that is free is, in its own sigmas (F, F)."""
    size = np.sqrt(np.diag(cov))
    unit = np.where(size > 0, size, 1.0)
    along = change / unit
    return float(np.sqrt(max(along @ np.linalg.lstsq(cov / np.outer(unit, unit), along, rcond=None)[0], 0.0)))
