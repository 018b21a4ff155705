"""What `detect` and `explain` can be asked for, checked before any work starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.image import check_polarity
from windmark.errors import UsageError
from windmark.options.detection import MERIT_MAX, MIN_QUALITY, PHOTOMETRY, POLARITY, REFINE

REFINEMENTS = REFINE.choices
PHOTOMETRIES = PHOTOMETRY.choices
QUALITY_MIN = MIN_QUALITY.default  # see `detect`
FIT_SLACK = 1.43  # times the limit of the merit: a tilted or dirty disc may suit no trial radius, so the fit decides
DARKER_THAN_BLACK = 0.01  # share of the pixels; less is noise in deep shadow


@dataclass(frozen=True)
class Options:
    """Keywords of `detect`, with its defaults.

    Raises
    ------
    ValueError
        Names the option that is wrong, what was expected and what came.
    """

    radius_px: float | Sequence[float] | None = None
    polarity: str = POLARITY.default
    merit_max: float = MERIT_MAX.default
    refine: str = REFINE.default
    photometry: str | None = None
    mask: ArrayLike | None = None
    max_spots: int | None = None
    min_depth: float | None = None
    min_quality: float = MIN_QUALITY.default

    def __post_init__(self) -> None:
        check_polarity(self.polarity)
        if self.radius_px is not None:
            check_radii(self.radius_px)
        if not (np.isfinite(self.merit_max) and self.merit_max > 0):
            raise UsageError(f"merit_max must be a positive number, got {self.merit_max!r}")
        if self.refine not in REFINEMENTS:
            raise UsageError(f"refine must be one of {', '.join(REFINEMENTS)}, got {self.refine!r}")
        if self.photometry is not None and self.photometry not in PHOTOMETRIES:
            raise UsageError(f"photometry must be None or one of {', '.join(PHOTOMETRIES)}, got {self.photometry!r}")
        if self.max_spots is not None and not (self.max_spots >= 0 and int(self.max_spots) == self.max_spots):
            raise UsageError(f"max_spots must be None or a whole number from 0, got {self.max_spots!r}")
        if self.min_depth is not None and not np.isfinite(self.min_depth):
            raise UsageError(f"min_depth must be None or a number of grey levels, got {self.min_depth!r}")
        if not (np.isfinite(self.min_quality) and self.min_quality >= 0):
            raise UsageError(f"min_quality must be a number from 0, got {self.min_quality!r}")

    @property
    def light(self) -> str:
        """The photometry: paint scales the light, infrared adds to it."""
        return self.photometry or ("multiplicative" if self.polarity == "dark" else "additive")

    def in_light_of(self, image: NDArray[np.generic]) -> Options:
        """The same; where no photometry is asked for, additive if the image has places darker than no light at all.

        Nothing can take away more than all of the light: such an image has lost its zero (a background was subtracted).
        """
        if self.photometry is not None or image.dtype.kind == "u":
            return self
        step = max(1, int(np.sqrt(image.size / 60_000)))
        below = np.mean(np.less(image[::step, ::step], 0))
        return replace(self, photometry="additive") if below > DARKER_THAN_BLACK else self


def check_radii(radius_px: float | Sequence[float]) -> list[float]:
    """One radius or several as a list, smallest first."""
    try:
        radii = np.unique(np.asarray(radius_px, dtype=float).ravel())
    except (TypeError, ValueError):
        radii = np.empty(0)
    if radii.size == 0 or not (np.isfinite(radii).all() and radii[0] >= 1.0):
        raise UsageError(f"radius_px must be one radius or several, each at least 1 px, got {radius_px!r}")
    return [float(r) for r in radii]
