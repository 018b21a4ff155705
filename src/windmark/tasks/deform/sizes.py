"""How large the discs are imaged beside what the table of markers lets expect."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from windmark.registration.task import MIN_COUNT
from windmark.scene import MarkerSet
from windmark.scene.units import CommonRatio, common_ratio
from windmark.tasks.deform.spots import Labelled


def disc_size(spots: Sequence[Labelled], markers: MarkerSet) -> CommonRatio:
    """Imaged radii over those that table, pose and camera let expect, all cameras together.

    Spots that were not looked for at their markers' places, and markers of unknown radius, say nothing.
    """
    imaged = np.concatenate([np.sqrt(s.axes_px.prod(axis=1)) for s in spots])
    by_table = np.concatenate([np.sqrt(s.by_table[:, :2].prod(axis=1)) for s in spots])
    known = np.isfinite(markers.radius[np.concatenate([s.marker for s in spots])])
    return common_ratio(np.where(known, imaged / by_table, np.nan), imaged, MIN_COUNT)
