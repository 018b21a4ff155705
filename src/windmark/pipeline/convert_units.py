"""Length units of what is converted: the file's, the one that the user says, the one that is wanted."""

from __future__ import annotations

from pathlib import Path

from windmark.errors import UsageError
from windmark.io import LENGTH_UNITS, FileError
from windmark.scene.units import IN_MM, IN_WORDS


def source_unit(path: Path, found: str, said: str | None) -> str:
    """The unit of a file's lengths: what it says or what the user says; "" where nobody does.

    Raises
    ------
    ValueError
        For an unknown unit of the user's.
    FileError
        Where file and user differ, or the file says a unit that is none.
    """
    found = IN_WORDS.get(found.lower(), found)
    if said is not None and said not in LENGTH_UNITS:
        raise UsageError(f"--unit must be one of {', '.join(LENGTH_UNITS)}, got {said!r}")
    if found and said not in (None, found):
        raise FileError(path, f"the length unit is {found}; expected {said}, as --unit says (--to-unit converts)")
    if found and found not in LENGTH_UNITS:
        raise FileError(path, f"the length unit is {found!r}; expected one of {', '.join(LENGTH_UNITS)}")
    return found or said or ""


def scale_to(path: Path, unit: str, wanted: str | None) -> tuple[float, str]:
    """The factor from ``unit`` to the wanted one, and the unit that then holds.

    Raises
    ------
    ValueError
        For an unknown unit, or one wanted of lengths whose own unit nobody says.
    """
    if wanted is None:
        return 1.0, unit
    if wanted not in LENGTH_UNITS:
        raise UsageError(f"--to-unit must be one of {', '.join(LENGTH_UNITS)}, got {wanted!r}")
    if not unit:
        raise UsageError(f"{path}: the file does not say its length unit, so --to-unit {wanted} needs --unit too")
    return IN_MM[unit] / IN_MM[wanted], wanted
