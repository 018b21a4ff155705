"""Labels and exclusions given as places in the image: which spot is meant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.errors import DataError, UsageError
from windmark.scene import Detections

Place = tuple[float, float]


def fixed_spots(spots: Detections, labels: Mapping[str, Place], within_px: float) -> dict[int, str]:
    """Spot index -> marker name of labels given by place.

    Raises
    ------
    ValueError
        Where no spot is within ``within_px`` of a place, or two labels mean the same spot.
    """
    fixed: dict[int, str] = {}
    for name, place in labels.items():
        spot = _nearest(spots, place, within_px, f"label {name}")
        if spot in fixed:
            x, y = spots.xy[spot]
            raise UsageError(f"label {name}: the spot at ({x:.1f}, {y:.1f}) is {fixed[spot]} already; expected one "
                             "label for each spot")  # fmt: skip
        fixed[spot] = name
    return fixed


def excluded_spots(
    spots: Detections, places: Sequence[Place], within_px: float, fixed: Mapping[int, str] | None = None
) -> NDArray[np.int64]:
    """Indices of the spots at the given places; errors as `fixed_spots`, and where one is ``fixed`` by a label."""
    out = sorted({_nearest(spots, place, within_px, "exclude") for place in places})
    for spot in out:
        if spot in (fixed or {}):
            x, y = spots.xy[spot]
            raise UsageError(f"exclude: the spot at ({x:.1f}, {y:.1f}) has the label {(fixed or {})[spot]}; take the "
                             "label or the exclusion out")  # fmt: skip
    return np.array(out, dtype=np.int64)


def _nearest(spots: Detections, place: Place, within_px: float, what: str) -> int:
    x, y = place
    if not len(spots):
        raise DataError(f"{what}: no spot at ({x:g}, {y:g}); none was detected")
    distance = np.linalg.norm(spots.xy - np.asarray(place), axis=1)
    spot = int(np.argmin(distance))
    if distance[spot] > within_px:
        at = spots.xy[spot]
        raise DataError(
            f"{what}: no spot within {within_px:g} px of ({x:g}, {y:g}); the nearest is {distance[spot]:.1f} px away, "
            f"at ({at[0]:.1f}, {at[1]:.1f})"
        )
    return spot
