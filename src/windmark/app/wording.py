"""Names of settings and of columns, and their values, as a report says them: in words, not as Python has them."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

UNITS = {"px": "px", "deg": "°", "percent": "%", "s": "s", "ms": "ms", "mm": "mm"}
"""Endings of names that are units."""
MANY = 12
"""Of a list with more entries the first and the last ones are shown."""
TERMS = {
    "rms": "RMS", "crlb": "Cramér–Rao bound", "r0": "reference radius", "nfa": "false-alarm number", "x": "along x",
    "y": "along y", "two": "2", "missed": "not found", "found": "of those found",
    "fill": "filled part of the image",
}  # fmt: skip
"""Parts of names that are said in another way."""


def named(name: str) -> str:
    """A name of a setting or a column: its parts, the unit behind a comma (``rms_x_px``: RMS along x, px)."""
    parts = name.split("_")
    unit = UNITS.get(parts[-1]) if len(parts) > 1 else None
    said = " ".join(TERMS.get(part, part) for part in (parts[:-1] if unit else parts))
    return f"{said}, {unit}" if unit else said


def power_of_ten(exponent: float) -> str:
    """A power of ten as it is written by hand: ``-134`` is 10⁻¹³⁴."""
    return "10" + f"{exponent:z.0f}".translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def duration(seconds: float | None) -> str:
    """Seconds as a table of times has them: hundredths tell which stage took how long."""
    return "–" if seconds is None else f"{seconds:.2f}"


def setting(value: Any) -> str:
    """The value of a setting; nothing given is a dash."""
    if value is None or (isinstance(value, str | list | tuple | dict) and not value):
        return "–"
    if is_dataclass(value) and not isinstance(value, type):  # such as the datum of a calibration
        given = {f.name: getattr(value, f.name) for f in fields(value) if getattr(value, f.name) is not None}
        return type(value).__name__.lower() + (f" ({setting(given)})" if given else "")
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        if len(value) > MANY:
            return f"{len(value)}: {setting(value[0])}, {setting(value[1])} ... {setting(value[-1])}"
        return ", ".join(map(setting, value))
    if isinstance(value, dict):
        return ", ".join(f"{key}: {setting(one)}" for key, one in value.items())
    return f"{value:.7g}" if isinstance(value, float) else str(value)
