"""Tables of a paint test, read as its run reads them: columns, units, cells, conditions, pictures that are there."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from windmark.errors import DataError, WindmarkError
from windmark.pipeline.deform.frames import files_of
from windmark.pipeline.psp.cell import read_cell
from windmark.pipeline.psp.entries import CAMERA
from windmark.pipeline.psp.offs import read_references
from windmark.pipeline.psp.stream import constants_of
from windmark.pipeline.psp.table import PointRow, read_points_table, read_sensors

MOST_POINTS = 3
"""Points that are named for what is wrong with several."""


def paint_tables(path: Path, data: Mapping[str, Any]) -> Iterator[tuple[str, Callable[[], str]]]:
    """Key and reader of each table that the settings ``data`` of a paint test at ``path`` name.

    A reader says in words what is sound, and raises `WindmarkError` for what is not. Files that are missing are not
    its matter.
    """

    def named(table: str, key: str) -> Path | None:
        entry = data.get(table)
        value = entry.get(key) if isinstance(entry, Mapping) else None
        file = path.parent / value if isinstance(value, str) else None
        return file if file is not None and file.is_file() else None

    if (points := named("points", "table")) is not None:
        yield "points.table", lambda: _points(path, data, points)
    if (references := named("reference", "table")) is not None:
        yield "reference.table", lambda: f"{len(read_references(references))} references by incidence"
    if (cell := named("paint", "cell")) is not None:
        yield "paint.cell", lambda: f"{len(read_cell(cell).ratio)} measurements of the paint's cell"
    for table, key, quantity in (("taps", "pressures", "pressure"), ("temperature", "readings", "temperature")):
        if (file := named(table, key)) is not None:
            yield f"{table}.{key}", partial(_sensors, file, quantity)


def _sensors(file: Path, quantity: str) -> str:
    found = read_sensors(file, quantity, 1.0)
    return f"{quantity} readings of {len(found.of)} points"


def _points(path: Path, data: Mapping[str, Any], table: Path) -> str:
    given = data.get("conditions")
    constants = constants_of(given if isinstance(given, Mapping) else {})
    rows = read_points_table(table, constants, references=isinstance(data.get("reference"), Mapping))
    cameras = [str(c.get("name", "")) for c in data.get("camera", []) if isinstance(c, Mapping)]
    wrong = {row.name: why for row in rows if (why := _trouble(path, row, cameras, data))}
    if wrong:
        some = "; ".join(f"{name}: {why}" for name, why in list(wrong.items())[:MOST_POINTS])
        more = f"; and {len(wrong) - MOST_POINTS} more" if len(wrong) > MOST_POINTS else ""
        raise DataError(f"{len(wrong)} of {len(rows)} points cannot be reduced: {some}{more}")
    return f"{len(rows)} points" if len(rows) > 1 else "1 point"


def _trouble(path: Path, row: PointRow, cameras: list[str], data: Mapping[str, Any]) -> str:
    """Why a point will not be reduced, as far as its row and the names of its pictures tell; "" where it may be."""
    try:
        if not isinstance(data.get("reference"), Mapping):
            row.conditions()
    except WindmarkError as error:
        return str(error)
    for kind, pattern in row.patterns.items():
        if not pattern and isinstance(data.get("reference"), Mapping):
            continue
        if not pattern:
            return f"names no {kind} pictures (line {row.line})"
        if not any(files_of(path.parent / pattern.replace(CAMERA, name)) for name in cameras):
            return f"no {kind} picture matches {pattern!r} (line {row.line})"
    return ""
