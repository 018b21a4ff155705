"""Length units in the header of a table: ``x [mm]``, ``x (mm)``, as spreadsheets are titled."""

from __future__ import annotations

import re
from collections.abc import Collection

from windmark.io.errors import FileError
from windmark.io.text import Pathlike
from windmark.scene.units import IN_WORDS

_WITH_UNIT = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")
NO_UNIT = ("", "-", "1")
"""What stands in the brackets of a column that has none."""


def split_units(
    path: Pathlike, line: int, header: tuple[str, ...], lengths: Collection[str], plain: Collection[str]
) -> tuple[tuple[str, ...], str]:
    """The columns of a header without their units, and the one unit of all lengths ("" where it says none).

    Parameters
    ----------
    path, line : of the header, for messages
    header : lower case
    lengths : columns whose brackets may hold a length unit
    plain : columns whose brackets may hold nothing, ``-`` or ``1``; those of any other column belong to its name

    Raises
    ------
    FileError
        For lengths in different units: a table has one.
    """
    columns, said = [], {}
    for cell in header:
        found = _WITH_UNIT.fullmatch(cell)
        name, unit = (found[1], (found[2] or found[3] or "").strip()) if found else (cell, "")
        if name in lengths or (name in plain and unit in NO_UNIT):
            columns.append(name)
            if name in lengths and unit not in NO_UNIT:
                said[name] = IN_WORDS.get(unit, unit)
        else:
            columns.append(cell)
    if len(set(said.values())) > 1:
        listed = ", ".join(f"{name} in {unit}" for name, unit in said.items())
        raise FileError(path, f"the header has lengths in several units: {listed}; expected one", line)
    return tuple(columns), next(iter(said.values()), "")
