"""Length units: their names and sizes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g3
from windmark.geometry.order import median

Array = NDArray[np.float64]

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


SIGMAS_OFF = "the sigmas of the table are in another unit than its places"
"""Words of a refusal, which name the verdict."""


def spelt(unit: str) -> str:
    """A unit in a sentence, where "in" is another word."""
    return "inch" if unit == "in" else unit


def either(units: Sequence[str]) -> str:
    """Some units in a sentence: "m or ft"."""
    return " or ".join(map(spelt, units))


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


RADII_OFF, RADII_ODD = 2.2, 1.5
"""Radii that are nearly all by such a factor larger or smaller than a table's are in another unit (the nearest two are
2.54 apart), or stand for something else; from the second on that is said (`tests/registration/test_discs`)."""
RIM_PX = 0.2
"""1 sigma of an imaged radius that all discs of a picture share: where in a blurred rim the threshold lies, how much a
print bled, what the gamma of a camera does."""


def off_by(ratios: Array, least: int) -> float:
    """The factor by which nearly all of some ratios (N,) are off 1: of the quartiles the one that is nearer to 1.

    1 where the quartiles lie on either side of it, or fewer than ``least`` are known.
    """
    known = ratios[np.isfinite(ratios) & (ratios > 0)]
    if len(known) < least:
        return 1.0
    low, high = np.percentile(known, [25, 75])
    return float(low if low > 1 else high if high < 1 else 1.0)


@dataclass(frozen=True)
class CommonRatio:
    """How many times the expected radii of discs they are imaged with, all alike.

    Parameters
    ----------
    ratio : median over the discs; 1 where too few are known
    sigma : 1 sigma of its logarithm: the median's own from the discs' scatter, and `RIM_PX`
    """

    ratio: float
    sigma: float

    @property
    def is_off(self) -> bool:
        """Whether it is not 1: beyond three sigmas."""
        return abs(math.log(self.ratio)) > 3 * self.sigma

    def matters(self, sigmas: float) -> bool:
        """Whether it is to be said where it changes something by so many ``sigmas``, which these have in them.

        That is where it is not 1 and changes something by over a sigma, or is odd.
        """
        return self.is_off and (max(self.ratio, 1 / self.ratio) > RADII_ODD or sigmas > 1.0)


def common_ratio(ratios: Array, imaged_px: Array, least: int) -> CommonRatio:
    """The common ratio of imaged radii (N,) ``imaged_px`` to the expected ones, from (N,) ``ratios``.

    Fewer than ``least`` known ones say nothing. The median of n normal values has a sigma of sqrt(pi / 2n) of theirs,
    which is 1.48 times the median distance from it (Rousseeuw and Croux 1993).
    """
    known = np.isfinite(ratios) & (ratios > 0)
    if known.sum() < least:
        return CommonRatio(1.0, math.inf)
    logs = np.log(ratios[known])
    middle = median(logs)
    spread = 1.4826 * median(np.abs(logs - middle))
    rim = RIM_PX / median(imaged_px[known])
    return CommonRatio(math.exp(middle), math.hypot(spread * math.sqrt(math.pi / (2 * len(logs))), rim))


def radii_words(ratio: float, place_unit: str = "") -> str:
    """That imaged radii are ``ratio`` times those that a table lets expect, and the likely reason."""
    small, factor = ("small", ratio) if ratio > 1 else ("large", 1 / ratio)
    units = mixed_units(ratio, place_unit) if max(ratio, 1 / ratio) > RADII_OFF else None
    likely = "; diameters in their place?" if units is None and 1.8 < factor < 2.2 and small == "large" else ""
    if units is not None:
        places, radii = map(spelt, units)
        likely = f": radii in {radii} beside places in {places}?"
    elif not likely:
        likely = "; another unit, or something else than radii?"
    return f"the table's radii are {g3(factor)} times too {small} for the imaged markers{likely}"


def radii_told(ratio: float, place_unit: str, sigmas: str = "the sigma of the pose has") -> str:
    """`radii_words`, and that the ``sigmas`` have what that changes."""
    told = f"By them a disc's centre is told from that of its image; {sigmas} what that changes"
    return f"{radii_words(ratio, place_unit)} {told}"
