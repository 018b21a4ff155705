"""Dark markers, or bright ones where dark ones are not there: ``polarity="auto"``, with everything that was decided."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from windmark.detection.examine import examine
from windmark.detection.image import POLARITIES
from windmark.detection.options import Options
from windmark.detection.radius import RadiusEstimate, estimate_radius
from windmark.detection.rejected import Rejected
from windmark.detection.spots import MERIT_FLOOR
from windmark.errors import UsageError
from windmark.scene import Detections

AUTO = "auto"
FEW = 3
"""Fewer spots than this are no markers to speak of: three fix a size, a pose, or a decision."""
OUTWEIGH = 4.0
"""Bright markers are taken beside one or two dark spots if their evidence is so many times that of the dark ones."""


@dataclass(frozen=True)
class Look:
    """What was found in an image and how it was looked for.

    Parameters
    ----------
    polarity : "dark" or "bright", that of the spots
    detections : the spots, as of `detect`
    radius : the estimate that was taken where no radius was given
    radii_px : the radii that were looked for, empty where none prevails
    rejected : what was looked at but not taken, where that was asked for
    words : what "auto" decided, where that is not the usual thing; else ""
    unlike : spots as deep and as large as these that are no discs
    """

    polarity: str
    detections: Detections
    radius: RadiusEstimate | None = None
    radii_px: tuple[float, ...] = ()
    rejected: Rejected | None = None
    words: str = ""
    unlike: int = 0

    @property
    def is_few(self) -> bool:
        """Whether another setting may find the markers: few spots, or as many as deep that are no discs."""
        return len(self.detections) < FEW or self.unlike >= len(self.detections)


def find_markers(image: ArrayLike, *, polarity: str = AUTO, rejected: bool = False, **options: Any) -> Look:
    """Markers of an image, with the radius that was taken and the polarity that was decided.

    "auto": dark markers are looked for first, and taken where there are three or more, whatever else is in the
    picture; highlights beside dark markers are so never taken for markers. Where there are fewer, bright ones are
    looked for, and taken if there are three or more that outweigh the dark ones four times (number x radius x depth /
    merit, as in `estimate_radius`). One or two bright spots are no markers: the answer is then that of the dark ones.

    Parameters
    ----------
    image : as of `detect`
    polarity : "auto", "dark" or "bright"
    rejected : list the rejected candidates too, as `explain` does
    options : of `detect`; without ``radius_px`` that of `estimate_radius` is taken

    Raises
    ------
    ValueError
        As `detect`.
    """
    if polarity not in (AUTO, *POLARITIES):
        raise UsageError(f"polarity must be one of {', '.join((AUTO, *POLARITIES))}, got {polarity!r}")
    Options(**options)
    most = options.pop("max_spots", None) if polarity == AUTO else None  # the decision is on all of them
    look = _decide(image, polarity, rejected, options)
    return look if most is None else replace(
        _look(image, look.polarity, rejected, {**options, "max_spots": most}), words=look.words
    )  # fmt: skip


def _decide(image: ArrayLike, polarity: str, rejected: bool, options: dict[str, Any]) -> Look:
    """`find_markers`, of all spots."""
    first = _look(image, "dark" if polarity == AUTO else polarity, rejected, options)
    dark = len(first.detections)
    if polarity != AUTO or dark >= FEW:
        return first
    other = _look(image, "bright", rejected, options)
    bright = len(other.detections)
    if bright >= FEW and _evidence(other.detections) > OUTWEIGH * _evidence(first.detections):
        words = f"bright markers: {bright} found ({dark or 'no'} dark one{'s' * (dark != 1)})"
        return replace(other, words=words)
    words = f"{bright} bright spots beside {dark} dark: say the polarity if they are the markers" if bright else ""
    return replace(first, words=words)


def _look(image: ArrayLike, polarity: str, rejected: bool, options: dict[str, Any]) -> Look:
    """Markers of one polarity."""
    options = {**options, "polarity": polarity}
    estimate, none = None, Detections.make(np.empty((0, 2)))
    if options.get("radius_px") is None:
        estimate = estimate_radius(image, polarity, mask=options.get("mask"))
        if not estimate:
            return Look(polarity, none, estimate)
        options["radius_px"] = estimate.radii_px
    radii = tuple(float(r) for r in np.atleast_1d(options["radius_px"]))
    found, others, unlike = examine(image, Options(**options), why=rejected)
    return Look(polarity, found, estimate, radii, others if rejected else None, unlike=unlike)


def _evidence(spots: Detections) -> float:
    return float(np.sum(spots.radius_px * spots.depth / np.maximum(spots.merit, MERIT_FLOOR)))
