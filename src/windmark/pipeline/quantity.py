"""What the pixels of a picture measure, and how their numbers become it: value = offset + scale * grey level."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError

QUANTITIES = ("grey", "radiance", "temperature")
TEMPERATURES = ("K", "degC", "degF")
_UNIT = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ./^*-]*")


@dataclass(frozen=True)
class Quantity:
    """What a picture's values are.

    Parameters
    ----------
    name : "grey", "radiance" or "temperature"
    unit : of a temperature K, degC or degF; of a radiance whatever the camera's maker says, such as W/m2/sr; of grey
        levels none
    scale, offset : value = offset + scale * grey level, applied before anything is sampled

    Raises
    ------
    ValueError
        For another name, a unit that the quantity cannot have, a scale that is 0, numbers that are not finite.
    """

    name: str = "grey"
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        if self.name not in QUANTITIES:
            raise UsageError(f"quantity must be one of {', '.join(QUANTITIES)}, got {self.name!r}")
        if self.name == "grey" and self.unit:
            raise UsageError(f"unit: grey levels have none, got {self.unit!r}; quantity says what it is the unit of")
        if self.name == "temperature" and self.unit not in TEMPERATURES:
            known = ", ".join(TEMPERATURES)
            raise UsageError(f"unit of a temperature must be one of {known}, got {self.unit or None!r}")
        if self.name == "radiance" and not _UNIT.fullmatch(self.unit):
            raise UsageError(f"unit of a radiance must be given, such as W/m2/sr, got {self.unit or None!r}")
        if not (math.isfinite(self.scale) and self.scale != 0 and math.isfinite(self.offset)):
            raise UsageError(f"scale must not be 0, scale and offset finite, got {self.scale:g} and {self.offset:g}")

    @property
    def column(self) -> str:
        """The name of the values in tables and fields: ``value``, ``temperature_K``, ``radiance_W_m2_sr``."""
        return "value" if self.name == "grey" else re.sub(r"\W+", "_", f"{self.name}_{self.unit}").strip("_")

    @property
    def unit_words(self) -> str:
        """The unit as files and labels have it; "grey level" for plain pictures."""
        return self.unit or "grey level"

    @property
    def label(self) -> str:
        """For axes and colour bars: ``temperature, K``."""
        return "grey level" if self.name == "grey" else f"{self.name}, {self.unit}"

    @property
    def words(self) -> str:
        """What is said in a report; "" for grey levels as they are in the file."""
        if self.scale == 1 and self.offset == 0:
            return "" if self.name == "grey" else f"the values are {self.name} in {self.unit}"
        return f"the values are {self.label} ({self.offset:g} + {self.scale:g} x the file's grey level)"

    def of(self, image: NDArray[np.generic]) -> NDArray[np.generic]:
        """The picture in this quantity: the same array where nothing is to be done, else float32 (float64 stays so)."""
        if self.scale == 1 and self.offset == 0:
            return image
        kind = np.float64 if image.dtype == np.float64 else np.float32
        return (self.offset + self.scale * image.astype(np.float64)).astype(kind)


def quantity_of(
    name: str | None, unit: str | None, scale: float, offset: float, told: tuple[str, str] | None
) -> Quantity:
    """What the user says, or else what the file says.

    Parameters
    ----------
    name, unit : the user's words, None where there are none
    scale, offset : the user's rescaling
    told : (quantity, unit) that the file says, if it does

    Raises
    ------
    ValueError
        Where user and file contradict each other, and as `Quantity`.
    """
    if told is None or told[0] == "grey":
        return Quantity(name or "grey", unit or "", scale, offset)
    contradiction = (name is not None and name != told[0]) or (unit is not None and told[1] and unit != told[1])
    if contradiction and (scale, offset) == (1.0, 0.0):  # a rescaling may well turn degC into K
        meant = " ".join(filter(None, (name, unit)))
        raise UsageError(f"the file says that its values are {told[0]} in {told[1]}; expected {meant}, as was said")
    return Quantity(name or told[0], unit or told[1], scale, offset)
