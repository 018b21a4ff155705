"""The verdict on parts and walls of a deformation test's table that the spots alone do not contradict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from windmark.deformation import Volumes
from windmark.pipeline.deform.record import FrameRecord
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding
from windmark.scene import MarkerSet
from windmark.scene.units import spelt
from windmark.tasks.deform.hinges import exchanged_hinges
from windmark.tasks.likely_unit import likely_unit


def hinge_findings(markers: MarkerSet, volumes: Volumes) -> list[Finding]:
    """Parts on hinges that are exchanged with each other."""
    found = exchanged_hinges(markers, volumes)
    if not found:
        return []
    step = "exchange these volumes in the table of markers, or the start and end of their hinges"
    return [Finding(DOUBTFUL, "swapped", "; ".join(hinge_words(v, w) for v, w in found.items()), step)]


def hinge_words(volume: str, other: str) -> str:
    """That a volume's hinge is another one's."""
    return (
        f"the hinge of {volume} (start to end) lies beside the markers of {volume} and along those of {other}, whose "
        "hinge is elsewhere, too: are they exchanged?"
    )


def walls_findings(markers: MarkerSet, records: Sequence[FrameRecord], unit: str) -> list[Finding]:
    """Markers on walls that should hold cameras which move, and that none of them saw in any frame."""
    sights = [(name, s) for r in records for name, s in r.cameras.items() if s.found]
    names = list(dict.fromkeys(name for name, s in sights if s.walls[1]))
    if not names or any(s.walls[0] for _, s in sights) or any(s.walls[1] == 0 for name, s in sights if name in names):
        return []
    wall = markers.role == "wall"
    low, high = markers.xyz[~wall].min(axis=0), markers.xyz[~wall].max(axis=0)
    size = float(np.linalg.norm(high - low))
    units = likely_unit(markers.xyz[wall], (low - size, high + size), unit)[0]  # they stand round the model
    rather = f"; these rows of the table are rather in {' or '.join(map(spelt, units))}" if units else ""
    most = max(s.walls[1] for _, s in sights)
    return [
        Finding(
            DOUBTFUL,
            "missing",
            f"none of the {int(wall.sum())} markers on walls was seen in any frame, though {most} of them should be in "
            f"the pictures of {' and '.join(names)}: nothing but what is said of their poses holds these "
            f"cameras{rather}",
            "correct the places of the walls' markers (unit, frame) or the cameras' poses; or leave these rows out",
        )
    ]
