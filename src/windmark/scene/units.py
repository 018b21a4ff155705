"""Length units: their names and sizes."""

from __future__ import annotations

import math

IN_MM = {"in": 25.4, "ft": 304.8, "mm": 1.0, "cm": 10.0, "m": 1000.0}
"""Every length unit there is, in millimetres."""
LENGTH_UNITS = tuple(IN_MM)
IN_WORDS = {
    "inch": "in", "inches": "in", "foot": "ft", "feet": "ft", "millimetre": "mm", "millimetres": "mm",
    "millimeter": "mm", "millimeters": "mm", "centimetre": "cm", "centimetres": "cm", "centimeter": "cm",
    "centimeters": "cm", "metre": "m", "metres": "m", "meter": "m", "meters": "m",
}  # fmt: skip
"""What other programs write for a unit, and windmark's name of it."""
ALIKE = 1.3
"""A factor is taken for that of two units if it is off by no more than this (2.54 and 3.28 are the nearest pair)."""


def mixed_units(factor: float, place_unit: str = "") -> tuple[str, str] | None:
    """The units that numbers ``factor`` times too small beside others are most likely in: (the others', theirs).

    Parameters
    ----------
    factor : how many times larger the lengths would have to be; > 0
    place_unit : the unit of the others, where it is known

    Returns
    -------
    None where no two units are so far apart.
    """
    others = (place_unit,) if place_unit in IN_MM else LENGTH_UNITS
    pairs = [(a, b) for a in others for b in LENGTH_UNITS if a != b]
    off = [abs(math.log(factor * IN_MM[a] / IN_MM[b])) for a, b in pairs]
    nearest = min(range(len(pairs)), key=lambda k: off[k])
    return pairs[nearest] if off[nearest] < math.log(ALIKE) else None
