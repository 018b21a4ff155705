"""Emissivity with the viewing angle: by Fresnel's formulas for a painted surface, or by a table of measurements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError

Array = NDArray[np.float64]


def dielectric_emissivity(angle_deg: ArrayLike, normal: float, index: float = 1.5) -> Array:
    """Emissivity of a painted (non-metallic) surface seen under an angle.

    Parameters
    ----------
    angle_deg : (...) between the surface's normal and the line of sight, 0 to 90
    normal : emissivity seen straight on
    index : refractive index of the paint

    Returns
    -------
    (...) ``normal`` times the part of light that passes the surface under the angle, over that straight on (Fresnel's
    formulas for unpolarised light; Siegel and Howell, Thermal Radiation Heat Transfer, section 4-5).
    """
    if not (0 < normal <= 1 and index > 1):
        raise UsageError(f"dielectric_emissivity: normal must be in (0, 1], index above 1, got {normal} and {index}")
    c = np.cos(np.radians(np.clip(np.asarray(angle_deg, dtype=float), 0.0, 90.0)))
    inner = np.sqrt(index**2 - 1 + c**2)
    s = ((c - inner) / (c + inner)) ** 2
    p = ((index**2 * c - inner) / (index**2 * c + inner)) ** 2
    straight = 1 - ((index - 1) / (index + 1)) ** 2
    return np.asarray(normal * (1 - 0.5 * (s + p)) / straight)


@dataclass(frozen=True, eq=False)
class EmissivityTable:
    """Measured emissivities, straight between.

    Parameters
    ----------
    angle_deg : (N,) rising, from 0 to at most 90; N at least 2
    emissivity : (N,) in (0, 1]
    """

    angle_deg: Array
    emissivity: Array

    def __post_init__(self) -> None:
        a, e = np.asarray(self.angle_deg, dtype=float), np.asarray(self.emissivity, dtype=float)
        if a.ndim != 1 or a.shape != e.shape:
            raise ValueError(f"EmissivityTable: angle_deg and emissivity must be (N,), got {a.shape}, {e.shape}")
        if len(a) < 2:
            raise UsageError(f"EmissivityTable: expected at least two angles, got {len(a)}")
        if not ((np.diff(a) > 0).all() and a[0] >= 0 and a[-1] <= 90):
            raise UsageError("EmissivityTable: angles must rise, from 0 to at most 90 degrees")
        if not ((e > 0) & (e <= 1)).all():
            raise UsageError("EmissivityTable: emissivities must be above 0 and at most 1")
        object.__setattr__(self, "angle_deg", a)
        object.__setattr__(self, "emissivity", e)

    def at(self, angle_deg: ArrayLike) -> Array:
        """(...) emissivity; NaN for angles that the table does not reach: nothing is extrapolated."""
        angle = np.asarray(angle_deg, dtype=float)
        return np.interp(angle, self.angle_deg, self.emissivity, left=np.nan, right=np.nan)
