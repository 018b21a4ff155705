"""Known distances beside the rough places of their markers: another unit, or another scale than the table's.

A free network takes its scale from the known distances alone, and the pictures fit at any scale: a scale bar in metres
beside a table in millimetres makes everything a thousand times smaller, and no residual tells.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from windmark.calibration.datum import Distance, Free
from windmark.calibration.setup import Job
from windmark.calibration.solve import Solved
from windmark.errors import g3
from windmark.geometry import DegenerateGeometry
from windmark.geometry.similarity import align
from windmark.scene import Doubt, MarkerSet
from windmark.scene.units import IN_MM, mixed_units, spelt

UNIT = 1.1
"""A ratio within this factor of that of two units is taken for it: rough places are off by less, or are none."""
SCALE, SCATTER = 0.01, 5.0
"""Part by which the scale of a rough table may differ from that of the distances, and times the table's own scatter
(over its extent): a table whose shape is right to a thousandth is not off by a tenth in scale for no reason."""
LEAST = 4
"""Markers from which a table has a shape of its own."""


def other_unit(markers: MarkerSet, distances: Sequence[Distance]) -> str:
    """Of distances in another unit than the rough places of their markers: in words which; "" where none is.

    Parameters
    ----------
    markers : with rough places, among them those that the distances name
    """
    row = {str(n): k for k, n in enumerate(markers.name)}
    for d in distances:
        if d.first not in row or d.second not in row:
            continue
        rough = float(np.linalg.norm(markers.xyz[row[d.first]] - markers.xyz[row[d.second]]))
        if not (np.isfinite(rough) and rough > 0):
            continue
        units = mixed_units(rough / d.length, markers.length_unit)
        if units is None:
            continue
        theirs, own = units
        off = rough / d.length * IN_MM[theirs] / IN_MM[own]
        if max(off, 1 / off) < UNIT:
            place = f" {markers.length_unit}" if markers.length_unit else ""
            return (
                f"the known distance {d.first} to {d.second} is given as {d.length:g}, the rough places of these "
                f"markers are {g3(rough)}{place} apart: the distance is in {spelt(own)}, the places in {spelt(theirs)}?"
                " Give both in one unit"
            )
    return ""


def scale_doubts(job: Job, solved: Solved) -> tuple[Doubt, ...]:
    """Whether the scale that a distance gives a free network contradicts the rough places of the markers.

    Several that agree are right against a rough table, which may be a guess; whether they do is tested elsewhere.
    """
    if len(job.distances) != 1 or not isinstance(job.datum, Free):
        return ()  # what holds the scale as well is tested against the distances
    seen = np.unique(job.observations.point[solved.taken])
    places = job.markers.xyz[seen]
    if len(seen) < LEAST or not np.isfinite(places).all():
        return ()
    try:
        fit = align(solved.state.points[seen], places)
    except DegenerateGeometry:
        return ()
    extent = float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean()))
    left = float(np.sqrt(((fit.apply(solved.state.points[seen]) - places) ** 2).sum(axis=1).mean())) / extent
    if abs(np.log(fit.scale)) <= max(SCALE, SCATTER * left):
        return ()
    factor, how = (1 / fit.scale, "larger") if fit.scale < 1 else (fit.scale, "smaller")
    (bar,) = job.distances
    words = (
        f"the known distance {{}} to {{}} makes the markers {g3(factor)} times {how} than their table, whose shape is "
        f"right to {g3(100 * left)} % of its extent: it has other ends, another length or another unit, or the table "
        "is rough in its scale; a second known distance would tell"
    )
    return (Doubt((bar.first, bar.second), words, "control"),)
