"""A cell table whose isotherms are each divided by their own reference: it says nothing of the temperature.

I_ref of a table is the light at one pressure and one temperature. Where each temperature has an I_ref of its own, the
ratio is 1 at the reference pressure at all of them, and what temperature does to the paint's brightness is divided out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OWN_REFERENCE = "I_ref / I is exactly 1 at"
"""Begins what is said of such a table."""
SAME_P, SAME_T = 0.01, 0.05
"""Parts of the pressure, and of the span of temperatures, within which rows are at one."""
LEAST = 5e-4
"""By which the ratio of a paint changes per kelvin at least: paints that are made to answer little to temperature do so
by a part of a thousand."""
DIGITS = 3
"""Steps of its last digit that the ratio must change by for sure, for a 1 to be no rounding."""
EXACTLY = 1e-9


def own_reference(pressure: Array, temperature: Array, ratio: Array, unit: str = "Pa") -> str:
    """What is to be said of a table (M,) whose isotherms have a reference each, "" of any other.

    At all temperatures there is a row with a ratio of exactly 1, all of them at one pressure, and the temperatures
    differ by so much that no paint's ratio stays the same to all digits that are given.
    """
    one = np.abs(ratio - 1) < EXACTLY
    span = float(np.ptp(temperature))
    if one.sum() < 2 or not LEAST * span > DIGITS * _step(ratio):
        return ""
    at = float(np.median(pressure[one]))
    one &= np.abs(pressure - at) <= SAME_P * at
    apart = np.abs(temperature[:, None] - temperature[one][None]).min(axis=1)
    if one.sum() < 2 or not apart.max() <= SAME_T * span:
        return ""
    return (f"{OWN_REFERENCE} {at:g} {unit} at all temperatures ({temperature.min():g} to {temperature.max():g}): each "
            "has an I_ref of its own, and what temperature does to the paint is not in the table; expected one I_ref "
            "for all rows, that at the reference pressure and temperature")  # fmt: skip


def _step(ratio: Array) -> float:
    """Of the last digit that ratios are given to; 0 for more than twelve."""
    for digits in range(13):
        if np.abs(ratio - np.round(ratio, digits)).max() < EXACTLY * 10.0**-digits:
            return float(10.0**-digits)
    return 0.0
