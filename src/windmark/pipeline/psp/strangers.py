"""Readings of sensors that no place has, or of points that the table of points does not have: they do not count."""

from __future__ import annotations

import re
from collections.abc import Sequence

from windmark import io
from windmark.pipeline.alike import listed
from windmark.pipeline.psp.table import SensorTable

OF_NO_POINT = "are of no point of the table of points"
"""In what is said of readings that are most likely meant for points that have none."""


def strangers(table: SensorTable, places: io.PointList, points: Sequence[str]) -> list[str]:
    """What is to be said of readings that do not count, by the names (P,) of the points that are reduced."""
    known = set(places.name.tolist())
    lost = sorted({n for own in table.of.values() for n in own} - known)
    some = ", ".join(lost[:5]) + (", ..." if len(lost) > 5 else "")
    said = [f"{table.path}: {len(lost)} sensors have readings but no place: {some}"] if lost else []
    return [*said, *_points(table, points)]


def _points(table: SensorTable, points: Sequence[str]) -> list[str]:
    """Points without a reading, where there are some of points that the table does not have.

    A table of readings may be that of more points than are reduced. Only where one is called as another is but for
    case, signs and zeros before its number, or where not one name is a point's, is it told as a fault (`OF_NO_POINT`).
    """
    without = [p for p in points if p not in table.of]
    other = [p for p in table.of if p not in set(points)]
    if not (without and other):
        return []
    alike = {_bare(p): p for p in other}
    meant = [(p, alike[_bare(p)]) for p in without if _bare(p) in alike]
    file = table.path.name
    if meant:
        names, theirs = ([pair[k] for pair in meant] for k in (0, 1))
        return [f"{file}: no reading of {listed('point', names)}; those of {', '.join(theirs[:5])} {OF_NO_POINT}"]
    if len(without) == len(points):
        return [f"{file}: no reading of any point; all of them, as those of {other[0]}, {OF_NO_POINT}"]
    return [f"{file}: no reading of {listed('point', without)}, but of {listed('point', other)}, which the table "
            "of points does not have"]  # fmt: skip


def _bare(name: str) -> str:
    """A name without what is written in several ways: "P-02", "p2" and "p 002" are one."""
    return re.sub(r"(?<![0-9])0+(?=[0-9])", "", re.sub(r"[\W_]", "", name.casefold()))
