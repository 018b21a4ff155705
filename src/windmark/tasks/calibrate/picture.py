"""A picture of a calibration or reconstruction, and what became of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from windmark.calibration import Calibration
from windmark.scene import Detections


@dataclass(frozen=True)
class Picture:
    """One picture: its spots and what became of it.

    Parameters
    ----------
    name, camera : of the picture
    size_px : (width, height)
    detections : its spots
    frame : instant, which pictures of several cameras share
    problem : why it could not be used
    round : in which it was accepted for the first time, 0 if never
    excess_px : 1 sigma per coordinate that was added to the detector's, as the residuals of all pictures ask for
    unread : why its file could not be read, "" where it could
    blur_px, radius_px : median blur (1 sigma) and radius of its spots; NaN where they do not tell it
    """

    name: str
    camera: str
    size_px: tuple[int, int]
    detections: Detections
    frame: str = ""
    problem: str = ""
    round: int = 0
    excess_px: float = 0.0
    unread: str = ""
    blur_px: float = float("nan")
    radius_px: float = float("nan")

    @property
    def count(self) -> int:
        """Spots that were told which marker they are."""
        return 0

    @property
    def rms_px(self) -> float | None:
        """Misfit of those by themselves."""
        return None

    @property
    def log10_nfa(self) -> float | None:
        """Decimal logarithm of the false-alarm number."""
        return None


def excess_px(result: Calibration, before: float) -> float:
    """1 sigma per coordinate of the residuals beyond the marks' own noise: what lens, discs and light leave.

    From the medians, so that gross errors do not count. ``before`` is what the marks have of it already.
    """
    seen = float(np.median((result.residuals[result.used] ** 2).sum(axis=1)) / (2 * np.log(2.0)))
    noise = float(np.median(np.trace(result.observations.cov, axis1=1, axis2=2)) / 2) - before**2
    return float(np.sqrt(max(seen - noise, 0.0)))


def lost_most(calibration: Calibration) -> list[str]:
    """Views more than half of whose marks were left out."""
    view = calibration.observations.view
    every, lost = (np.bincount(v, minlength=len(calibration.views)) for v in (view, view[~calibration.used]))
    return [calibration.views[int(v)].name for v in np.flatnonzero(2 * lost > every)]
